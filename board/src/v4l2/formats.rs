//! Pixel formats by their four characters, and the choice of a camera's best one. [`Format`] has the list and the packing.

use super::abi;
use hemilux_core::format::{Format, Layout, LayoutError, Matrix, Yuv};

/// Compressed pictures, which are not read: their codes near black and white are lost.
const COMPRESSED: [&str; 2] = ["MJPG", "JPEG"];

/// Longest side of a picture, pixels, and longest row, bytes: with them a frame's bytes fit into 32 bits.
const MAX_SIDE: u32 = 1 << 14;
const MAX_STRIDE: usize = 1 << 17;

/// Place of `fourcc` among the formats that are read, 0 the best.
#[must_use]
pub fn rank(fourcc: u32) -> Option<usize> {
    Format::fourccs().position(|name| u32::from_le_bytes(name) == fourcc)
}

/// How frames of `fourcc` are packed; `None` where they are not read.
#[must_use]
pub fn format(fourcc: u32, yuv: Yuv) -> Option<Format> {
    Format::from_fourcc(fourcc.to_le_bytes(), yuv)
}

/// The four characters of `fourcc`, without trailing blanks.
#[must_use]
pub fn name(fourcc: u32) -> String {
    let printable = |b: u8| if b.is_ascii_graphic() || b == b' ' { char::from(b) } else { '?' };
    fourcc.to_le_bytes().map(printable).iter().collect::<String>().trim_end().into()
}

/// `fourcc` of up to four characters.
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

/// The names of all formats that are read.
#[must_use]
pub fn names() -> String {
    Format::fourccs().map(|n| name(u32::from_le_bytes(n))).collect::<Vec<_>>().join(", ")
}

/// What to say of a camera that offers nothing readable but `offered`: what was found and what would be right.
#[must_use]
pub fn none_of(offered: &[&str]) -> (String, String) {
    let found =
        format!("the pixel formats {}", if offered.is_empty() { "none".into() } else { offered.join(", ") });
    let compressed = !offered.is_empty() && offered.iter().all(|name| COMPRESSED.contains(name));
    let why = if compressed {
        "uncompressed pictures (MJPEG is not read: a camera that offers YUYV too), "
    } else {
        ""
    };
    (found, format!("{why}one of {}", names()))
}

/// How the frames of an open camera are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The four characters.
    pub fourcc: u32,
    /// Size and packing.
    pub layout: Layout,
}

impl Picture {
    /// What the driver granted, if it can be read.
    ///
    /// # Errors
    /// What is wrong with it and what would be right.
    pub fn of(granted: &abi::PixelFormat) -> Result<Self, (String, String)> {
        let (fourcc, width, height) = (granted.fourcc, granted.width, granted.height);
        let format = format(fourcc, yuv(granted)).ok_or_else(|| none_of(&[&name(fourcc)]))?;
        if width > MAX_SIDE || height > MAX_SIDE {
            return Err((format!("{width} x {height} pixels"), format!("at most {MAX_SIDE} on each side")));
        }
        // Some drivers leave the stride to the reader.
        let stride = match granted.bytes_per_line as usize {
            0 => format.line_bytes(width),
            stride => stride,
        };
        if stride > MAX_STRIDE {
            return Err((format!("{stride} bytes per line"), format!("at most {MAX_STRIDE}")));
        }
        let layout = Layout::try_new(format, width, height, stride).map_err(|error| match error {
            LayoutError::BadLine { found, expected } => (
                format!("{found} bytes per line"),
                format!("at least {expected} for {width} pixels of {}", name(fourcc)),
            ),
            LayoutError::OddSize => {
                let even = if pairs_rows(format) { "columns and rows" } else { "columns" };
                (
                    format!("{width} x {height} pixels of {}", name(fourcc)),
                    format!("an even number of {even}: choose another size="),
                )
            }
            _ => (format!("{width} x {height} pixels"), "1 to 67108864 in all".into()),
        })?;
        Ok(Self { fourcc, layout })
    }

    /// Columns.
    #[must_use]
    pub const fn width(&self) -> u32 {
        self.layout.width()
    }

    /// Rows.
    #[must_use]
    pub const fn height(&self) -> u32 {
        self.layout.height()
    }

    /// Whether codes are what the sensor gave and so follow the light linearly.
    #[must_use]
    pub const fn is_raw(&self) -> bool {
        self.layout.format().pattern().is_some()
    }

