//! Scores of a sequence of light sets: flicker, unwarranted change, step response, transit energy, tracking error, motion noise, churn.
//!
//! E_set and E_ref are the irradiance of the shadowed receivers under a light set and under its map, mu(t) is the mean E_ref of frame t. Slices
//! have one element per frame; frames beyond the shortest slice are ignored.

use std::collections::{HashMap, HashSet};

use super::reference::ambient_luminance;
use super::vector::{add_scaled, angle_deg};
use super::{LitSet, Reading, Reference, TexelGrid, holds, luminance, relative, rms, sh};
use crate::env::EnvMap;

/// Largest angle from the rim of a source within which energy does not count as transit energy, degrees.
pub const NEAR_SOURCE_DEG: f64 = 10.0;
/// Radius of a moving source's neighbourhood, degrees; also the tracking error if the neighbourhood contains no light.
pub const NEIGHBOURHOOD_DEG: f64 = 15.0;
/// Largest change of E_ref, divided by mu, with which a receiver counts as one that cannot see the switched source.
pub const UNCHANGED: f64 = 1e-6;
/// Ratio of the shadowed error to its steady value at which a step response ends.
pub const SETTLED: f64 = 1.25;

/// Largest tracking lag, frames.
pub const MOST_LAG: usize = 6;

/// Mean and largest value of a score over the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Arithmetic mean of the score over the frames.
    pub mean: f64,
    /// Largest score of a single frame.
    pub max: f64,
}

impl Spread {
    /// Returns the mean and the largest of `values`; `None` if there are no values.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let max = values.iter().copied().reduce(f64::max)?;
        Some(Self { mean: values.iter().sum::<f64>() / values.len() as f64, max })
    }
}

/// Returns, for each frame, the irradiance under the set minus the irradiance under the map at every shadowed receiver.
fn excess(references: &[Reference], sets: &[LitSet], reading: Reading) -> Vec<Vec<f64>> {
    let pairs = references.iter().zip(sets);
    pairs
        .map(|(reference, set)| differences(&reference.shadowed_of(set, reading), reference.shadowed()))
        .collect()
}

/// Returns the flicker of the frames t = 1, 2, ...: the difference between the changes of irradiance under the set and under the map,
/// RMS_k((E_set(t) - E_set(t-1)) - (E_ref(t) - E_ref(t-1))) / mu(t).
#[must_use]
pub fn flicker(references: &[Reference], sets: &[LitSet], reading: Reading) -> Vec<f64> {
    let excess = excess(references, sets, reading);
    let steps = excess.windows(2).zip(&references[1.min(references.len())..]);
    steps.map(|(e, now)| relative(rms(differences(&e[1], &e[0]).into_iter()), now.shadowed_mu())).collect()
}

/// Returns the shadowed error of a set over the shadowed receivers with the indices `probes`; mu is the mean over these receivers.
#[must_use]
pub fn shadowed_error_among(reference: &Reference, set: &LitSet, reading: Reading, probes: &[usize]) -> f64 {
    let excess = differences(&reference.shadowed_of(set, reading), reference.shadowed());
    relative(rms(probes.iter().map(|&k| excess[k])), mu_among(reference, probes))
}

/// Returns the flicker of the frames t = 1, 2, ... over the shadowed receivers with the indices `probes`; mu is the mean over these receivers.
#[must_use]
pub fn flicker_among(
    references: &[Reference],
    sets: &[LitSet],
    reading: Reading,
    probes: &[usize],
) -> Vec<f64> {
    let excess = excess(references, sets, reading);
    let steps = excess.windows(2).zip(&references[1.min(references.len())..]);
    let change = |e: &[Vec<f64>]| rms(probes.iter().map(|&k| e[1][k] - e[0][k]));
    steps.map(|(e, now)| relative(change(e), mu_among(now, probes))).collect()
}

fn mu_among(reference: &Reference, probes: &[usize]) -> f64 {
    probes.iter().map(|&k| reference.shadowed()[k]).sum::<f64>() / probes.len().max(1) as f64
}

/// One frame of a sequence: reference irradiance and light set.
#[derive(Clone, Copy, Debug)]
pub struct ScoredFrame<'a> {
    /// Irradiance of the receivers under the frame's map.
    pub reference: &'a Reference,
    /// Light set of the frame that is scored.
    pub set: &'a LitSet,
}

