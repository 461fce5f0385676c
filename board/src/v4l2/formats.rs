//! Pixel formats by their four characters, and which of a camera's to take.

use super::abi;

/// How the samples of a frame lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Y U Y V: two pixels in four bytes.
    Yuyv,
    /// Red, green, blue.
    Rgb24,
    /// Blue, green, red.
    Bgr24,
    /// One byte a pixel.
    Grey,
    /// A plane of Y, then one of U V pairs of two by two pixels.
    Nv12,
    /// One byte a pixel behind a colour mosaic.
    Bayer8(Mosaic),
    /// Four pixels in five bytes; the fifth holds the low bits, pixel 0 lowest.
    Bayer10Packed(Mosaic),
    /// Two pixels in three bytes; the third holds the low bits, pixel 0 lowest.
    Bayer12Packed(Mosaic),
    /// Two bytes a pixel, little end first, of which so many bits are used.
    Bayer16(Mosaic, u32),
}

/// Where red lies in each two by two pixels: column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mosaic {
    /// Column of red, 0 or 1; blue has the other.
    pub red_x: u32,
    /// Row of red, 0 or 1; blue has the other.
    pub red_y: u32,
}

const BGGR: Mosaic = Mosaic { red_x: 1, red_y: 1 };
const GBRG: Mosaic = Mosaic { red_x: 0, red_y: 1 };
const GRBG: Mosaic = Mosaic { red_x: 1, red_y: 0 };
const RGGB: Mosaic = Mosaic { red_x: 0, red_y: 0 };

/// What is read, best first: linear sensor codes, the more bits the better and the fewer bytes the better; then pictures made by the
/// camera, with more of their colour first; grey at the end.
const KNOWN: [(&[u8; 4], Layout); 25] = [
    (b"pBCC", Layout::Bayer12Packed(BGGR)),
    (b"pGCC", Layout::Bayer12Packed(GBRG)),
    (b"pgCC", Layout::Bayer12Packed(GRBG)),
    (b"pRCC", Layout::Bayer12Packed(RGGB)),
    (b"pBAA", Layout::Bayer10Packed(BGGR)),
    (b"pGAA", Layout::Bayer10Packed(GBRG)),
    (b"pgAA", Layout::Bayer10Packed(GRBG)),
    (b"pRAA", Layout::Bayer10Packed(RGGB)),
    (b"BG12", Layout::Bayer16(BGGR, 12)),
    (b"GB12", Layout::Bayer16(GBRG, 12)),
    (b"BA12", Layout::Bayer16(GRBG, 12)),
    (b"RG12", Layout::Bayer16(RGGB, 12)),
    (b"BG10", Layout::Bayer16(BGGR, 10)),
    (b"GB10", Layout::Bayer16(GBRG, 10)),
    (b"BA10", Layout::Bayer16(GRBG, 10)),
    (b"RG10", Layout::Bayer16(RGGB, 10)),
    (b"BA81", Layout::Bayer8(BGGR)),
    (b"GBRG", Layout::Bayer8(GBRG)),
    (b"GRBG", Layout::Bayer8(GRBG)),
    (b"RGGB", Layout::Bayer8(RGGB)),
    (b"YUYV", Layout::Yuyv),
    (b"NV12", Layout::Nv12),
    (b"RGB3", Layout::Rgb24),
    (b"BGR3", Layout::Bgr24),
    (b"GREY", Layout::Grey),
];

/// Place of `fourcc` among the formats that are read, 0 the best.
#[must_use]
pub fn rank(fourcc: u32) -> Option<usize> {
    KNOWN.iter().position(|(name, _)| u32::from_le_bytes(**name) == fourcc)
}

/// How frames of `fourcc` lie in memory; `None` where they cannot be read.
#[must_use]
pub fn layout(fourcc: u32) -> Option<Layout> {
    rank(fourcc).map(|at| KNOWN[at].1)
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
    KNOWN.map(|(n, _)| name(u32::from_le_bytes(*n))).join(", ")
}

impl Layout {
    /// Fewest bytes of a row of `width` pixels.
    #[must_use]
    pub const fn row_bytes(self, width: u32) -> u32 {
        let samples = match self {
            Self::Yuyv => return width.next_multiple_of(2).saturating_mul(2),
            Self::Rgb24 | Self::Bgr24 => return width.saturating_mul(3),
            Self::Bayer16(..) => return width.saturating_mul(2),
            Self::Grey | Self::Nv12 | Self::Bayer8(_) => return width,
            Self::Bayer10Packed(_) => width.saturating_mul(10),
            Self::Bayer12Packed(_) => width.saturating_mul(12),
        };
        samples.div_ceil(8)
    }

    /// Fewest bytes of a frame of `height` rows, `stride` bytes apart.
    #[must_use]
    pub const fn frame_bytes(self, stride: u32, height: u32) -> usize {
        let rows = match self {
            Self::Nv12 => height as usize + height.div_ceil(2) as usize,
            _ => height as usize,
        };
        stride as usize * rows
    }

