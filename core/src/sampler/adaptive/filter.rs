//! Filters directions and energies without delay: exponential smoothing whose gain is a tracking signal.
//!
//! With nu the step from a light's filtered to its new value, s the running mean of nu and a that of |nu|, the gain is (|s| / a)^2. Steps
//! by noise have random directions, so s stays small compared with a and the gain is about beta / (2 - beta); steps by motion share one
//! direction, so s approaches a and the gain 1. A step larger than [`JUMP`] times a is followed at once. The tracking signal |s| / a was
//! published by Trigg and Leach (1967); its square as the gain, and the jump threshold, are new here. Energies are filtered as shares of
//! the whole, so that a change of the whole is no step, and only in a scene at rest: the energies of neighbours change together, and a
//! delay of one of them would be visible.

use super::discs;
use super::nodes::Leaf;
use crate::color::luminance;
use crate::light::Light;
use glam::Vec3;

/// Properties of a frame that are computed before the frame's lights.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Number of lights in the last frame.
    pub previous: usize,
    /// Whether the filter treats the scene as moving.
    pub moving: bool,
}

/// Weight beta of the newest step in both running means: the gain on noise is about 0.11, and motion is followed after about five frames.
const MEMORY: f32 = 0.2;

/// Ratio of a step to the mean step above which the step is a jump: about one in ten thousand steps of normal noise.
const JUMP: f32 = 4.0;

/// Initial mean step of the direction of a new light, relative to its angular radius: the effect of 2 % noise on a dozen texels.
const NEW_STEP: f32 = 0.02;

/// Largest change per frame of the radius of a disc in a scene at rest, relative to the radius.
const WIDER: f32 = 0.05;

/// Initial mean step of the radius of a new disc, relative to the radius.
const NEW_WIDTH: f32 = 0.01;

/// Initial mean step of the energy of a new light, relative to the energy.
const NEW_SHARE: f32 = 0.01;

/// State of the temporal filter of one light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightFilter {
    /// Direction of the light that was returned last.
    direction: Vec3,
    /// Fraction of the whole energy that was returned last for the light; 0 at first.
    share: f32,
    place: Signal<Vec3>,
    energy: Signal<f32>,
    /// Radius of a disc of the same region that was returned last, degrees; `None` at first and for lights that are fitted as points.
    radius_deg: Option<f32>,
    width: Signal<f32>,
    /// Identifies the light's region: the level of the leaf, or [`GATHERED`] plus the number of gathered lights.
    region: u8,
    /// Vector from the centroid of the region to the disc's centre before filtering; 0 for points.
    offset: Vec3,
}

/// Least region identifier of gathered lights, above every level.
const GATHERED: u8 = 128;

/// Running means of the steps of a filtered value, and of the lengths of the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Signal<V> {
    mean: V,
    length: f32,
}

/// Lights of the last frame, by ascending id, with their filters in the same order.
#[derive(Clone, Copy, Debug)]
pub(super) struct PastLights<'a> {
    pub(super) lights: &'a [Light],
    pub(super) tracks: &'a [LightFilter],
}

/// Result of comparing the regions of the lights with those of the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Regions {
    /// Every light has the region that it had in the last frame.
    Same,
    /// At least one light has another region than in the last frame.
    Changed,
}

/// Returns the identifier of the region of one of `lights` lights.
fn region(lights: usize, leaf: &Leaf) -> u8 {
    if lights <= super::GATHERED_POINTS { GATHERED + lights as u8 } else { leaf.level }
}

/// Compares the regions of the lights with those of the last frame.
pub(super) fn compare(lights: &[Light], leaves: &[Leaf], past: PastLights<'_>) -> Regions {
    let count = lights.len();
    let ids = lights.iter().zip(past.lights).all(|(light, old)| light.id == old.id);
    let places =
        leaves.iter().zip(past.tracks).take(count).all(|(leaf, track)| region(count, leaf) == track.region);
    if count == past.lights.len() && ids && places { Regions::Same } else { Regions::Changed }
}

/// Moves the lights, whose regions are those of the last frame, by their offsets in the last frame.
pub(super) fn move_again(lights: &mut [Light], past: PastLights<'_>) {
    for (light, track) in lights.iter_mut().zip(past.tracks) {
        light.direction = (light.direction + track.offset).try_normalize().unwrap_or(light.direction);
    }
}

/// Stores the offset of each light from the centroid of its region.
pub(super) fn note_moves(tracks: &mut [LightFilter], moves: &[Vec3]) {
    tracks.iter_mut().zip(moves).for_each(|(track, by)| track.offset = *by);
}

