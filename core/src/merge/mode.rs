//! The exposures that the merge reads.

use super::Exposure;

/// The exposures that the merge reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MergeMode {
    /// All exposures: the least noise.
    #[default]
    All,
    /// In each part of an image row of at most 192 pixels, the longest exposure, and each shorter one down to the first of which no sample
    /// of the part is saturated; exposures of more than a fifth of the burst's whole time are read in any case. The light is that of
    /// [`MergeMode::All`] but for noise and quantisation, since shorter exposures have little weight where a longer one is valid.
    Needed,
}

/// Largest share of the times of a burst that [`MergeMode::Needed`] leaves out: more would add more noise than the time is worth.
const MOST_UNREAD: f64 = 0.2;

/// Number of shorter exposures that may be left out of all `exposures`.
pub(super) fn most_unread(exposures: &[Exposure]) -> usize {
    let all: f64 = exposures.iter().map(|e| e.seconds).sum();
    let mut unread = 0.0;
    let mut shorter = exposures.iter().map(|e| {
        unread += e.seconds;
        unread
    });
    shorter.position(|unread| unread > MOST_UNREAD * all).unwrap_or(0)
}
