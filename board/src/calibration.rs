//! Bursts of frames in memory, and the calibration of their camera.

use hemilux_core::{Exposure, Samples};

pub use hemilux_core::Calibration;

/// Samples of one frame, packed as [`Calibration::layout`] describes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// The bytes of any format but [`Format::Rgb48`](hemilux_core::Format::Rgb48).
    U8(Vec<u8>),
    /// Samples of 16 bits: the words of [`Format::Rgb48`](hemilux_core::Format::Rgb48).
    U16(Vec<u16>),
}

impl Pixels {
    /// Returns the samples as a borrowed slice for the core.
    #[must_use]
    pub fn samples(&self) -> Samples<'_> {
        match self {
            Self::U8(v) => Samples::U8(v),
            Self::U16(v) => Samples::U16(v),
        }
    }
}

/// One captured image of a burst, with its exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Exposure time of the frame, seconds, and its gain.
    pub exposure: Exposure,
    /// Samples of the frame.
    pub pixels: Pixels,
}

impl Frame {
    /// Returns exposure time times gain of the frame, seconds.
    #[must_use]
    pub fn light(&self) -> f64 {
        self.exposure.seconds * self.exposure.gain
    }
}

/// Frames of one scene with different exposures, ascending by time times gain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Burst {
    /// Frames of the burst, in ascending order of exposure time times gain.
    pub frames: Vec<Frame>,
    /// CLOCK_MONOTONIC at a time before the exposure of the first frame began, nanoseconds; 0 where unknown.
    pub before_ns: u64,
    /// CLOCK_MONOTONIC at the end of the burst, nanoseconds; 0 where unknown.
    pub timestamp_ns: u64,
    /// Time of the shortest exposure of the burst, nanoseconds from any origin; 0 where unknown. It determines the phase of lamps on the
    /// mains.
    pub phase_ns: u64,
    /// One bit for each frame, by its index: set if the frame was part of the burst that was processed last. A burst that is not processed
    /// leaves the bits of its new frames cleared. 0 for a burst of new frames.
    pub stale: u16,
}

impl Burst {
    /// Whether the frame `index` was not part of the burst that was processed last.
    #[must_use]
    pub fn is_new(&self, index: usize) -> bool {
        self.stale >> (index & 15) & 1 == 0
    }

    /// Declares the frame `index` new.
    pub fn renew(&mut self, index: usize) {
        self.stale &= !(1 << (index & 15));
    }

    /// Returns the time of the shortest exposure, seconds from any origin; the time of the burst's end where the exposure's is unknown;
    /// `None` where both are unknown.
    #[must_use]
    pub fn phase_s(&self) -> Option<f64> {
        [self.phase_ns, self.timestamp_ns].into_iter().find(|ns| *ns != 0).map(|ns| ns as f64 * 1e-9)
    }
}
