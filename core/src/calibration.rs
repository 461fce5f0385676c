//! The description of a camera from which a front end is created.

use crate::buffer::Buffer;
use crate::format::{Format, Layout, LayoutError};
use crate::lens::Lens;
use crate::response::{Curve, Levels, Response, ResponseError};

/// Lens, frame layout, response and scale of one camera in one mode.
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
    /// The lens of the camera, in pixels of the frame, also for mosaic formats.
    pub lens: Lens,
    /// Format, size and row pitch of the camera's frames.
    pub layout: Layout,
    /// Conversion of the camera's codes to relative exposure; [`Response::Linear`] by default. Cameras that process their images, such as
    /// webcams, need [`Response::Srgb`] or a measured [`Response::Polynomial`].
    pub response: Response,
    /// Codes of black and white; 0 and the largest code of the format by default. For [`Format::Yuyv`] and [`Format::Nv12`], the levels are
    /// codes of red, green and blue after the conversion from luma and chroma, 0 to 255 for both ranges of luma.
    pub levels: Levels,
    /// Radiance that gives relative exposure 1 in one second at gain 1; 1 by default.
    pub scale: f64,
    /// Factors by which red, green and blue radiance are multiplied; 1 by default.
    pub white_balance: [f32; 3],
    /// Whether the camera compresses its codes with loss, as in JPEG images: the merge then ignores more of the codes near black and white.
    pub compressed: bool,
}

impl Calibration {
    /// Creates the calibration of a camera with linear response and scale 1, whose frames have the given `layout`.
    #[must_use]
    pub fn new(lens: Lens, layout: Layout) -> Self {
        let levels = Levels { black: 0.0, white: f64::from(layout.format().max_code()) };
        Self {
            lens,
            layout,
            response: Response::Linear,
            levels,
            scale: 1.0,
            white_balance: [1.0; 3],
            compressed: false,
        }
    }

    /// Creates the calibration of a camera with linear response and scale 1, whose frames have `width` x `height` pixels and rows without
    /// padding.
    ///
    /// # Errors
    /// [`LayoutError`] for a size that the format cannot have.
    pub fn try_new(lens: Lens, format: Format, width: u32, height: u32) -> Result<Self, LayoutError> {
        Layout::tight(format, width, height).map(|layout| Self::new(lens, layout))
    }

    /// Returns the lens in pixels of the merged image ([`Layout::merged_size`]).
    pub(crate) fn merged_lens(&self) -> Lens {
        let halvings = if self.layout.format().pattern().is_some() { 1 + self.layout.bin_log2() } else { 0 };
        (0..halvings).fold(self.lens, |lens, _| lens.halved())
    }

    /// Returns the response curve without its table, marked for table lookup or for the linear loop as the format requires.
    ///
    /// # Errors
    /// [`ResponseError::BadLevels`] for levels that do not ascend or exceed the samples.
    pub(crate) fn untabulated(&self) -> Result<Curve<()>, ResponseError> {
        let curve = Curve::untabulated(&self.response, self.layout.format().depth(), self.levels)?;
        Ok(self.in_form(curve))
    }

    /// Returns the response curve, marked for table lookup or for the linear loop as the format requires, with its table in `table`.
    ///
    /// # Errors
    /// [`ResponseError`] for invalid levels, a curve that is not monotone, and a table with too few elements.
    pub(crate) fn curve<B: Buffer<i32>>(&self, table: B) -> Result<Curve<B>, ResponseError> {
        let curve = Curve::try_new(&self.response, self.layout.format().depth(), self.levels, table)?;
        Ok(self.in_form(curve))
    }

    /// Returns `curve`, marked for table lookup if the format has chroma (codes of chroma formats are converted to planes, which the linear
    /// loop does not read), and marked as compressed if the calibration is.
    fn in_form<B>(&self, curve: Curve<B>) -> Curve<B> {
        let has_chroma = matches!(self.layout.format(), Format::Yuyv(_) | Format::Nv12(_));
        let curve = if has_chroma { curve.looked_up() } else { curve };
        if self.compressed { curve.compressed() } else { curve }
    }
}
