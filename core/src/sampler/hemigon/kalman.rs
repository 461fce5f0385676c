//! The filter of `hemigon`: a Kalman filter of a random walk that smooths noise and follows abrupt changes without delay.
//!
//! For each measurement, [`Kalman`] computes the gain: the fraction of the step (measured minus filtered) by which the filtered value moves.
//! P is the variance of the state, R that of the noise and Q = drift R that of the walk per frame:
//!
//! ```text
//! P += Q;  S = P + R;  w = step / sqrt(S)
//! |w|^2 > gate:          a jump: gain 1, P = R; with `confirm`, gain 0 unless the last frame jumped
//!                        or made a step beyond the gate in the same direction
//! |CUSUM of w| > alarm:  a small persistent step: gain 1, P = R
//! otherwise:             gain P / S, then P = P R / S
//! ```
//!
//! The CUSUM is Crosier's multivariate CUSUM (1988), which in one dimension is the two-sided CUSUM. [`Gated`] runs one filter per light,
//! estimates R from the path of the light, and uses gain 1 for every light after an abrupt change of the map.
//!
//! ```
//! use glam::Vec3;
//! use hemilux_core::sampler::hemigon::kalman::{Kalman, Parameters};
//!
//! let parameters = Parameters { confirm: false, ..Parameters::LIGHTS };
//! let mut filter = Kalman::at(1e-4);
// A step of 0.1 standard deviations is smoothed; a step of 10 standard deviations has gain 1.
//! let gain = filter.gain(&parameters, Vec3::X * 1e-3, 1e-4);
//! assert!(gain > 0.3 && gain < 0.7);
//! assert_eq!(filter.gain(&parameters, Vec3::X * 0.1, 1e-4), 1.0);
//! ```

use super::follow::{Follow, PathPoint};
use crate::buffer::{self, Buffer, TooSmall};
use crate::sampler::SamplerKind;
use glam::Vec3;

/// Parameters of the Kalman filter of a light's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Assumed frame rate, frames per second.
    pub frame_rate_hz: f32,
    /// Variance per second of the random walk of the state, relative to the variance of the noise. A higher value follows drift faster and
    /// smooths less.
    pub drift_hz: f32,
    /// Squared step, in standard deviations, above which the step is a jump.
    pub gate: f32,
    /// Whether a jump gets the gain 1 only after the next frame has confirmed it.
    pub confirm: bool,
    /// CUSUM of the steps above which a small step counts as persistent; infinite to disable the test. Each step is clamped and reduced by
    /// [`SLACK`].
    pub alarm: f32,
}

/// Step in standard deviations that does not raise the CUSUM: the test is tuned to persistent steps of twice this size.
pub const SLACK: f32 = 0.5;

/// Limit of the standard deviations that one frame adds to the CUSUM: a single outlier raises no alarm.
const CLAMP: f32 = 3.0;

impl Parameters {
    /// Parameters for lights at ten frames per second. Jumps are confirmed, since noise moves lights between the edges of a lamp; an
    /// abrupt change of the whole map needs no confirmation. The gate is the 99.9 % quantile of chi-squared with two degrees of freedom.
    pub const LIGHTS: Self =
        Self { frame_rate_hz: 10.0, drift_hz: 0.5, gate: 13.8, confirm: true, alarm: 5.0 };
}

/// State of the Kalman filter of one value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kalman {
    /// Variance P of the error of the filtered value.
    variance: f32,
    cusum: Vec3,
    /// The jump of the last frame, in standard deviations, while it is not confirmed; otherwise 0.
    suspected: Vec3,
    /// Whether the gain of the last frame was that of a jump.
    jumped: bool,
}

impl Kalman {
    /// Creates the state after a first measurement of variance `noise`.
    #[must_use]
    pub fn at(noise: f32) -> Self {
        Self { variance: noise, ..Self::default() }
    }

    /// Computes the gain, 0..=1, for the step `step` under noise of variance `noise` per axis, and updates the state.
    pub fn gain(&mut self, parameters: &Parameters, step: Vec3, noise: f32) -> f32 {
        let variance = self.variance + parameters.drift_hz / parameters.frame_rate_hz * noise;
        let w = step / libm::sqrtf(variance + noise);
        if !w.is_finite() {
            return self.jump(noise);
        }
        let is_drift = self.accumulate(w) > parameters.alarm;
        let exceeds = w.length_squared() > parameters.gate;
        // After a jump, a further step in any direction needs no confirmation.
        let is_confirmed = !parameters.confirm || self.jumped || self.suspected.dot(w) > 0.0;
        if (exceeds && is_confirmed) || is_drift {
            return self.jump(noise);
        }
        (self.suspected, self.jumped) = (if exceeds { w } else { Vec3::ZERO }, false);
        let gain = if exceeds { 0.0 } else { variance / (variance + noise) };
        self.variance = variance * (1.0 - gain);
        gain
    }

