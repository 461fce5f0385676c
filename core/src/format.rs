//! How the samples of a frame lie in memory, by the names that V4L2 gives them.
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

/// Where red lies in the 2 x 2 cells of a Bayer mosaic: the colours of the first two pixels of the first two rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// Red, green; green, blue.
    Rggb,
    /// Green, red; blue, green.
    Grbg,
    /// Green, blue; red, green.
    Gbrg,
    /// Blue, green; green, red.
    Bggr,
}

impl Pattern {
    /// The channel (0 red, 1 green, 2 blue) of each pixel of a cell, row by row.
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

/// Coefficients that make red, green and blue of luma and chroma.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Matrix {
    /// ITU-R BT.601: what webcams and JPEG use.
    #[default]
    Bt601,
    /// ITU-R BT.709.
    Bt709,
}

/// Codes of luma and chroma.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Yuv {
    /// Black at 16 and white at 235 (chroma 16 to 240); else all of 0 to 255.
    pub limited: bool,
    /// The coefficients.
    pub matrix: Matrix,
}

/// How samples are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Red, green, blue bytes.
    Rgb24,
    /// Blue, green, red bytes.
    Bgr24,
    /// Red, green, blue of 16 bits in the machine's byte order: images, no camera's format.
    Rgb48,
    /// One byte a pixel.
    Grey,
    /// Y0 Cb Y1 Cr: chroma for each pair of pixels.
    Yuyv(Yuv),
    /// A plane of luma, then a plane of Cb Cr pairs for each 2 x 2 pixels.
    Nv12(Yuv),
    /// A mosaic of bytes.
    Bayer8(Pattern),
    /// A mosaic of 10 bits: four pixels' upper eight bits, then a byte with their lower two, the first pixel's lowest.
    Raw10(Pattern),
    /// A mosaic of 12 bits: two pixels' upper eight bits, then a byte with their lower four, the first pixel's lowest.
    Raw12(Pattern),
    /// A mosaic of little-endian 16-bit words, of which this many low bits are used (10 to 16).
    Bayer16(Pattern, u8),
}

/// Placeholder of [`FOURCCS`], which is replaced by the caller's.
const DEFAULT_YUV: Yuv = Yuv { limited: false, matrix: Matrix::Bt601 };

/// V4L2's four characters of each format: linear sensor codes first, packed before 16-bit words and more bits before fewer; then pictures
/// processed by the camera, the ones with more of their colour first; grey at the end.
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
    /// V4L2's four characters of each format that is read, the best for light measurement first.
    ///
    /// ```
    /// use hemilux_core::format::Format;
    /// assert_eq!(Format::fourccs().next(), Some(*b"pBCC"));
    /// assert_eq!(Format::fourccs().last(), Some(*b"GREY"));
    /// ```
    pub fn fourccs() -> impl Iterator<Item = [u8; 4]> {
        FOURCCS.iter().map(|(name, _)| *name)
    }

    /// The format that V4L2 calls `fourcc`; `yuv` is for those that carry luma and chroma.
    #[must_use]
    pub fn from_fourcc(fourcc: [u8; 4], yuv: Yuv) -> Option<Self> {
        let (_, format) = FOURCCS.iter().find(|(name, _)| *name == fourcc)?;
        Some(match format {
            Self::Yuyv(_) => Self::Yuyv(yuv),
            Self::Nv12(_) => Self::Nv12(yuv),
            other => *other,
        })
    }

    /// The mosaic's pattern.
    #[must_use]
    pub const fn pattern(self) -> Option<Pattern> {
        match self {
            Self::Bayer8(p) | Self::Raw10(p) | Self::Raw12(p) | Self::Bayer16(p, _) => Some(p),
            _ => None,
        }
    }

    /// Largest code of a sample.
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

    /// Depth of a sample once it is unpacked.
    #[must_use]
    pub const fn depth(self) -> Depth {
        if self.max_code() > 255 { Depth::U16 } else { Depth::U8 }
    }

    /// Bytes of `width` pixels without padding.
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

/// Columns and rows of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A frame's size and how its rows lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    format: Format,
    width: u32,
    height: u32,
    bytes_per_line: usize,
}

/// Why a layout was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LayoutError {
    /// No pixels, or more than 2^26.
    BadSize,
    /// Columns or rows that do not make whole cells of the format.
    OddSize,
    /// Lines shorter than their pixels, or longer than 2^20 bytes.
    BadLine {
        /// Bytes of a line.
        found: usize,
        /// Bytes of its pixels.
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
    /// Checks the numbers; `bytes_per_line` is that of the luma plane where there are two.
    ///
    /// # Errors
    /// [`LayoutError`].
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
        Ok(Self { format, width, height, bytes_per_line })
    }

    /// Rows without padding.
    ///
    /// # Errors
    /// [`LayoutError`].
    pub fn tight(format: Format, width: u32, height: u32) -> Result<Self, LayoutError> {
        Self::try_new(format, width, height, format.line_bytes(width))
    }

    /// How samples are packed.
    #[must_use]
    pub const fn format(&self) -> Format {
        self.format
    }

    /// Image columns.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Image rows.
    #[must_use]
    pub const fn height(&self) -> u32 {
        self.height
    }

    /// Bytes from one row to the next.
    #[must_use]
    pub const fn bytes_per_line(&self) -> usize {
        self.bytes_per_line
    }

    /// Least bytes of a frame; the padding of the last row may be missing.
    #[must_use]
    pub const fn frame_bytes(&self) -> usize {
        let rows = match self.format {
            Format::Nv12(_) => self.height as usize / 2 * 3,
            _ => self.height as usize,
        };
        (rows - 1).saturating_mul(self.bytes_per_line).saturating_add(self.format.line_bytes(self.width))
    }

    /// Least samples of a frame as [`Samples`](crate::Samples) counts them: words of [`Format::Rgb48`], bytes of any other format.
    #[must_use]
    pub const fn frame_samples(&self) -> usize {
        match self.format {
            Format::Rgb48 => self.frame_bytes() / 2,
            _ => self.frame_bytes(),
        }
    }

    /// Size of the merged image: that of the frame or, of a Bayer mosaic, half of it, since each 2 x 2 cell becomes one RGB pixel.
    #[must_use]
    pub const fn merged_size(&self) -> ImageSize {
        match self.format.pattern() {
            Some(_) => ImageSize { width: self.width / 2, height: self.height / 2 },
            None => ImageSize { width: self.width, height: self.height },
        }
    }
}

/// Four samples of 10 bits, two by two in the halves of words.
#[inline(always)]
pub(crate) fn raw10(group: &[u8; 5]) -> [u16; 4] {
    let upper = group.first_chunk().map_or(0, |four| u32::from_le_bytes(*four));
    let low = u32::from(group[4]);
    // Two bits of each in the low bits of a byte.
    let low = low | low << 6;
    let low = low | low << 12;
    let even = (upper & 0x00ff_00ff) << 2 | low & 0x0003_0003;
    let odd = (upper >> 8 & 0x00ff_00ff) << 2 | low >> 8 & 0x0003_0003;
    [even as u16, odd as u16, (even >> 16) as u16, (odd >> 16) as u16]
}

/// Two samples of 12 bits.
#[inline(always)]
pub(crate) fn raw12(&[a, b, low]: &[u8; 3]) -> [u16; 2] {
    let low = u16::from(low);
    [u16::from(a) << 4 | low & 15, u16::from(b) << 4 | low >> 4]
}
