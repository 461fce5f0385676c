//! Pixel formats and memory layouts of frames, with their V4L2 names.
//!
//! ```
//! use hemilux_core::format::{Format, Layout, Yuv};
//!
//! let format = Format::from_fourcc(*b"pRAA", Yuv::default()).expect("packed 10-bit Bayer");
//! assert_eq!((format.max_code(), format.line_bytes(640)), (1023, 800));
//! let layout = Layout::try_new(format, 640, 480, 832)?;
//! assert_eq!(layout.frame_bytes(), 479 * 832 + 800);
//! # Ok::<(), hemilux_core::LayoutError>(())
//! ```

use crate::response::Depth;

/// The order of colours in the 2 x 2 cells of a Bayer mosaic: the first two pixels of the first two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// The cell has the colours red, green; green, blue.
    Rggb,
    /// The cell has the colours green, red; blue, green.
    Grbg,
    /// The cell has the colours green, blue; red, green.
    Gbrg,
    /// The cell has the colours blue, green; green, red.
    Bggr,
}

impl Pattern {
    /// Returns the channel (0 red, 1 green, 2 blue) of each pixel of a cell, row by row.
    #[must_use]
    pub const fn channels(self) -> [usize; 4] {
        match self {
            Self::Rggb => [0, 1, 1, 2],
            Self::Grbg => [1, 0, 2, 1],
            Self::Gbrg => [1, 2, 0, 1],
            Self::Bggr => [2, 1, 1, 0],
        }
    }
}

/// The coefficients by which luma and chroma are converted to red, green and blue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Matrix {
    /// ITU-R BT.601, used by webcams and JPEG.
    #[default]
    Bt601,
    /// Luma coefficients of ITU-R BT.709.
    Bt709,
}

/// The encoding of luma and chroma in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Yuv {
    /// Whether luma is 16 (black) to 235 (white) and chroma 16 to 240; otherwise both are 0 to 255.
    pub limited: bool,
    /// The coefficients of the conversion to red, green and blue.
    pub matrix: Matrix,
}

/// The pixel format of a frame: the packing of its samples in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Three bytes per pixel: red, green, blue.
    Rgb24,
    /// Three bytes per pixel: blue, green, red.
    Bgr24,
    /// Three 16-bit words per pixel in the machine's byte order: red, green, blue. For image files; not a camera format.
    Rgb48,
    /// Grey pixels of one byte.
    Grey,
    /// Four bytes per two pixels: Y0 Cb Y1 Cr.
    Yuyv(Yuv),
    /// A plane of luma bytes, followed by a plane of Cb Cr pairs, one pair per 2 x 2 pixels.
    Nv12(Yuv),
    /// A Bayer mosaic of samples of one byte.
    Bayer8(Pattern),
    /// A Bayer mosaic of 10 bits, five bytes per four pixels: the upper eight bits of each pixel, then a byte with the lower two bits of each
    /// pixel, those of the first pixel in the lowest bits.
    Raw10(Pattern),
    /// A Bayer mosaic of 12 bits, three bytes per two pixels: the upper eight bits of each pixel, then a byte with the lower four bits of each
    /// pixel, those of the first pixel in the lowest bits.
    Raw12(Pattern),
    /// A Bayer mosaic of little-endian 16-bit words; the number is the count of used low bits, 10 to 16.
    Bayer16(Pattern, u8),
}

/// Encoding of luma and chroma in [`FOURCCS`]; [`Format::from_fourcc`] replaces it by the argument of its caller.
const DEFAULT_YUV: Yuv = Yuv { limited: false, matrix: Matrix::Bt601 };