/// Replaces the lights' directions by filtered ones and continues their ages; old and new lights ascend by id.
pub(super) fn follow(
    lights: &mut [Light],
    tracks: &mut [LightFilter],
    leaves: &[Leaf],
    past: PastLights<'_>,
) {
    let count = lights.len();
    let mut past = past.lights.iter().zip(past.tracks).peekable();
    for ((light, track), leaf) in lights.iter_mut().zip(tracks).zip(leaves) {
        while past.next_if(|(o, _)| o.id < light.id).is_some() {}
        *track = LightFilter {
            direction: light.direction,
            share: 0.0,
            place: Signal { mean: Vec3::ZERO, length: NEW_STEP * light.radius_deg.to_radians() },
            energy: Signal { mean: 0.0, length: NEW_SHARE },
            radius_deg: None,
            width: Signal { mean: 0.0, length: NEW_WIDTH },
            region: region(count, leaf),
            offset: Vec3::ZERO,
        };
        if let Some((o, known)) = past.next_if(|(o, _)| o.id == light.id) {
            light.age = o.age.saturating_add(1);
            if known.region == track.region {
                *track = LightFilter { offset: Vec3::ZERO, ..*known };
                let step = light.direction - known.direction;
                let gain = track.place.gain(step, Vec3::length);
                light.direction = (known.direction + step * gain).try_normalize().unwrap_or(light.direction);
                track.direction = light.direction;
            }
        }
    }
}

/// Updates the filters of the radii of discs. Unless the scene is `moving`, replaces the radii of regions of the last frame by filtered ones,
/// which change by at most [`WIDER`]; a point remains a point up to twice the least radius of a disc.
pub(super) fn follow_radii(lights: &mut [Light], tracks: &mut [LightFilter], moving: bool) {
    for (light, track) in lights.iter_mut().zip(tracks) {
        match track.radius_deg {
            Some(old) if old > 0.0 => {
                let step = light.radius_deg / old - 1.0;
                let gain = track.width.gain(step, f32::abs);
                if !moving {
                    light.radius_deg = old * (1.0 + (gain * step).clamp(-WIDER, WIDER));
                }
            }
            Some(_) if !moving && light.radius_deg < 2.0 * discs::NARROWEST_DEG => light.radius_deg = 0.0,
            _ => {}
        }
        track.radius_deg = Some(light.radius_deg);
    }
}

/// Updates the filters of the lights' energies and, if the scene is `quiet`, replaces the energies by filtered ones, whose sum may differ.
pub(super) fn settle(lights: &mut [Light], tracks: &mut [LightFilter], quiet: bool) {
    let whole: f32 = lights.iter().map(|l| luminance(l.irradiance)).sum();
    for (light, track) in lights.iter_mut().zip(tracks) {
        let seen = if whole > 0.0 { luminance(light.irradiance) / whole } else { 0.0 };
        if track.share > 0.0 && seen > 0.0 {
            let step = seen / track.share - 1.0;
            let gain = track.energy.gain(step, f32::abs);
            if quiet {
                let filtered = track.share * (1.0 + gain * step);
                light.irradiance = light.irradiance.map(|v| v * (filtered / seen));
                track.share = filtered;
                continue;
            }
        }
        track.share = seen;
    }
}

impl<V> Signal<V>
where
    V: Copy + core::ops::Add<Output = V> + core::ops::Sub<Output = V> + core::ops::Mul<f32, Output = V>,
{
    /// Adds a step to the running means; returns the gain for this step, 0..=1.
    fn gain(&mut self, step: V, length: impl Fn(V) -> f32) -> f32 {
        let size = length(step);
        if size > JUMP * self.length {
            // The next frames show whether the step was one jump or the start of a motion; until then, the expected step length is raised.
            self.length = if self.length > 0.0 { self.length * (1.0 + (JUMP - 1.0) * MEMORY) } else { size };
            self.mean = step * (self.length / size);
            return 1.0;
        }
        self.mean = self.mean + (step - self.mean) * MEMORY;
        self.length += (size - self.length) * MEMORY;
        let signal = if self.length > 0.0 { (length(self.mean) / self.length).min(1.0) } else { 1.0 };
        signal * signal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the radii of one disc over frames in which its region has the radii `seen`.
    fn radii(seen: &[f32], moving: bool) -> heapless::Vec<f32, 16> {
        let mut track =
            [LightFilter { width: Signal { mean: 0.0, length: NEW_WIDTH }, ..LightFilter::default() }];
        let filtered = |radius_deg: &f32| {
            let mut lights = [Light { radius_deg: *radius_deg, ..Light::default() }];
            follow_radii(&mut lights, &mut track, moving);
            lights[0].radius_deg
        };
        seen.iter().map(filtered).collect()
    }

    #[test]
    fn radii_at_rest_change_slowly_and_points_remain_points() {
        let found = radii(&[4.0, 8.0, 2.0, 8.0, 8.0, 8.0, 8.0], false);
        assert!(found.windows(2).all(|p| (p[1] / p[0] - 1.0).abs() < 0.0501), "{found:?}");
        assert!(found[6] > found[2], "a change that stays is followed: {found:?}");
        assert_eq!(radii(&[0.0, 0.15, 0.0, 0.19], false)[..], [0.0; 4], "rounding of a point");
        assert_eq!(radii(&[0.0, 1.0], false)[1], 1.0, "no longer a point");
    }

    #[test]
    fn radii_of_what_moves_are_followed_at_once() {
        let seen = [4.0, 8.0, 2.0, 0.0, 3.0];
        assert_eq!(radii(&seen, true)[..], seen);
    }
}
