//! Bursts of frames in memory, and the calibration of their camera.

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
    /// The samples as a slice for the core.
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
    /// Exposure of the frame.
    pub exposure: Exposure,
    /// Samples of the frame.
    pub pixels: Pixels,
}

impl Frame {
    /// Exposure time times gain, seconds.
    #[must_use]
    pub fn light(&self) -> f64 {
        self.exposure.seconds * self.exposure.gain
    }
}

/// One set of exposures, ascending by time x gain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Burst {
    /// Frames of the burst, in ascending order of exposure.
    pub frames: Vec<Frame>,
    /// CLOCK_MONOTONIC at which none of its frames had begun to be exposed, nanoseconds; 0 where unknown.
    pub before_ns: u64,
    /// CLOCK_MONOTONIC at its end, nanoseconds; 0 where unknown.
    pub timestamp_ns: u64,
    /// Time of its shortest exposure, which lamps on the mains are seen at: nanoseconds from any origin; 0 where unknown.
    pub phase_ns: u64,
}

impl Burst {
    /// Time of the shortest exposure, seconds from any origin; that of the whole burst where the exposure's is unknown; `None` where both
    /// are.
    #[must_use]
    pub fn phase_s(&self) -> Option<f64> {
        [self.phase_ns, self.timestamp_ns].into_iter().find(|ns| *ns != 0).map(|ns| ns as f64 * 1e-9)
    }
}