/// The V4L2 code of each format, best for light measurement first: linear mosaics (packed before 16-bit words, more bits before fewer),
/// then processed images (more colour resolution first), then grey.
const FOURCCS: [([u8; 4], Format); 33] = [
    (*b"pBCC", Format::Raw12(Pattern::Bggr)),
    (*b"pGCC", Format::Raw12(Pattern::Gbrg)),
    (*b"pgCC", Format::Raw12(Pattern::Grbg)),
    (*b"pRCC", Format::Raw12(Pattern::Rggb)),
    (*b"pBAA", Format::Raw10(Pattern::Bggr)),
    (*b"pGAA", Format::Raw10(Pattern::Gbrg)),
    (*b"pgAA", Format::Raw10(Pattern::Grbg)),
    (*b"pRAA", Format::Raw10(Pattern::Rggb)),
    (*b"BYR2", Format::Bayer16(Pattern::Bggr, 16)),
    (*b"GB16", Format::Bayer16(Pattern::Gbrg, 16)),
    (*b"GR16", Format::Bayer16(Pattern::Grbg, 16)),
    (*b"RG16", Format::Bayer16(Pattern::Rggb, 16)),
    (*b"BG14", Format::Bayer16(Pattern::Bggr, 14)),
    (*b"GB14", Format::Bayer16(Pattern::Gbrg, 14)),
    (*b"GR14", Format::Bayer16(Pattern::Grbg, 14)),
    (*b"RG14", Format::Bayer16(Pattern::Rggb, 14)),
    (*b"BG12", Format::Bayer16(Pattern::Bggr, 12)),
    (*b"GB12", Format::Bayer16(Pattern::Gbrg, 12)),
    (*b"BA12", Format::Bayer16(Pattern::Grbg, 12)),
    (*b"RG12", Format::Bayer16(Pattern::Rggb, 12)),
    (*b"BG10", Format::Bayer16(Pattern::Bggr, 10)),
    (*b"GB10", Format::Bayer16(Pattern::Gbrg, 10)),
    (*b"BA10", Format::Bayer16(Pattern::Grbg, 10)),
    (*b"RG10", Format::Bayer16(Pattern::Rggb, 10)),
    (*b"BA81", Format::Bayer8(Pattern::Bggr)),
    (*b"GBRG", Format::Bayer8(Pattern::Gbrg)),
    (*b"GRBG", Format::Bayer8(Pattern::Grbg)),
    (*b"RGGB", Format::Bayer8(Pattern::Rggb)),
    (*b"YUYV", Format::Yuyv(DEFAULT_YUV)),
    (*b"NV12", Format::Nv12(DEFAULT_YUV)),
    (*b"RGB3", Format::Rgb24),
    (*b"BGR3", Format::Bgr24),
    (*b"GREY", Format::Grey),
];

impl Format {
    /// Returns the V4L2 four-character codes of all supported formats, best for light measurement first.
    ///
    /// ```
    /// use hemilux_core::format::Format;
    /// assert_eq!(Format::fourccs().next(), Some(*b"pBCC"));
    /// assert_eq!(Format::fourccs().last(), Some(*b"GREY"));
    /// ```
    pub fn fourccs() -> impl Iterator<Item = [u8; 4]> {
        FOURCCS.iter().map(|(name, _)| *name)
    }

    /// Returns the format with the V4L2 code `fourcc`; `yuv` applies to formats of luma and chroma. `None` for an unsupported code.
    #[must_use]
    pub fn from_fourcc(fourcc: [u8; 4], yuv: Yuv) -> Option<Self> {
        let (_, format) = FOURCCS.iter().find(|(name, _)| *name == fourcc)?;
        Some(match format {
            Self::Yuyv(_) => Self::Yuyv(yuv),
            Self::Nv12(_) => Self::Nv12(yuv),
            other => *other,
        })
    }

    /// Returns the pattern of a Bayer format; `None` for other formats.
    #[must_use]
    pub const fn pattern(self) -> Option<Pattern> {
        match self {
            Self::Bayer8(p) | Self::Raw10(p) | Self::Raw12(p) | Self::Bayer16(p, _) => Some(p),
            _ => None,
        }
    }

    /// Returns the largest code of a sample: 255, 1023, 4095 or 65535; 2^n - 1 for a [`Format::Bayer16`] of n bits.
    #[must_use]
    pub const fn max_code(self) -> u32 {
        match self {
            Self::Raw10(_) => 1023,
            Self::Raw12(_) => 4095,
            Self::Bayer16(_, bits @ 1..=16) => (1 << bits) - 1,
            Self::Rgb48 | Self::Bayer16(..) => 65535,
            _ => 255,
        }
    }

