//! Bursts of frames in memory, and what must be known of the camera to read them.

use hemilux_core::format::{Format, Layout, LayoutError};
use hemilux_core::lens::Lens;
use hemilux_core::merge::{Exposure, Samples};
use hemilux_core::response::Response;

/// What the pipeline knows of the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The lens.
    pub lens: Lens,
    /// Image columns.
    pub width: u32,
    /// Image rows.
    pub height: u32,
    /// Codes to relative exposure.
    pub response: Response,
    /// Radiance of relative exposure 1 at one second and gain 1.
    pub scale: f64,
    /// Code of darkness.
    pub black: f64,
    /// Code of relative exposure 1.
    pub white: f64,
    /// Factors of red, green and blue.
    pub white_balance: [f32; 3],
    /// How samples are packed.
    pub format: Format,
    /// Bytes from one row to the next.
    pub bytes_per_line: usize,
}

impl Calibration {
    /// Size and packing of a frame.
    ///
    /// # Errors
    /// [`LayoutError`].
    pub fn layout(&self) -> Result<Layout, LayoutError> {
        Layout::try_new(self.format, self.width, self.height, self.bytes_per_line)
    }
}

/// Samples of one frame, packed as [`Calibration::format`] says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// The bytes of any format but [`Format::Rgb48`].
    U8(Vec<u8>),
    /// The words of [`Format::Rgb48`].
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
