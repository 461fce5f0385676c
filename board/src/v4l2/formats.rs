//! Pixel formats by FourCC, and the choice of the format that is preferred among those of a camera. [`Format`] lists the
//! formats with their packing.

use super::Size;
use super::abi;
use super::jpeg::Jpeg;
use hemilux_core::format::{Format, Layout, LayoutError, Matrix, Yuv};

/// FourCCs of JPEG pictures.
const COMPRESSED: [&str; 2] = ["MJPG", "JPEG"];

/// FourCC of decoded JPEG pictures.
const DECODED: u32 = u32::from_le_bytes(*b"RGB3");

/// Longest side of a picture in pixels, and longest row in bytes; within both limits the bytes of a frame fit into 32 bits.
const MAX_SIDE: u32 = 1 << 14;
const MAX_STRIDE: usize = 1 << 17;

/// Returns the rank of `fourcc` among the readable formats, 0 for the most preferred; JPEG ranks after all uncompressed colour formats.
#[must_use]
pub fn rank(fourcc: u32) -> Option<usize> {
    all().position(|name| name == fourcc)
}

/// Returns the FourCCs of all readable formats, the most preferred first.
fn all() -> impl Iterator<Item = u32> {
    let uncompressed = || Format::fourccs().map(u32::from_le_bytes);
    let is_grey = |fourcc: &u32| *fourcc == u32::from_le_bytes(*b"GREY");
    let jpeg = COMPRESSED.into_iter().filter_map(parse);
    uncompressed().filter(move |f| !is_grey(f)).chain(jpeg).chain(uncompressed().filter(is_grey))
}

/// Returns whether pictures of `fourcc` are JPEG.
#[must_use]
pub fn is_jpeg(fourcc: u32) -> bool {
    COMPRESSED.into_iter().filter_map(parse).any(|name| name == fourcc)
}

/// Returns the packing of frames of `fourcc`; `None` for unsupported formats.
#[must_use]
pub fn format(fourcc: u32, yuv: Yuv) -> Option<Format> {
    let read = if is_jpeg(fourcc) { DECODED } else { fourcc };
    Format::from_fourcc(read.to_le_bytes(), yuv)
}

/// Returns the characters of `fourcc` as a name, without trailing blanks.
#[must_use]
pub fn name(fourcc: u32) -> String {
    let printable = |b: u8| if b.is_ascii_graphic() || b == b' ' { char::from(b) } else { '?' };
    fourcc.to_le_bytes().map(printable).iter().collect::<String>().trim_end().into()
}

/// Returns the FourCC with the characters of `name`; `None` if they are not one to four printable ASCII
/// characters.
#[must_use]
pub fn parse(name: &str) -> Option<u32> {
    let mut padded = [b' '; 4];
    let bytes = name.as_bytes();
    if bytes.is_empty() || bytes.len() > 4 || !bytes.iter().all(u8::is_ascii_graphic) {
        return None;
    }
    padded[..bytes.len()].copy_from_slice(bytes);
    Some(u32::from_le_bytes(padded))
}

/// Returns the names of all readable formats, separated by commas.
#[must_use]
pub fn names() -> String {
    all().map(name).collect::<Vec<_>>().join(", ")
}

/// The value that was found and the value that was expected, for an error message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mismatch {
    /// Description of the value that was found.
    pub found: String,
    /// Description of the value that was expected.
    pub expected: String,
}

impl Mismatch {
    fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { found: found.into(), expected: expected.into() }
    }
}

/// Returns the found and the expected formats for a camera that offers only the unreadable formats `offered`.
#[must_use]
pub fn none_of(offered: &[&str]) -> Mismatch {
    let found =
        format!("the pixel formats {}", if offered.is_empty() { "none".into() } else { offered.join(", ") });
    Mismatch::new(found, format!("one of {}", names()))
}

/// The layout of the frames that an open camera delivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// FourCC of the frames; for a camera that sends JPEG, that of the decoded frames.
    pub fourcc: u32,
    /// Size and packing of the frames; for a camera that sends JPEG, those of the decoded frames.
    pub layout: Layout,
    /// Size and scale of the camera's JPEG frames; `None` for other formats.
    pub jpeg: Option<Jpeg>,
}