    /// Returns the depth of a sample after unpacking.
    #[must_use]
    pub const fn depth(self) -> Depth {
        if self.max_code() > 255 { Depth::U16 } else { Depth::U8 }
    }

    /// Returns the number of bytes per row of `width` pixels without padding.
    #[must_use]
    pub const fn line_bytes(self, width: u32) -> usize {
        let width = width as usize;
        match self {
            Self::Rgb24 | Self::Bgr24 => width.saturating_mul(3),
            Self::Rgb48 => width.saturating_mul(6),
            Self::Grey | Self::Nv12(_) | Self::Bayer8(_) => width,
            Self::Yuyv(_) | Self::Bayer16(..) => width.saturating_mul(2),
            Self::Raw10(_) => width.div_ceil(4).saturating_mul(5),
            Self::Raw12(_) => width.div_ceil(2).saturating_mul(3),
        }
    }
}

/// Number of columns and rows of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ImageSize {
    /// Number of columns of the merged image.
    pub width: u32,
    /// Number of rows of the merged image.
    pub height: u32,
}

/// Format, size and row pitch of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    format: Format,
    width: u32,
    height: u32,
    bytes_per_line: usize,
    /// Binary logarithm of [`Layout::bin`], by which the sum over a bin is shifted to give the average.
    bin_log2: u32,
}

/// The reason why a frame layout is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LayoutError {
    /// The image has no pixels, or more than 2^26.
    BadSize,
    /// The number of columns or rows is odd in a format whose samples are shared by pairs of columns or rows.
    OddSize,
    /// The row pitch is below the number of bytes of a row's pixels, above 2^20 bytes, or odd for 16-bit samples.
    BadLine {
        /// Row pitch of the refused layout, bytes.
        found: usize,
        /// Number of bytes of the pixels of a row.
        expected: usize,
    },
}

impl core::fmt::Display for LayoutError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BadSize => write!(f, "an image without pixels or with more than 67108864"),
            Self::OddSize => write!(f, "an odd number of columns or rows where the format pairs them"),
            Self::BadLine { found, expected } => {
                write!(f, "lines of {found} bytes for pixels of {expected}")
            }
        }
    }
}

impl core::error::Error for LayoutError {}

