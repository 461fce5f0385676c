//! The least number of exposures that cover the radiances of a scene.

use crate::calibration::Calibration;
use crate::noise::Noise;
use hemilux_core::mains::{Lamps, whole_periods};

/// Largest number of exposures of a plan.
pub const MOST: usize = 6;

/// Least ratio of the signal of a covered sample to its standard deviation.
const LEAST_RATIO: f64 = 5.0;

/// Distance of the radiances from the limits of new exposures, in standard deviations of a sample.
const MARGIN: f64 = 3.0;

/// Fraction of the pixels, the darkest ones, that exposures need not cover, 0 to 1.
const DARKEST: f64 = 0.02;

/// Relative code from which a sample counts as saturated: lower than in the merge, so that covered radiances are not clipped.
const SATURATED: f64 = 0.93;

/// The range of a camera's exposure times, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeRange {
    /// Shortest exposure time that a plan may contain, seconds.
    pub shortest_s: f64,
    /// Longest exposure time at the frame rate, seconds.
    pub longest_s: f64,
    /// Difference of two successive exposure times, which are multiples of it, seconds; 0 for a camera that accepts any time of the range.
    pub step_s: f64,
}

impl TimeRange {
    /// Returns the longest exposure time of the camera that is not longer than `seconds`.
    fn within(&self, seconds: f64) -> f64 {
        let seconds = seconds.clamp(self.shortest_s, self.longest_s);
        if self.step_s > 0.0 && seconds < self.longest_s {
            return ((seconds / self.step_s + ROUNDING).floor() * self.step_s).max(self.shortest_s);
        }
        seconds
    }

    /// Returns this range with the longest time reduced to a whole number of periods of `lamps`, if a period fits.
    #[must_use]
    pub fn of_whole_periods(&self, lamps: Lamps) -> Self {
        Self { longest_s: whole_periods(self.longest_s, lamps).max(self.shortest_s), ..*self }
    }
}

/// Fraction of a step by which an exposure time may miss a multiple of the step because of rounding.
const ROUNDING: f64 = 1e-6;

/// The range of relative exposures, 0 to 1, in which a sample is covered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The least relative exposure of a covered sample: `LEAST_RATIO` times its standard deviation, and trusted by the merge.
    pub dark: f64,
    /// The largest relative exposure of a covered sample, below saturation.
    pub bright: f64,
    /// The factors by which `dark` is raised and `bright` is lowered in the limits for new exposures.
    margins: [f64; 2],
}

impl Limits {
    /// Returns the limits of a camera whose samples have `noise`, in codes.
    #[must_use]
    pub fn of(calibration: &Calibration, noise: &Noise) -> Self {
        use hemilux_core::Response;
        use hemilux_core::response::TRUSTED;
        let codes = calibration.levels.white - calibration.levels.black;
        let y = |x: f64| calibration.response.exposure(1, x);
        let by_noise = y(noise.codes_at(LEAST_RATIO) / codes);
        let trusted = if calibration.response == Response::Linear { 0.0 } else { y(TRUSTED) };
        let bright = y(SATURATED);
        let at_bright = MARGIN * noise.deviation(SATURATED * codes) / (SATURATED * codes);
        let margins = [1.0 + MARGIN / LEAST_RATIO, 1.0 / (1.0 + at_bright)];
        Self { dark: by_noise.max(trusted), bright, margins }
    }

    /// Returns the limits for new exposures, narrowed by the margins.
    #[must_use]
    pub fn narrowed(&self) -> Self {
        let [dark, bright] = self.margins;
        let narrowed = Self { dark: self.dark * dark, bright: self.bright * bright, ..*self };
        if narrowed.dark < narrowed.bright { narrowed } else { *self }
    }
}

/// A radiance of the scene and the fraction of the pixels that have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadianceShare {
    /// Radiance of the pixels of the share: relative exposure per second.
    pub radiance: f64,
    /// Fraction of the pixels, 0 to 1.
    pub share: f64,
}

/// Returns those radiances of `light`, brightest first, that exposures must cover: all but the radiances of the darkest pixels.
fn to_cover(light: &[RadianceShare]) -> impl Iterator<Item = f64> + '_ {
    let mut before = 0.0;
    let needed = light.iter().take_while(move |l| {
        let is_needed = before < 1.0 - DARKEST;
        before += l.share;
        is_needed
    });
    needed.map(|l| l.radiance)
}

/// Returns the least set of exposure times, seconds, ascending, at most [`MOST`], that cover `light`, whose radiances are descending.
/// Radiances that are too bright for the shortest or too dark for the longest time of `range` count as covered by that time.
#[must_use]
pub fn cover(light: &[RadianceShare], limits: &Limits, range: &TimeRange) -> Vec<f64> {
    let mut times: Vec<f64> = Vec::with_capacity(MOST);
    for radiance in to_cover(light) {
        let is_covered = |t: &f64| radiance * t >= limits.dark || *t >= range.longest_s;
        if times.last().is_some_and(is_covered) || times.len() == MOST {
            continue;
        }
        let next = range.within(limits.bright / radiance);
        if times.last().is_none_or(|last| next > *last) {
            times.push(next);
        }
    }
    times
}

/// Returns true if the exposure times `times`, ascending, cover `light`, whose radiances are descending.
#[must_use]
pub fn is_covered(light: &[RadianceShare], times: &[f64], limits: &Limits, range: &TimeRange) -> bool {
    let by = |radiance: f64, t: f64| {
        let y = radiance * t;
        let not_dark = y >= limits.dark || t >= range.longest_s * (1.0 - 1e-9);
        let not_bright = y <= limits.bright * (1.0 + 1e-9) || t <= range.shortest_s * (1.0 + 1e-9);
        not_dark && not_bright
    };
    to_cover(light).all(|radiance| times.iter().any(|t| by(radiance, *t)))
}
