//! Frame rates and exposure times for light from lamps on the mains.

use super::fit::fraction;
use super::frequency::Lamps;
use super::window::WINDOW;

/// Least distance of the phases of successive bursts, and of every second burst, periods. With this distance, a fit separates the mean from
/// the modulation within a few bursts.
const LEAST_ADVANCE: f64 = 0.14;
const LEAST_OF_TWO: f64 = 0.14;

/// Longest interval of the period without the phase of one of [`WINDOW`] successive bursts, periods: of the rates that are preferred, and of those
/// that are used without a preferred one. Longer intervals hide the edges of a rectangular modulation. With a seventh of the period, seven
/// successive bursts may record nearly the phases of the seven bursts before.
const LONGEST_GAPS: [f64; 2] = [1.0 / 9.0 + 1e-3, 1.0 / 7.0 + 1e-3];

/// Largest number of frames of a burst that [`best_rate_of_any`] considers.
const MOST_FRAMES: usize = 12;

/// Step of the frame rates that are tried, frames per second, and ratio of the lowest rate to the highest.
const STEP_HZ: f64 = 0.1;
const LOWEST: f64 = 0.85;

/// Returns the highest frame rate, at most `most_hz`, at which bursts of `frames` frames record `lamps` at different phases in successive
/// bursts.
///
/// At 30 frames per second, bursts of three frames record 100 Hz always at the same phase, which no fit can distinguish from steady light.
/// If possible, the phases of sixteen bursts also leave no interval of more than a ninth of the period, or else of more than a seventh. Returns
/// `most_hz` if no rate down to 85 % of it is better.
///
/// ```
/// use hemilux_core::mains::{Lamps, best_rate};
///
/// let rate = best_rate(30.0, 3, Lamps::Auto);
/// assert!((25.5..30.0).contains(&rate));
/// assert_eq!(best_rate(29.3, 3, Lamps::Off), 29.3);
/// ```
#[must_use]
pub fn best_rate(most_hz: f64, frames: usize, lamps: Lamps) -> f64 {
    let of_gap = |most: f64| highest(most_hz, |rate_hz| spreads(rate_hz, frames, lamps, most));
    LONGEST_GAPS.into_iter().chain([1.0]).find_map(of_gap).unwrap_or(most_hz)
}

/// Returns the highest frame rate, at most `most_hz`, at which bursts of 1 to `most_frames` frames (at most twelve) record `lamps` at different
/// phases in successive bursts, so that the number of exposures can change; if no rate down to 85 % of `most_hz` has this property, [`best_rate`]
/// of bursts of one frame.
///
/// ```
/// use hemilux_core::mains::{Lamps, best_rate_of_any};
///
/// assert!((best_rate_of_any(30.0, 4, Lamps::Auto) - 28.0).abs() < 1e-9);
/// ```
#[must_use]
pub fn best_rate_of_any(most_hz: f64, most_frames: usize, lamps: Lamps) -> f64 {
    let [.., most] = LONGEST_GAPS;
    let most_frames = most_frames.min(MOST_FRAMES);
    let suits = |rate_hz: f64| (1..=most_frames).all(|frames| spreads(rate_hz, frames, lamps, most));
    highest(most_hz, suits).unwrap_or_else(|| best_rate(most_hz, 1, lamps))
}

/// Returns the highest rate from `most_hz` down to 85 % of it for which `suits` returns true.
fn highest(most_hz: f64, suits: impl Fn(f64) -> bool) -> Option<f64> {
    if !(most_hz > 0.0 && most_hz.is_finite()) {
        return None;
    }
    let steps = ((1.0 - LOWEST) * most_hz / STEP_HZ).min(1e4) as u32;
    (0..=steps).map(|step| most_hz - STEP_HZ * f64::from(step)).find(|rate_hz| suits(*rate_hz))
}

/// Returns whether bursts of `frames` frames at `rate_hz` record `lamps` at different phases in successive bursts, and in sixteen bursts at phases
/// between which no interval is longer than `most` periods.
fn spreads(rate_hz: f64, frames: usize, lamps: Lamps, most: f64) -> bool {
    let periods = |hz: f64| hz * frames as f64 / rate_hz;
    lamps.frequencies_hz().map(periods).all(|periods| advances(periods) && longest_gap(periods) <= most)
}

/// Returns whether bursts at intervals of `periods` periods of a modulation record the modulation at different phases.
fn advances(periods: f64) -> bool {
    let distance = |turns: f64| libm::fabs(turns - libm::round(turns));
    distance(periods) >= LEAST_ADVANCE && distance(2.0 * periods) >= LEAST_OF_TWO
}

/// Returns the longest interval of a period without the phase of one of [`WINDOW`] successive bursts at intervals of `periods` periods.
fn longest_gap(periods: f64) -> f64 {
    let mut phases: [f64; WINDOW] = core::array::from_fn(|burst| fraction(burst as f64 * periods));
    phases.sort_unstable_by(f64::total_cmp);
    let around = 1.0 - phases[WINDOW - 1] + phases[0];
    phases.windows(2).map(|pair| pair[1] - pair[0]).fold(around, f64::max)
}

/// Returns the longest exposure time, at most `seconds` plus a hundredth of a period, that is a whole number of periods of `lamps`, so that
/// the exposure does not record their flicker. Returns `seconds` if it is shorter than a period, or if `lamps` have several frequencies.
///
/// ```
/// use hemilux_core::mains::{Lamps, whole_periods};
///
/// assert!((whole_periods(0.0333, Lamps::Mains50) - 0.03).abs() < 1e-9);
/// assert!((whole_periods(0.0333, Lamps::Mains60) - 1.0 / 30.0).abs() < 1e-9);
/// assert!((whole_periods(0.032, Lamps::Mains60) - 0.025).abs() < 1e-9);
/// assert_eq!(whole_periods(0.001, Lamps::Mains50), 0.001);
/// ```
#[must_use]
pub fn whole_periods(seconds: f64, lamps: Lamps) -> f64 {
    let mut known = lamps.frequencies_hz();
    let (Some(hz), None) = (known.next(), known.next()) else { return seconds };
    let periods = libm::floor(seconds * hz + 0.01);
    if periods >= 1.0 { periods / hz } else { seconds }
}