impl Layout {
    /// Creates a layout after checking the arguments. `bytes_per_line` is the row pitch; for [`Format::Nv12`] it applies to both planes.
    ///
    /// # Errors
    /// [`LayoutError`] for a size that the format cannot have and for rows that are too short or too long.
    pub fn try_new(
        format: Format,
        width: u32,
        height: u32,
        bytes_per_line: usize,
    ) -> Result<Self, LayoutError> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > 1 << 26 {
            return Err(LayoutError::BadSize);
        }
        let two_rows = format.pattern().is_some() || matches!(format, Format::Nv12(_));
        let pairs = two_rows || matches!(format, Format::Yuyv(_));
        if (pairs && width % 2 == 1) || (two_rows && height % 2 == 1) {
            return Err(LayoutError::OddSize);
        }
        let expected = format.line_bytes(width);
        let words = matches!(format, Format::Rgb48) && bytes_per_line % 2 == 1;
        if bytes_per_line < expected || bytes_per_line > 1 << 20 || words {
            return Err(LayoutError::BadLine { found: bytes_per_line, expected });
        }
        Ok(Self { format, width, height, bytes_per_line, bin_log2: 0 })
    }

    /// Creates a layout whose rows have no padding.
    ///
    /// # Errors
    /// [`LayoutError`] for a size that the format cannot have and for rows that are too short or too long.
    pub fn tight(format: Format, width: u32, height: u32) -> Result<Self, LayoutError> {
        Self::try_new(format, width, height, format.line_bytes(width))
    }

    /// Returns the layout of the same frames with `bin` x `bin` cells of the mosaic averaged to one RGB pixel during reading, separately for
    /// each colour. Columns and rows beyond the last whole bin are left out.
    ///
    /// # Errors
    /// [`LayoutError::BadSize`] for a format that is no mosaic, a `bin` that is not 1, 2, 4 or 8, and a frame of fewer than `bin` cells.
    pub const fn binned(self, bin: u32) -> Result<Self, LayoutError> {
        let is_mosaic = self.format.pattern().is_some() || bin == 1;
        let fits = bin == 1 || (self.width / 2 >= bin && self.height / 2 >= bin);
        match bin {
            1 | 2 | 4 | 8 if is_mosaic && fits => Ok(Self { bin_log2: bin.trailing_zeros(), ..self }),
            _ => Err(LayoutError::BadSize),
        }
    }

    /// Returns the number of mosaic cells that form one merged pixel on each side; 1 unless the layout was made by [`Layout::binned`].
    #[must_use]
    pub const fn bin(&self) -> u32 {
        1 << self.bin_log2
    }

    /// Returns the binary logarithm of [`Layout::bin`].
    pub(crate) const fn bin_log2(&self) -> u32 {
        self.bin_log2
    }

    /// Returns the pixel format of the frames.
    #[must_use]
    pub const fn format(&self) -> Format {
        self.format
    }

    /// Returns the number of columns of the frames.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Returns the number of rows of the frames.
    #[must_use]
    pub const fn height(&self) -> u32 {
        self.height
    }

    /// Returns the row pitch: the number of bytes from the start of one row to the start of the next.
    #[must_use]
    pub const fn bytes_per_line(&self) -> usize {
        self.bytes_per_line
    }

    /// Returns the smallest number of bytes that a frame may have; the last row needs no padding.
    #[must_use]
    pub const fn frame_bytes(&self) -> usize {
        let rows = match self.format {
            Format::Nv12(_) => self.height as usize / 2 * 3,
            _ => self.height as usize,
        };
        (rows - 1).saturating_mul(self.bytes_per_line).saturating_add(self.format.line_bytes(self.width))
    }

    /// Returns the smallest number of samples that a frame may have, in the units of [`Samples`](crate::Samples): words for
    /// [`Format::Rgb48`], bytes for all other formats.
    #[must_use]
    pub const fn frame_samples(&self) -> usize {
        match self.format {
            Format::Rgb48 => self.frame_bytes() / 2,
            _ => self.frame_bytes(),
        }
    }

    /// Returns the size of the merged image: the size of the frame or, for a Bayer mosaic, half of it divided by [`Layout::bin`] on each side,
    /// since a bin of 2 x 2 cells becomes one RGB pixel.
    #[must_use]
    pub const fn merged_size(&self) -> ImageSize {
        match self.format.pattern() {
            Some(_) => {
                let shift = 1 + self.bin_log2;
                ImageSize { width: self.width >> shift, height: self.height >> shift }
            }
            None => ImageSize { width: self.width, height: self.height },
        }
    }
}

/// Unpacks four samples of 10 bits from five bytes; the even and the odd samples are assembled in the halves of two words.
#[inline(always)]
pub(crate) fn raw10(group: &[u8; 5]) -> [u16; 4] {
    let upper = group.first_chunk().map_or(0, |four| u32::from_le_bytes(*four));
    let low = u32::from(group[4]);
    // The low bits of each byte then contain two bits of each sample.
    let low = low | low << 6;
    let low = low | low << 12;
    let even = (upper & 0x00ff_00ff) << 2 | low & 0x0003_0003;
    let odd = (upper >> 8 & 0x00ff_00ff) << 2 | low >> 8 & 0x0003_0003;
    [even as u16, odd as u16, (even >> 16) as u16, (odd >> 16) as u16]
}

/// Unpacks two samples of 12 bits from three bytes.
#[inline(always)]
pub(crate) fn raw12(&[a, b, low]: &[u8; 3]) -> [u16; 2] {
    let low = u16::from(low);
    [u16::from(a) << 4 | low & 15, u16::from(b) << 4 | low >> 4]
}
