//! Bursts of frames in memory, and what must be known of the camera to read them.

use hemilux_core::{Exposure, Samples};

pub use hemilux_core::Calibration;

/// Samples of one frame, packed as [`Calibration::layout`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// The bytes of any format but [`Format::Rgb48`](hemilux_core::Format::Rgb48).
    U8(Vec<u8>),
    /// The words of [`Format::Rgb48`](hemilux_core::Format::Rgb48).
    U16(Vec<u16>),
}

impl Pixels {
    /// As the core reads them.
    #[must_use]
    pub fn samples(&self) -> Samples<'_> {
        match self {
            Self::U8(v) => Samples::U8(v),
            Self::U16(v) => Samples::U16(v),
        }
    }
}

/// One captured image.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Its exposure.
    pub exposure: Exposure,
    /// Its samples.
    pub pixels: Pixels,
}

/// One set of exposures, ascending by time x gain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Burst {
    /// The frames.
    pub frames: Vec<Frame>,
    /// CLOCK_MONOTONIC at which none of its frames had begun to be exposed, nanoseconds; 0 where unknown.
    pub before_ns: u64,
    /// CLOCK_MONOTONIC at its end, nanoseconds; 0 where unknown.
    pub timestamp_ns: u64,
}