impl Picture {
    /// Returns the layout of frames in the format that the driver granted.
    ///
    /// # Errors
    /// [`Mismatch`] with the format that was found and the formats that are supported.
    pub fn of(granted: &abi::PixelFormat) -> Result<Self, Mismatch> {
        let (fourcc, width, height) = (granted.fourcc, granted.width, granted.height);
        let format = format(fourcc, yuv(granted)).ok_or_else(|| none_of(&[&name(fourcc)]))?;
        if width > MAX_SIDE || height > MAX_SIDE {
            let found = format!("{width} x {height} pixels");
            return Err(Mismatch::new(found, format!("at most {MAX_SIDE} on each side")));
        }
        if is_jpeg(fourcc) {
            return Self::of_jpeg(Jpeg::of(width, height));
        }
        // Some drivers report a stride of 0.
        let stride = match granted.bytes_per_line as usize {
            0 => format.line_bytes(width),
            stride => stride,
        };
        if stride > MAX_STRIDE {
            return Err(Mismatch::new(format!("{stride} bytes per line"), format!("at most {MAX_STRIDE}")));
        }
        let layout = Layout::try_new(format, width, height, stride).map_err(|error| match error {
            LayoutError::BadLine { found, expected } => Mismatch::new(
                format!("{found} bytes per line"),
                format!("at least {expected} for {width} pixels of {}", name(fourcc)),
            ),
            LayoutError::OddSize => {
                let even = if pairs_rows(format) { "columns and rows" } else { "columns" };
                Mismatch::new(
                    format!("{width} x {height} pixels of {}", name(fourcc)),
                    format!("an even number of {even}: choose another size="),
                )
            }
            _ => Mismatch::new(format!("{width} x {height} pixels"), "1 to 67108864 in all"),
        })?;
        Ok(Self { fourcc, layout: binned(layout), jpeg: None })
    }

    /// Returns the layout of the decoded frames of `jpeg`.
    fn of_jpeg(jpeg: Jpeg) -> Result<Self, Mismatch> {
        let size = jpeg.decoded();
        let layout = Layout::tight(Format::Rgb24, size.width, size.height)
            .map_err(|_| Mismatch::new(format!("{size} pixels"), "1 to 67108864 in all"))?;
        Ok(Self { fourcc: DECODED, layout, jpeg: Some(jpeg) })
    }

    /// Returns the FourCC of the camera's frames, before JPEG is decoded.
    #[must_use]
    pub fn camera_fourcc(&self) -> u32 {
        if self.jpeg.is_some() { u32::from_le_bytes(*b"MJPG") } else { self.fourcc }
    }

    /// Returns the size of the camera's frames, before JPEG is decoded; lens files refer to it.
    #[must_use]
    pub fn camera_size(&self) -> Size {
        self.jpeg.map_or(Size::new(self.width(), self.height()), |jpeg| Size::new(jpeg.width, jpeg.height))
    }

    /// Returns the least number of bytes that a complete frame from the camera has.
    #[must_use]
    pub(super) const fn least_bytes(&self) -> usize {
        if self.jpeg.is_some() { 4 } else { self.layout.frame_bytes() }
    }

    /// Copies or decodes a frame's `bytes` into `frame`; returns false for a frame that cannot be decoded.
    #[must_use]
    pub(super) fn read(&self, bytes: &[u8], frame: &mut Vec<u8>) -> bool {
        if let Some(jpeg) = &self.jpeg {
            return jpeg.decode(bytes, frame);
        }
        let Some(bytes) = bytes.get(..self.layout.frame_bytes()) else { return false };
        frame.clear();
        frame.extend_from_slice(bytes);
        true
    }

    /// Returns the width of the frames, pixels.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.layout.width()
    }

    /// Returns the height of the frames, pixels.
    #[must_use]
    pub const fn height(&self) -> u32 {
        self.layout.height()
    }

    /// Returns whether the codes of the frames are those of the sensor, proportional to the light.
    #[must_use]
    pub const fn is_raw(&self) -> bool {
        self.layout.format().pattern().is_some()
    }

    /// Returns the matrix and the range of luma and chroma, for frame formats with chroma.
    #[must_use]
    pub const fn yuv(&self) -> Option<Yuv> {
        match self.layout.format() {
            Format::Yuyv(yuv) | Format::Nv12(yuv) => Some(yuv),
            _ => None,
        }
    }

    /// Returns the largest code of a sample of the frames.
    #[must_use]
    pub fn max_code(&self) -> f64 {
        f64::from(self.layout.format().max_code())
    }
}

/// Least number of rows and of columns of the merged image of a binned mosaic: with a lens of 180 degrees, a pixel is 0.75 degrees wide.
const LEAST_MERGED: u32 = 240;

/// Returns `layout` with the largest bin that leaves [`LEAST_MERGED`] rows and columns.
fn binned(layout: Layout) -> Layout {
    let fits = |layout: &Layout| {
        let merged = layout.merged_size();
        merged.width.min(merged.height) >= LEAST_MERGED
    };
    let mut bins = [8, 4, 2].into_iter().filter_map(|bin| layout.binned(bin).ok());
    bins.find(fits).unwrap_or(layout)
}

/// Returns whether a format needs an even number of rows, in addition to an even number of columns.
const fn pairs_rows(format: Format) -> bool {
    format.pattern().is_some() || matches!(format, Format::Nv12(_))
}

