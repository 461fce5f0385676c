//! The filter that the thesis wished for: a Kalman filter of a random walk that smooths noise and follows an abrupt change at once.
//!
//! [`Kalman`] turns a step (measured minus filtered, on a line or in the tangent plane of the sphere) into the part of it to take. With P
//! the state's variance, R the noise's and Q = drift R the walk's:
//!
//! ```text
//! P += Q;  S = P + R;  w = step / sqrt(S)
//! |w|^2 > gate:          a jump: all of it, P = R (or none, if it is to be confirmed and the last frame neither had one that way nor jumped)
//! |CUSUM of w| > alarm:  a small step that persists: all of it, P = R
//! else                   P / S of it, P = P R / S
//! ```
//!
//! The CUSUM is Crosier's for vectors (1988), which on a line is the two-sided one. [`Gated`] runs one filter per light, estimates R from the
//! light's own path and lets go of all lights at once when the whole map changes.

use super::follow::{Follow, PathPoint};
use crate::buffer::{self, Buffer, TooSmall};
use crate::sampler::SamplerKind;
use glam::Vec3;

/// Parameters of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Frames per second.
    pub frame_rate_hz: f32,
    /// Variance that the state gains per second, over the noise's. More follows drift sooner and smooths less.
    pub drift_hz: f32,
    /// Squared step in standard deviations beyond which it is a jump.
    pub gate: f32,
    /// Whether a jump counts only when the next frame confirms it.
    pub confirm: bool,
    /// Sum of clamped steps, less [`SLACK`] each, beyond which a small step persists; infinite for no such test.
    pub alarm: f32,
}

/// What a step in standard deviations may be without adding to the CUSUM: tuned to persistent steps of twice that.
pub const SLACK: f32 = 0.5;

/// Most standard deviations that one frame adds to the CUSUM: an outlier alone raises no alarm.
const CLAMP: f32 = 3.0;

impl Parameters {
    /// For lights on the sphere at ten frames a second. Jumps are confirmed, since noise makes lights at the rim of a lamp hop; what changes
    /// the map as a whole needs no confirmation. The gate is 99.9 % of chi-squared with two degrees of freedom.
    pub const LIGHTS: Self =
        Self { frame_rate_hz: 10.0, drift_hz: 0.5, gate: 13.8, confirm: true, alarm: 5.0 };
}

/// State of one filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kalman {
    /// P.
    variance: f32,
    cusum: Vec3,
    /// The last frame's jump if it was not taken, in standard deviations.
    suspected: Vec3,
    /// Whether the last frame's step was taken whole.
    jumped: bool,
}

impl Kalman {
    /// A filter that has just taken a measurement of variance `noise`.
    #[must_use]
    pub fn at(noise: f32) -> Self {
        Self { variance: noise, ..Self::default() }
    }

    /// The part of `step` to take, 0..=1, under noise of variance `noise` per axis.
    pub fn gain(&mut self, parameters: &Parameters, step: Vec3, noise: f32) -> f32 {
        let variance = self.variance + parameters.drift_hz / parameters.frame_rate_hz * noise;
        let w = step / libm::sqrtf(variance + noise);
        if !w.is_finite() {
            return self.jump(noise);
        }
        let is_drift = self.accumulate(w) > parameters.alarm;
        let exceeds = w.length_squared() > parameters.gate;
        // What moved in the last frame may go on any way.
        let is_confirmed = !parameters.confirm || self.jumped || self.suspected.dot(w) > 0.0;
        if (exceeds && is_confirmed) || is_drift {
            return self.jump(noise);
        }
        (self.suspected, self.jumped) = (if exceeds { w } else { Vec3::ZERO }, false);
        let gain = if exceeds { 0.0 } else { variance / (variance + noise) };
        self.variance = variance * (1.0 - gain);
        gain
    }

    /// Takes a step whole.
    fn jump(&mut self, noise: f32) -> f32 {
        *self = Self { jumped: true, ..Self::at(noise) };
        1.0
    }

    /// Adds a step to the CUSUM; returns its length.
    fn accumulate(&mut self, w: Vec3) -> f32 {
        let sum = self.cusum + w.clamp_length_max(CLAMP);
        let length = (sum.length() - SLACK).max(0.0);
        self.cusum = if length > 0.0 { sum * (length / (length + SLACK)) } else { Vec3::ZERO };
        length
    }
}

/// What [`Gated`] knows of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathFilter {
    kalman: Kalman,
    /// As given out last.
    direction: Vec3,
    colour: [f32; 3],
    /// As measured in the last two frames.
    measured: [Vec3; 2],
    /// Variance of the noise per axis, radians squared, from second differences: what accelerates counts as noise.
    uneven: f32,
    /// Running mean of the product of successive steps over the longer one's square: 1 for even motion, [`NOISE_HEADING`] for noise.
    heading: f32,
    /// Frames that the noise was measured in, at most [`SETTLED`].
    measurements: u8,
}

/// Least noise: lights are not smoothed below 0.006 degrees, which is below visibility.
const LEAST_NOISE: f32 = 1e-8;

/// Frames over which the noise is averaged.
const SETTLED: u8 = 10;

/// The mean product of successive steps of normal noise in the plane, over the longer one's square: each step undoes part of the last.
const NOISE_HEADING: f32 = -0.27;