    /// What luma and chroma mean, where that is what samples are.
    #[must_use]
    pub const fn yuv(&self) -> Option<Yuv> {
        match self.layout.format() {
            Format::Yuyv(yuv) | Format::Nv12(yuv) => Some(yuv),
            _ => None,
        }
    }

    /// Largest code of a sample.
    #[must_use]
    pub fn max_code(&self) -> f64 {
        f64::from(self.layout.format().max_code())
    }
}

/// Whether a format's rows go in pairs, as its columns do.
const fn pairs_rows(format: Format) -> bool {
    format.pattern().is_some() || matches!(format, Format::Nv12(_))
}

/// What the driver says of luma and chroma; left open, the colour space decides.
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
    fn names_are_read_back_and_strange_ones_are_printable() {
        for text in ["YUYV", "pBAA", "Y8"] {
            assert_eq!(parse(text).map(name).as_deref(), Some(text), "{text}");
        }
        assert_eq!((parse(""), parse("YUYVX"), parse("Y\nYV")), (None, None, None), "refused");
        assert_eq!(name(u32::from_le_bytes([b'Y', 0, 0xff, b'\n'])), "Y???", "printable");
    }

    #[test]
    fn the_core_reads_what_is_taken_from_cameras() {
        for (place, name) in Format::fourccs().enumerate() {
            let fourcc = u32::from_le_bytes(name);
            assert_eq!(rank(fourcc), Some(place), "each once");
            assert!(format(fourcc, Yuv::default()).is_some(), "{}", super::name(fourcc));
        }
    }

    fn granted(name: &str, width: u32, height: u32, bytes_per_line: u32) -> abi::PixelFormat {
        let fourcc = parse(name).expect("a name");
        abi::PixelFormat { width, height, fourcc, bytes_per_line, ..abi::PixelFormat::default() }
    }

    #[test]
    fn what_a_driver_grants_is_checked() {
        let yuyv = |stride| Picture::of(&granted("YUYV", 640, 480, stride));
        assert_eq!(yuyv(1280).map(|p| p.layout.frame_bytes()), Ok(614_400), "whole");
        assert_eq!(yuyv(0).map(|p| p.layout.bytes_per_line()), Ok(1280), "left to us");
        assert!(yuyv(1279).is_err() && yuyv(u32::MAX).is_err(), "stride");
        assert!(
            Picture::of(&granted("XXXX", 640, 480, 1280)).is_err_and(|(found, _)| found.contains("XXXX")),
            "unknown"
        );
        assert!(Picture::of(&granted("YUYV", 0, 480, 0)).is_err(), "nothing");
        let full = abi::PixelFormat { quantization: abi::FULL_RANGE, ..granted("YUYV", 640, 480, 1280) };
        assert!(Picture::of(&full).is_ok_and(|p| p.yuv().is_some_and(|yuv| !yuv.limited)), "full range");
        assert!(yuyv(1280).is_ok_and(|p| p.yuv().is_some_and(|yuv| yuv.limited)), "limited by default");
    }

    /// Strides by the kernel's documentation of the formats: packed ones hold whole groups.
    #[test]
    fn odd_sizes_are_taken_where_samples_stand_alone_and_refused_in_a_line_elsewhere() {
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
            let (found, expected) = Picture::of(&granted(name, width, height, 0)).expect_err(name);
            assert!(
                found == format!("{width} x {height} pixels of {name}") && expected.contains(told),
                "{found}, expected {expected}"
            );
        }
        // 642 pixels of ten bits are 802.5 bytes, but the last two pixels' low bits lie in the last byte of a group of five.
        let (found, expected) = Picture::of(&granted("pBAA", 642, 480, 803)).expect_err("a cut group");
        assert!(
            found == "803 bytes per line" && expected.starts_with("at least 805"),
            "{found}, expected {expected}"
        );
    }

    #[test]
    fn a_camera_of_compressed_pictures_alone_is_told_so() {
        let (found, expected) = none_of(&["MJPG"]);
        assert!(
            found.contains("MJPG") && expected.contains("MJPEG is not read") && expected.contains("YUYV"),
            "{found}, {expected}"
        );
        assert!(!none_of(&["H264"]).1.contains("MJPEG"), "another");
    }
}
