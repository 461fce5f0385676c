//! The exposures of a burst and their checks.

use crate::buffer::TooSmall;

/// Largest number of exposures in a burst.
pub const MAX_EXPOSURES: usize = 12;

/// Time and gain of one exposure of a burst.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Exposure {
    /// Exposure time of the frame, seconds.
    pub seconds: f64,
    /// Sensor gain, relative to the gain at which the calibration's scale was measured.
    pub gain: f64,
}

/// The reason why a set of exposures cannot be merged.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MergeError {
    /// There are no exposures, or more than [`MAX_EXPOSURES`].
    BadCount {
        /// Number of exposures in the refused list.
        found: usize,
    },
    /// An exposure time or gain is not a positive finite number.
    BadExposure {
        /// Index of the exposure in the burst.
        index: usize,
    },
    /// The exposures do not ascend by time x gain.
    NotAscending {
        /// Index of the first exposure with a lower time x gain than its predecessor.
        index: usize,
    },
    /// The radiance scale is not a positive finite number.
    BadScale,
    /// Two exposure times or gains have a ratio above 2^24, the range of 32-bit radiance.
    TooFarApart,
    /// A lent buffer has too few elements.
    TooSmall(TooSmall),
}

impl core::fmt::Display for MergeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BadCount { found } => write!(f, "{found} exposures, expected 1 to {MAX_EXPOSURES}"),
            Self::BadExposure { index } => {
                write!(f, "exposure {index} without a positive exposure time and gain")
            }
            Self::NotAscending { index } => write!(f, "exposure {index} shorter than the one before it"),
            Self::BadScale => write!(f, "a radiance scale that is not a positive number"),
            Self::TooFarApart => write!(f, "exposures further apart than 1 : 16777216"),
            Self::TooSmall(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for MergeError {}

/// Checks number, sign, order and range of the exposures of a burst.
pub(super) fn check(exposures: &[Exposure]) -> Result<(), MergeError> {
    let count = exposures.len();
    if !(1..=MAX_EXPOSURES).contains(&count) {
        return Err(MergeError::BadCount { found: count });
    }
    let sound = |v: f64| v > 0.0 && v.is_finite();
    if let Some(index) = exposures.iter().position(|e| !sound(e.seconds) || !sound(e.gain)) {
        return Err(MergeError::BadExposure { index });
    }
    let light = |e: &Exposure| e.seconds * e.gain;
    if let Some(index) = exposures.windows(2).position(|w| light(&w[1]) < light(&w[0])) {
        return Err(MergeError::NotAscending { index: index + 1 });
    }
    let range = |f: fn(&Exposure) -> f64| {
        let (low, high) =
            exposures.iter().map(f).fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        high / low
    };
    let widest = range(|e| e.seconds).max(range(|e| e.gain));
    if widest > f64::from(1u32 << 24) { Err(MergeError::TooFarApart) } else { Ok(()) }
}
