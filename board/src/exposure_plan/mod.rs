//! Plans the exposures of the next bursts from the radiances of the last burst: the fewest that cover the scene.
//!
//! An exposure covers a sample if its code lies between a noise limit and saturation. The radiances that one exposure covers are an interval of
//! constant ratio, so that the fewest exposures are found from the brightest radiance down (`cover`). Radiances beyond the range of the last
//! burst are unknown: their whole possible range is covered in the next burst, which measures them.

mod cover;
mod histogram;
#[cfg(test)]
mod tests;

pub use cover::{Limits, MOST, TimeRange, cover, is_covered};
pub use histogram::{BINS_PER_OCTAVE, Histogram};

use crate::calibration::{Burst, Calibration};
use crate::noise::Noise;
use histogram::RadianceReader;

/// Number of bursts for which exposures cover a clipped spot that was found between the sampled pixels.
const HOLD: u32 = 300;

/// A clipped spot of a burst that lies between the sampled pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Hidden {
    radiance: f64,
    /// Number of further bursts for which exposures cover the spot.
    left: u32,
}

/// Plans the exposures of the bursts of one camera, one burst after the other.
#[derive(Clone, Debug)]
pub struct Planner {
    range: TimeRange,
    limits: Limits,
    reader: RadianceReader,
    histogram: Histogram,
    hidden: Hidden,
}

impl Planner {
    /// Creates a planner for a camera of `calibration` with exposure times within `range`; `None` if the response of `calibration` is
    /// invalid.
    #[must_use]
    pub fn new(calibration: &Calibration, range: TimeRange, noise: &Noise) -> Option<Self> {
        let limits = Limits::of(calibration, noise);
        let reader = RadianceReader::new(calibration)?;
        Some(Self { range, limits, reader, histogram: Histogram::default(), hidden: Hidden::default() })
    }

    /// Returns the exposure times, seconds, ascending, of the bursts after `burst`, in which the fraction `clipped` of the light was clipped;
    /// `None` if the exposures do not change.
    pub fn next(&mut self, burst: &Burst, clipped: f64) -> Option<Vec<f64>> {
        self.reader.read(burst, &self.limits, &mut self.histogram);
        let current: Vec<f64> = burst.frames.iter().map(|frame| frame.exposure.seconds).collect();
        self.hidden.left = self.hidden.left.saturating_sub(1);
        if clipped > 0.0 && !self.histogram.has_unknown_above() {
            // The spot's radiance is unknown, except that it is above the range of the shortest exposure.
            let least = self.limits.bright / current.first().copied().unwrap_or(self.range.shortest_s);
            self.hidden = Hidden { radiance: 4.0 * least, left: HOLD };
        }
        if self.hidden.left > 0 {
            self.histogram.add(self.hidden.radiance);
        }
        decide(&current, &self.histogram, &self.limits, &self.range)
    }
}

/// Returns the exposure times that replace `current`; `None` if the exposures do not change.
///
/// New times are chosen with limits that are narrower by three standard deviations of a sample. Present times are kept while they cover the scene
/// with the full limits and no smaller number is enough, so that noise causes no change.
#[must_use]
pub fn decide(
    current: &[f64],
    histogram: &Histogram,
    limits: &Limits,
    range: &TimeRange,
) -> Option<Vec<f64>> {
    let light = histogram.light(range);
    let wished = cover(&light, &limits.narrowed(), range);
    let fits = current.last().is_some_and(|longest| *longest <= range.longest_s * (1.0 + 1e-3));
    let stays = fits && current.len() <= wished.len() && is_covered(&light, current, limits, range);
    (!stays && !wished.is_empty() && wished != current).then_some(wished)
}