/// Returns the unwarranted change: the change of irradiance at receivers that cannot see the switched source, RMS_k(E_set(after) -
/// E_set(before)) / mu(after) over the receivers k with |E_ref(after) - E_ref(before)| <= 1e-6 mu(after).
///
/// The ideal value is 0; `None` if every receiver sees the source.
#[must_use]
pub fn unwarranted_change(before: ScoredFrame<'_>, after: ScoredFrame<'_>) -> Option<f64> {
    let mu = after.reference.shadowed_mu();
    let truth = differences(after.reference.shadowed(), before.reference.shadowed());
    let irradiance = |frame: ScoredFrame<'_>| frame.reference.shadowed_of(frame.set, Reading::Points);
    let made = differences(&irradiance(after), &irradiance(before));
    let blind: Vec<f64> =
        made.iter().zip(truth).filter(|(_, t)| t.abs() <= UNCHANGED * mu).map(|(&m, _)| m).collect();
    (!blind.is_empty()).then(|| relative(rms(blind.into_iter()), mu))
}

/// Returns the motion noise: the mean angle in degrees between lights of equal id in successive frames of a static noisy scene. `None` if no id
/// occurs in two successive frames.
#[must_use]
pub fn motion_noise_deg(sets: &[LitSet]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for pair in sets.windows(2) {
        let before: HashMap<u32, [f64; 3]> = pair[0].lights.iter().map(|l| (l.id, l.direction)).collect();
        for light in &pair[1].lights {
            if let Some(&from) = before.get(&light.id) {
                sum += angle_deg(from, light.direction);
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / count as f64)
}

/// Returns the largest relative change of the radius between lights of equal id in successive frames. `None` if no id occurs in two successive
/// frames.
#[must_use]
pub fn radius_change(sets: &[LitSet]) -> Option<f64> {
    let mut largest: Option<f64> = None;
    for pair in sets.windows(2) {
        let before: HashMap<u32, f64> = pair[0].lights.iter().map(|l| (l.id, l.radius_deg)).collect();
        for light in &pair[1].lights {
            if let Some(&from) = before.get(&light.id) {
                let change = relative((light.radius_deg - from).abs(), from);
                largest = Some(largest.map_or(change, |l| l.max(change)));
            }
        }
    }
    largest
}

/// Returns the step response: the number of frames from an abrupt change to the first frame whose shadowed error is at most 1.25 times its steady
/// value. `change` is the index of the first frame after the change, which counts as 1.
///
/// The steady value is the median error over the last quarter of the frames from `change` on, at least one frame. Errors below 1e-9 are rounding
/// errors and count as steady. `None` if the sequence ends before `change`.
#[must_use]
pub fn step_response(shadowed_errors: &[f64], change: usize) -> Option<usize> {
    let after = shadowed_errors.get(change..).filter(|frames| !frames.is_empty())?;
    let mut rest = after[after.len() - after.len().div_ceil(4)..].to_vec();
    rest.sort_by(f64::total_cmp);
    let limit = (SETTLED * rest[rest.len() / 2]).max(1e-9);
    after.iter().position(|&error| error <= limit).map(|at| at + 1)
}

/// Returns the tracking lag: the number of frames s by which the scene must be delayed to be most similar to the light sets, so that the sum over the
/// frames t and the receivers k of (E_set(t) - E_ref(t - s))^2 is least. `None` if there are fewer than 13 frames.
///
/// The least of the sums for s = 0, 1, ... 6 and its neighbours determine a parabola, whose minimum is returned; 0 or 6 if one of these is the least.
/// The first 6 frames are not included in the sums, since the scene before the first frame is unknown.
#[must_use]
pub fn tracking_lag(references: &[Reference], sets: &[LitSet]) -> Option<f64> {
    if references.len().min(sets.len()) <= 2 * MOST_LAG {
        return None;
    }
    let mut sums = [0.0; MOST_LAG + 1];
    for (t, (reference, set)) in references.iter().zip(sets).enumerate().skip(MOST_LAG) {
        let made = reference.shadowed_of(set, Reading::Points);
        for (lag, sum) in sums.iter_mut().enumerate() {
            *sum += rms(differences(&made, references[t - lag].shadowed()).into_iter()).powi(2);
        }
    }
    let least = (0..sums.len()).min_by(|a, b| sums[*a].total_cmp(&sums[*b]))?;
    let shift = match sums.get(least.wrapping_sub(1)..least + 2) {
        Some(&[before, at, after]) if before + after > 2.0 * at => {
            0.5 * (before - after) / (before - 2.0 * at + after)
        }
        _ => 0.0,
    };
    Some(least as f64 + shift)
}

/// A light source of the scene: a disc on the sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSource {
    /// Unit vector from the probe towards the centre of the source.
    pub direction: [f64; 3],
    /// Angular radius of the source, degrees.
    pub radius_deg: f64,
}

impl LightSource {
    /// Returns the angle from the source's rim to `d`, degrees; 0 inside of the source.
    #[must_use]
    pub fn distance_deg(&self, d: [f64; 3]) -> f64 {
        (angle_deg(self.direction, d) - self.radius_deg).max(0.0)
    }
}

/// Returns the absolute difference between the luminous energies of the set (lights and ambient light) and of the map over the directions more
/// than 10 degrees from every source.
#[must_use]
pub fn stray_energy(grid: &TexelGrid, map: &EnvMap, set: &LitSet, sources: &[LightSource]) -> f64 {
    let far = |d: [f64; 3]| sources.iter().all(|source| source.distance_deg(d) > NEAR_SOURCE_DEG);
    let truth: f64 = grid.luminous(map).filter(|&(d, _)| far(d)).map(|(_, flux)| flux).sum();
    let made: f64 = set_fluxes(grid, set).filter(|&(d, _)| far(d)).map(|(_, flux)| flux).sum();
    (made - truth).abs()
}

/// Returns the transit energy: the largest [`stray_energy`] of the frames, divided by the luminous energy of the switched source. It is large if
/// lights move between sources through empty sky.
#[must_use]
pub fn transit_energy(stray: &[f64], switched_energy: f64) -> f64 {
    relative(stray.iter().copied().fold(0.0, f64::max), switched_energy)
}

/// Returns the tracking error: the angle in degrees between the energy-weighted mean directions of the set and of the map within 15 degrees of a
/// moving source; 15 degrees if the set has no light in this neighbourhood.
///
/// The mean of the set includes ambient light, the mean of the map the background. `None` if the map is black in the neighbourhood, as for a
/// source below the horizon.
#[must_use]
pub fn tracking_error_deg(grid: &TexelGrid, map: &EnvMap, set: &LitSet, source: [f64; 3]) -> Option<f64> {
    let near = |d: [f64; 3]| angle_deg(source, d) <= NEIGHBOURHOOD_DEG;
    let truth = mean_direction(grid.luminous(map).filter(|&(d, _)| near(d)))?;
    let lit = set.lights.iter().any(|l| near(l.direction) && luminance(l.irradiance) > 0.0);
    let made = mean_direction(set_fluxes(grid, set).filter(|&(d, _)| near(d))).filter(|_| lit);
    Some(made.map_or(NEIGHBOURHOOD_DEG, |made| angle_deg(made, truth)))
}

/// Returns the churn of the frames t = 1, 2, ...: the number of ids that appear plus the number of ids that disappear.
#[must_use]
pub fn churn(sets: &[LitSet]) -> Vec<f64> {
    let ids: Vec<HashSet<u32>> =
        sets.iter().map(|set| set.lights.iter().map(|light| light.id).collect()).collect();
    ids.windows(2).map(|pair| pair[0].symmetric_difference(&pair[1]).count() as f64).collect()
}

/// Returns the parsimony: the least number of lights among pairs (lights, shadowed error) with an error of at most `tolerance`.
#[must_use]
pub fn parsimony(points: &[(usize, f64)], tolerance: f64) -> Option<usize> {
    points.iter().filter(|(_, error)| *error <= tolerance).map(|&(lights, _)| lights).min()
}

/// Returns pairs (direction, luminous energy): first of the lights inside of the domain, then of the ambient light in each texel.
fn set_fluxes<'a>(grid: &'a TexelGrid, set: &'a LitSet) -> impl Iterator<Item = ([f64; 3], f64)> + 'a {
    let inside = set.lights.iter().filter(|light| holds(grid.domain(), light.direction));
    let lights = inside.map(|light| (light.direction, luminance(light.irradiance)));
    let ambient = ambient_luminance(set).into_iter().flat_map(move |c| {
        let texels = grid.directions().enumerate();
        texels.map(move |(k, d)| (d, sh::evaluate(&c, d) * grid.solid_angle(k)))
    });
    lights.chain(ambient)
}

/// Returns the direction of the first moment of the fluxes; `None` if the moment is zero.
fn mean_direction(fluxes: impl Iterator<Item = ([f64; 3], f64)>) -> Option<[f64; 3]> {
    let mut moment = [0.0; 3];
    fluxes.for_each(|(d, flux)| add_scaled(&mut moment, d, flux));
    super::vector::unit(moment)
}

fn differences(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
