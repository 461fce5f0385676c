//! What is known of a camera: the description from which the front end is made.

use crate::buffer::Buffer;
use crate::format::{Format, Layout, LayoutError};
use crate::lens::Lens;
use crate::response::{Curve, Levels, Response, ResponseError};

/// Lens, sensor and packing of one camera in one mode.
///
/// ```
/// use hemilux_core::{Calibration, Format, Lens, Levels};
///
/// let lens = Lens::equidistant([319.5, 239.5], 196.4, 1.4)?;
/// let mut calibration = Calibration::try_new(lens, Format::Rgb24, 640, 480)?;
/// calibration.levels = Levels { black: 16.0, white: 255.0 };
/// assert_eq!(calibration.layout.frame_bytes(), 3 * 640 * 480);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Calibration {
    /// The lens, in pixels of the full image, whatever the format.
    pub lens: Lens,
    /// Size and packing of a frame.
    pub layout: Layout,
    /// Codes to relative exposure; linear unless changed.
    pub response: Response,
    /// Black and white level; 0 and the format's largest code unless changed.
    pub levels: Levels,
    /// Radiance of relative exposure 1 at one second and gain 1; 1 unless changed.
    pub scale: f64,
    /// Factors of red, green and blue; 1 unless changed.
    pub white_balance: [f32; 3],
}

impl Calibration {
    /// A linear camera of scale 1 whose frames lie as `layout` says.
    #[must_use]
    pub fn new(lens: Lens, layout: Layout) -> Self {
        let levels = Levels { black: 0.0, white: f64::from(layout.format().max_code()) };
        Self { lens, layout, response: Response::Linear, levels, scale: 1.0, white_balance: [1.0; 3] }
    }

    /// A linear camera of scale 1 whose rows have no padding.
    ///
    /// # Errors
    /// [`LayoutError`]: a size that the format cannot have.
    pub fn try_new(lens: Lens, format: Format, width: u32, height: u32) -> Result<Self, LayoutError> {
        Layout::tight(format, width, height).map(|layout| Self::new(lens, layout))
    }

    /// The lens in pixels of the merged image ([`Layout::merged_size`]).
    pub(crate) fn merged_lens(&self) -> Lens {
        if self.layout.format().pattern().is_some() { self.lens.halved() } else { self.lens }
    }

    /// The response curve in the form that suits the format, without its table.
    ///
    /// # Errors
    /// [`ResponseError::BadLevels`].
    pub(crate) fn untabulated(&self) -> Result<Curve<()>, ResponseError> {
        let curve = Curve::untabulated(&self.response, self.layout.format().depth(), self.levels)?;
        Ok(self.in_form(curve))
    }

    /// The response curve in the form that suits the format.
    ///
    /// # Errors
    /// [`ResponseError`].
    pub(crate) fn curve<B: Buffer<i32>>(&self, table: B) -> Result<Curve<B>, ResponseError> {
        let curve = Curve::try_new(&self.response, self.layout.format().depth(), self.levels, table)?;
        Ok(self.in_form(curve))
    }

    /// Codes that are computed from luma and chroma come plane by plane, which tables read and the linear loop does not.
    fn in_form<B>(&self, curve: Curve<B>) -> Curve<B> {
        let has_chroma = matches!(self.layout.format(), Format::Yuyv(_) | Format::Nv12(_));
        if has_chroma { curve.looked_up() } else { curve }
    }
}
