//! Chooses the exposures of the next bursts from the light of the last one: as few as cover what the scene shows.
//!
//! A sample is covered by an exposure in which its code lies between the limit of its noise and saturation. The radiances that one exposure
//! covers are an interval of constant ratio, so that the fewest exposures are found from the brightest radiance down (`cover`). Radiances
//! beyond what the last burst could measure are unknown: all of them are covered in the next burst, which measures them.

mod cover;
mod histogram;
#[cfg(test)]
mod tests;

pub use cover::{Limits, MOST, TimeRange, cover, is_covered};
pub use histogram::{BINS_PER_OCTAVE, Histogram};

use crate::calibration::{Burst, Calibration};
use crate::noise::Noise;
use histogram::Reader;

/// Bursts for which a bright spot between the pixels that are read is remembered.
const HOLD: u32 = 300;

/// A spot that clipped but lies between the pixels that are read.
#[derive(Clone, Copy, Debug, Default)]
struct Hidden {
    radiance: f64,
    /// Bursts until it is forgotten.
    left: u32,
}

/// Follows the light of one camera with its exposures.
#[derive(Clone, Debug)]
pub struct Planner {
    range: TimeRange,
    limits: Limits,
    reader: Reader,
    histogram: Histogram,
    hidden: Hidden,
}

impl Planner {
    /// A planner for a camera of `calibration` that takes exposures within `range`; `None` if its response cannot be tabulated.
    #[must_use]
    pub fn new(calibration: &Calibration, range: TimeRange, noise: &Noise) -> Option<Self> {
        let limits = Limits::of(calibration, noise);
        let reader = Reader::new(calibration)?;
        Some(Self { range, limits, reader, histogram: Histogram::default(), hidden: Hidden::default() })
    }

    /// The exposure times, seconds, ascending, of the coming bursts after `burst`, in which the share `clipped` of the light was clipped;
    /// `None` if those of `burst` are to stay.
    pub fn next(&mut self, burst: &Burst, clipped: f64) -> Option<Vec<f64>> {
        self.reader.read(burst, &self.limits, &mut self.histogram);
        let current: Vec<f64> = burst.frames.iter().map(|frame| frame.exposure.seconds).collect();
        self.hidden.left = self.hidden.left.saturating_sub(1);
        if clipped > 0.0 && !self.histogram.has_unknown_above() {
            // Nothing is known of the spot but that it is brighter.
            let least = self.limits.bright / current.first().copied().unwrap_or(self.range.shortest_s);
            self.hidden = Hidden { radiance: 4.0 * least, left: HOLD };
        }
        if self.hidden.left > 0 {
            self.histogram.add(self.hidden.radiance);
        }
        decide(&current, &self.histogram, &self.limits, &self.range)
    }
}

/// The exposure times that replace `current`; `None` if these are to stay.
///
/// New times are chosen with limits that are narrower by three standard deviations of a sample; times in use are kept as long as they cover
/// the scene with the full limits and no fewer are enough, so that noise changes nothing.
#[must_use]
pub fn decide(
    current: &[f64],
    histogram: &Histogram,
    limits: &Limits,
    range: &TimeRange,
) -> Option<Vec<f64>> {
    let light = histogram.light(range);
    let wished = cover(&light, &limits.narrowed(), range);
    let stays = current.len() <= wished.len() && is_covered(&light, current, limits, range);
    (!stays && !wished.is_empty() && wished != current).then_some(wished)
}