    /// Bits of a sample.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            Self::Bayer10Packed(_) => 10,
            Self::Bayer12Packed(_) => 12,
            Self::Bayer16(_, bits) => bits,
            _ => 8,
        }
    }

    /// Whether codes are what the sensor gave and so follow the light linearly.
    #[must_use]
    pub const fn is_raw(self) -> bool {
        matches!(self, Self::Bayer8(_) | Self::Bayer10Packed(_) | Self::Bayer12Packed(_) | Self::Bayer16(..))
    }

    /// Whether samples are luma and chroma.
    #[must_use]
    pub const fn is_yuv(self) -> bool {
        matches!(self, Self::Yuyv | Self::Nv12)
    }
}

/// How the frames of an open camera are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The four characters.
    pub fourcc: u32,
    /// The same, understood.
    pub layout: Layout,
    /// Bytes from row to row.
    pub stride: u32,
    /// Whether luma goes from 0 to 255 (else from 16 to 235).
    pub full_range: bool,
    /// Whether chroma is BT.709's (else BT.601's).
    pub bt709: bool,
}

impl Picture {
    /// What the driver granted, if it can be read.
    ///
    /// # Errors
    /// What is wrong with it and what would be right.
    pub fn of(granted: &abi::PixelFormat) -> Result<Self, (String, String)> {
        let layout = layout(granted.fourcc).ok_or_else(|| {
            (format!("pixel format {}", name(granted.fourcc)), format!("one of {}", names()))
        })?;
        let (width, height) = (granted.width, granted.height);
        if !(2..=1 << 14).contains(&width) || !(2..=1 << 14).contains(&height) {
            return Err((format!("{width} x {height} pixels"), "2 to 16384 on each side".into()));
        }
        // Some drivers leave the stride to the reader.
        let stride =
            if granted.bytes_per_line == 0 { layout.row_bytes(width) } else { granted.bytes_per_line };
        if stride < layout.row_bytes(width) || stride > 1 << 18 {
            let least = layout.row_bytes(width);
            return Err((format!("{stride} bytes per line"), format!("at least {least} for {width} pixels")));
        }
        let jpeg = granted.colorspace == abi::COLORSPACE_JPEG;
        let full_range = match granted.quantization {
            0 => jpeg || !layout.is_yuv(),
            q => q == abi::FULL_RANGE,
        };
        let bt709 = match granted.ycbcr {
            0 => granted.colorspace == abi::COLORSPACE_709,
            e => e == abi::YCBCR_709,
        };
        Ok(Self { width, height, fourcc: granted.fourcc, layout, stride, full_range, bt709 })
    }

    /// Fewest bytes of a whole frame.
    #[must_use]
    pub const fn frame_bytes(&self) -> usize {
        self.layout.frame_bytes(self.stride, self.height)
    }
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

    /// Strides from the kernel's documentation of the formats and from the Raspberry Pi's drivers.
    #[test]
    fn rows_take_the_documented_bytes() {
        let bytes = |name: &str, width| layout(parse(name).expect("a name")).expect("known").row_bytes(width);
        assert_eq!(
            (bytes("YUYV", 640), bytes("NV12", 640), bytes("RGB3", 640)),
            (1280, 640, 1920),
            "pictures"
        );
        assert_eq!((bytes("pBAA", 640), bytes("pBAA", 1296), bytes("pRCC", 640)), (800, 1620, 960), "raw");
    }

    #[test]
    fn what_a_driver_grants_is_checked() {
        let granted = |stride| abi::PixelFormat {
            width: 640,
            height: 480,
            fourcc: parse("YUYV").expect("a name"),
            bytes_per_line: stride,
            ..abi::PixelFormat::default()
        };
        assert_eq!(Picture::of(&granted(1280)).map(|p| p.frame_bytes()), Ok(614_400), "whole");
        assert_eq!(Picture::of(&granted(0)).map(|p| p.stride), Ok(1280), "left to us");
        assert!(Picture::of(&granted(1279)).is_err() && Picture::of(&granted(u32::MAX)).is_err(), "stride");
        let odd = abi::PixelFormat { fourcc: parse("XXXX").expect("a name"), ..granted(1280) };
        assert!(Picture::of(&odd).is_err_and(|(found, _)| found.contains("XXXX")), "unknown");
        let full = abi::PixelFormat { quantization: abi::FULL_RANGE, ..granted(1280) };
        assert!(Picture::of(&full).is_ok_and(|p| p.full_range), "full range");
        assert!(Picture::of(&granted(1280)).is_ok_and(|p| !p.full_range), "limited by default");
    }

    #[test]
    fn the_core_reads_what_is_taken_from_cameras() {
        for (name, layout) in KNOWN {
            let format =
                hemilux_core::format::Format::from_fourcc(*name, hemilux_core::format::Yuv::default())
                    .expect("a format of the core");
            assert_eq!(format.max_code(), (1 << layout.bits()) - 1, "{}", String::from_utf8_lossy(name));
            for width in [640, 644, 1296] {
                let bytes = layout.row_bytes(width) as usize;
                assert_eq!(
                    format.line_bytes(width),
                    bytes,
                    "{}, {width} columns",
                    String::from_utf8_lossy(name)
                );
            }
        }
    }
}