/// A measurement counts at most this many times the mean: jumps are no noise.
const MOST_NOISE: f32 = 9.0;

impl PathFilter {
    fn begin(seen: PathPoint) -> Self {
        Self {
            kalman: Kalman::at(LEAST_NOISE),
            direction: seen.direction,
            colour: seen.colour,
            measured: [seen.direction; 2],
            uneven: LEAST_NOISE,
            heading: 0.0,
            measurements: 0,
        }
    }

    /// Learns the noise from the second difference of the path, in which steady motion cancels: its variance is six times the noise's.
    fn learn(&mut self, direction: Vec3) {
        let [last, before] = self.measured;
        let (step, step_before) = (direction - last, last - before);
        let found = (step - step_before).length_squared() / (6.0 * 2.0);
        let most = if self.measurements > 3 { MOST_NOISE * self.uneven } else { f32::INFINITY };
        self.measurements = (self.measurements + 1).min(SETTLED);
        let weight = 1.0 / f32::from(self.measurements);
        self.uneven += (found.min(most) - self.uneven) * weight;
        self.uneven = self.uneven.max(LEAST_NOISE);
        let longer = step.length_squared().max(step_before.length_squared());
        let heading = if longer > 0.0 { step.dot(step_before) / longer } else { 0.0 };
        self.heading += (heading - self.heading) * weight;
        self.measured = [direction, last];
    }

    /// Variance of the noise per axis, radians squared: none of what goes on the way it went.
    fn noise(&self) -> f32 {
        (self.uneven * (self.heading / NOISE_HEADING).clamp(0.0, 1.0)).max(LEAST_NOISE)
    }

    fn step(&mut self, parameters: &Parameters, is_jump: bool, seen: PathPoint) {
        let noise = self.noise();
        let step = tangent(self.direction, seen.direction);
        let gain = if is_jump { self.kalman.jump(noise) } else { self.kalman.gain(parameters, step, noise) };
        let moved = self.direction + (seen.direction - self.direction) * gain;
        self.direction = moved.try_normalize().unwrap_or(seen.direction);
        if gain == 1.0 {
            self.direction = seen.direction;
        }
        for (c, new) in self.colour.iter_mut().zip(seen.colour) {
            *c += (new - *c) * gain;
        }
        self.learn(seen.direction);
    }
}

/// The vector in the tangent plane at `from` that leads to `to`, its length the angle; both are unit vectors.
fn tangent(from: Vec3, to: Vec3) -> Vec3 {
    let cos = from.dot(to);
    let across = to - from * cos;
    let sin = across.length();
    if sin > 0.0 { across * (libm::atan2f(sin, cos) / sin) } else { to - from }
}

/// A gated Kalman filter for each light. `T` holds one [`PathFilter`] for each of two slots per light.
#[derive(Clone, Debug)]
pub struct Gated<T> {
    parameters: Parameters,
    tracks: T,
    abrupt: bool,
}

impl<T: Buffer<PathFilter>> Gated<T> {
    /// Takes the memory for `lights` lights.
    ///
    /// # Errors
    /// [`TooSmall`].
    pub fn try_new(parameters: Parameters, lights: usize, tracks: T) -> Result<Self, TooSmall> {
        buffer::check(&tracks, 2 * lights)?;
        Ok(Self { parameters, tracks, abrupt: false })
    }
}

impl<T: Buffer<PathFilter>> Follow for Gated<T> {
    const KIND: SamplerKind = SamplerKind::Hemigon;

    fn slots(&self) -> usize {
        self.tracks.as_ref().len()
    }

    fn begin(&mut self, abrupt: bool) {
        self.abrupt = abrupt;
    }

    fn follow(&mut self, slot: usize, is_new: bool, seen: PathPoint) -> PathPoint {
        let Some(track) = self.tracks.as_mut().get_mut(slot) else { return seen };
        if is_new {
            *track = PathFilter::begin(seen);
        } else {
            track.step(&self.parameters, self.abrupt, seen);
        }
        PathPoint { direction: track.direction, colour: track.colour }
    }

    fn reset(&mut self) {
        self.abrupt = false;
    }
}

#[cfg(test)]
mod tests {
    use super::NOISE_HEADING;
    use core::f64::consts::TAU;
    use glam::DVec2;

    /// A normal point of the plane, by Box and Muller from mixed bits.
    fn point(i: u32) -> DVec2 {
        let mixed = |k: u32| {
            let x = (i.wrapping_mul(4).wrapping_add(k)).wrapping_mul(0x9e37_79b9);
            let x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
            let x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
            (f64::from(x ^ x >> 16) + 0.5) / f64::from(u32::MAX)
        };
        let r = libm::sqrt(-2.0 * libm::log(mixed(0).min(1.0)));
        DVec2::new(r * libm::cos(TAU * mixed(1)), r * libm::sin(TAU * mixed(1)))
    }

    #[test]
    fn successive_steps_of_noise_undo_each_other_by_so_much() {
        const COUNT: u32 = 200_000;
        let heading = |i| {
            let (step, before) = (point(i + 2) - point(i + 1), point(i + 1) - point(i));
            step.dot(before) / step.length_squared().max(before.length_squared())
        };
        let mean = (0..COUNT).map(heading).sum::<f64>() / f64::from(COUNT);
        assert!((mean - f64::from(NOISE_HEADING)).abs() < 0.005, "{mean}");
    }
}