/// Returns the matrix and the range of luma and chroma that the driver states; those that it does not state follow from the
/// colour space.
fn yuv(granted: &abi::PixelFormat) -> Yuv {
    let full = match granted.quantization {
        0 => granted.colorspace == abi::COLORSPACE_JPEG,
        quantization => quantization == abi::FULL_RANGE,
    };
    let bt709 = match granted.ycbcr {
        0 => granted.colorspace == abi::COLORSPACE_709,
        encoding => encoding == abi::YCBCR_709,
    };
    Yuv { limited: !full, matrix: if bt709 { Matrix::Bt709 } else { Matrix::Bt601 } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fourcc_names_round_trip_and_unprintable_bytes_are_escaped() {
        for text in ["YUYV", "pBAA", "Y8"] {
            assert_eq!(parse(text).map(name).as_deref(), Some(text), "{text}");
        }
        assert_eq!((parse(""), parse("YUYVX"), parse("Y\nYV")), (None, None, None), "refused");
        assert_eq!(name(u32::from_le_bytes([b'Y', 0, 0xff, b'\n'])), "Y???", "printable");
    }

    #[test]
    fn every_readable_format_is_one_that_the_core_supports() {
        for (place, fourcc) in all().enumerate() {
            assert_eq!(rank(fourcc), Some(place), "each once");
            assert!(format(fourcc, Yuv::default()).is_some(), "{}", name(fourcc));
        }
    }

    fn granted(name: &str, width: u32, height: u32, bytes_per_line: u32) -> abi::PixelFormat {
        let fourcc = parse(name).expect("a name");
        abi::PixelFormat { width, height, fourcc, bytes_per_line, ..abi::PixelFormat::default() }
    }

    #[test]
    fn invalid_granted_formats_are_refused() {
        let yuyv = |stride| Picture::of(&granted("YUYV", 640, 480, stride));
        assert_eq!(yuyv(1280).map(|p| p.layout.frame_bytes()), Ok(614_400), "whole");
        assert_eq!(yuyv(0).map(|p| p.layout.bytes_per_line()), Ok(1280), "left to us");
        assert!(yuyv(1279).is_err() && yuyv(u32::MAX).is_err(), "stride");
        assert!(
            Picture::of(&granted("XXXX", 640, 480, 1280)).is_err_and(|e| e.found.contains("XXXX")),
            "unknown"
        );
        assert!(Picture::of(&granted("YUYV", 0, 480, 0)).is_err(), "nothing");
        let full = abi::PixelFormat { quantization: abi::FULL_RANGE, ..granted("YUYV", 640, 480, 1280) };
        assert!(Picture::of(&full).is_ok_and(|p| p.yuv().is_some_and(|yuv| !yuv.limited)), "full range");
        assert!(yuyv(1280).is_ok_and(|p| p.yuv().is_some_and(|yuv| yuv.limited)), "limited by default");
    }

    /// Strides are from the kernel's documentation of the formats: rows of packed formats consist of whole groups of
    /// samples.
    #[test]
    fn odd_sizes_are_refused_for_formats_whose_samples_are_grouped() {
        for (name, width, height, line) in [
            ("RGB3", 641, 481, 1923),
            ("GREY", 641, 481, 641),
            ("YUYV", 640, 481, 1280),
            ("pBAA", 642, 480, 805),
        ] {
            let layout = Picture::of(&granted(name, width, height, 0)).map(|p| p.layout);
            assert_eq!(layout.map(|l| l.bytes_per_line()), Ok(line), "{name} {width} x {height}");
        }
        let refused = [
            ("YUYV", 641, 480, "columns:"),
            ("NV12", 640, 481, "columns and rows"),
            ("NV12", 641, 480, "columns and rows"),
            ("pBAA", 641, 480, "columns and rows"),
            ("RG10", 640, 481, "columns and rows"),
        ];
        for (name, width, height, told) in refused {
            let Mismatch { found, expected } = Picture::of(&granted(name, width, height, 0)).expect_err(name);
            assert!(
                found == format!("{width} x {height} pixels of {name}") && expected.contains(told),
                "{found}, expected {expected}"
            );
        }
        // 642 pixels of ten bits are 802.5 bytes, but the low bits of the last two pixels lie in the last byte of a group of five.
        let Mismatch { found, expected } =
            Picture::of(&granted("pBAA", 642, 480, 803)).expect_err("a cut group");
        assert!(
            found == "803 bytes per line" && expected.starts_with("at least 805"),
            "{found}, expected {expected}"
        );
    }

    #[test]
    fn large_mosaics_are_binned_and_small_ones_are_not() {
        for (width, height, bin) in [(640, 480, 1), (1640, 1232, 2), (2028, 1520, 2), (3280, 2464, 4)] {
            let layout = Picture::of(&granted("pBAA", width, height, 0)).expect("a picture").layout;
            assert_eq!(layout.bin(), bin, "{width} x {height}");
        }
    }

    #[test]
    fn jpeg_comes_after_all_other_colours_and_before_grey() {
        let rank = |name| rank(parse(name).expect("a name"));
        assert!(rank("BGR3") < rank("MJPG") && rank("MJPG") < rank("GREY"), "{}", names());
        let large = Picture::of(&granted("MJPG", 1920, 1080, 0)).expect("JPEG");
        assert_eq!(
            (large.width(), large.height(), large.camera_size()),
            (480, 270, Size::new(1920, 1080)),
            "scaled"
        );
        assert_eq!(
            (name(large.fourcc), name(large.camera_fourcc())),
            ("RGB3".into(), "MJPG".into()),
            "decoded"
        );
        let Mismatch { found, expected } = none_of(&["H264"]);
        assert!(found.contains("H264") && expected.contains("MJPG"), "{found}, {expected}");
    }
}