    /// Resets the variance to that of one measurement and returns a gain of 1.
    fn jump(&mut self, noise: f32) -> f32 {
        *self = Self { jumped: true, ..Self::at(noise) };
        1.0
    }

    /// Adds the step `w` to the CUSUM; returns the length of the CUSUM.
    fn accumulate(&mut self, w: Vec3) -> f32 {
        let sum = self.cusum + w.clamp_length_max(CLAMP);
        let length = (sum.length() - SLACK).max(0.0);
        self.cusum = if length > 0.0 { sum * (length / (length + SLACK)) } else { Vec3::ZERO };
        length
    }
}

/// The filter state of one light of [`Gated`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathFilter {
    kalman: Kalman,
    /// Filtered direction of the light in the last frame.
    direction: Vec3,
    colour: [f32; 3],
    /// Measured directions of the light in the last two frames.
    measured: [Vec3; 2],
    /// Variance of the noise per axis, radians squared, estimated from second differences; acceleration counts as noise.
    uneven: f32,
    /// Running mean of the scalar product of successive steps, divided by the square of the longer one: 1 for uniform motion,
    /// [`NOISE_HEADING`] for noise.
    heading: f32,
    /// Number of frames that the noise estimate contains, at most [`SETTLED`].
    measurements: u8,
}

/// Least variance of the noise per axis that the filter assumes, radians squared: a standard deviation of 0.006 degrees, which is
/// invisible.
const LEAST_NOISE: f32 = 1e-8;

/// Number of frames over which the noise estimate is averaged.
const SETTLED: u8 = 10;

/// Mean of the scalar product of successive steps, divided by the square of the longer one, for normal noise in the plane: each step
/// partly undoes the last.
const NOISE_HEADING: f32 = -0.27;

/// Limit of a squared second difference that enters the noise estimate, relative to the estimate, so that jumps do not count as noise.
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

    /// Updates the noise estimate from the second difference of the path, in which uniform motion cancels; the variance of the second
    /// difference is six times the variance of the noise.
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

    /// Returns the variance of the noise per axis, radians squared; steps that continue the last step do not count as noise.
    fn noise(&self) -> f32 {
        (self.uneven * (self.heading / NOISE_HEADING).clamp(0.0, 1.0)).max(LEAST_NOISE)
    }

    /// Moves the filtered direction and colour towards the measurement `seen`; with `is_jump`, the gain is 1, so that both equal the measurement.
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

/// Returns the tangent vector at the unit vector `from` towards the unit vector `to`; its length is the angle between them, radians.
fn tangent(from: Vec3, to: Vec3) -> Vec3 {
    let cos = from.dot(to);
    let across = to - from * cos;
    let sin = across.length();
    if sin > 0.0 { across * (libm::atan2f(sin, cos) / sin) } else { to - from }
}

/// The filter of `hemigon`: a gated Kalman filter per light. The buffer `T` holds two [`PathFilter`]s per light, one for each slot of the
/// light.
#[derive(Clone, Debug)]
pub struct Gated<T> {
    parameters: Parameters,
    filters: T,
    abrupt: bool,
}

impl<T: Buffer<PathFilter>> Gated<T> {
    /// Creates the filter for a sampler with `lights` lights; `filters` needs two elements per light.
    ///
    /// # Errors
    /// [`TooSmall`] if `filters` has too few elements.
    pub fn try_new(parameters: Parameters, lights: usize, filters: T) -> Result<Self, TooSmall> {
        buffer::check(&filters, 2 * lights)?;
        Ok(Self { parameters, filters, abrupt: false })
    }
}

impl<T: Buffer<PathFilter>> Follow for Gated<T> {
    const KIND: SamplerKind = SamplerKind::Hemigon;

    fn slots(&self) -> usize {
        self.filters.as_ref().len()
    }

    fn begin(&mut self, abrupt: bool) {
        self.abrupt = abrupt;
    }

    fn follow(&mut self, slot: usize, is_new: bool, seen: PathPoint) -> PathPoint {
        let Some(filter) = self.filters.as_mut().get_mut(slot) else { return seen };
        if is_new {
            *filter = PathFilter::begin(seen);
        } else {
            filter.step(&self.parameters, self.abrupt, seen);
        }
        PathPoint { direction: filter.direction, colour: filter.colour }
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

    /// Returns a normally distributed point of the plane, by the method of Box and Muller from hashed bits.
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
    fn noise_heading_is_the_mean_over_normal_noise() {
        const COUNT: u32 = 200_000;
        let heading = |i| {
            let (step, before) = (point(i + 2) - point(i + 1), point(i + 1) - point(i));
            step.dot(before) / step.length_squared().max(before.length_squared())
        };
        let mean = (0..COUNT).map(heading).sum::<f64>() / f64::from(COUNT);
        assert!((mean - f64::from(NOISE_HEADING)).abs() < 0.005, "{mean}");
    }
}
