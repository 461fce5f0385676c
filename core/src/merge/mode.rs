//! The choice of the exposures that the merge reads.

use super::Exposure;

/// The choice of the exposures of a burst that the merge reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MergeMode {
    /// All exposures are read, which gives the least noise.
    #[default]
    All,
    /// In each part of an image row of at most 192 pixels, the exposures are read from the longest down to the first in which no sample of
    /// the part is saturated, and at least as many as hold 80 % of the burst's whole exposure time. The radiance differs from that of
    /// [`MergeMode::All`] by noise and quantisation only, since shorter exposures have little weight where a longer one is valid.
    Needed,
}

/// Largest fraction of the burst's whole exposure time that [`MergeMode::Needed`] does not read: leaving more unread would add more noise
/// than reading costs.
const MOST_UNREAD: f64 = 0.2;

/// Returns the number of the shortest exposures that may be left unread.
pub(super) fn most_unread(exposures: &[Exposure]) -> usize {
    let all: f64 = exposures.iter().map(|e| e.seconds).sum();
    let mut unread = 0.0;
    let mut shorter = exposures.iter().map(|e| {
        unread += e.seconds;
        unread
    });
    shorter.position(|unread| unread > MOST_UNREAD * all).unwrap_or(0)
}
