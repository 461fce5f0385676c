//! Media bus codes: the formats of samples between a sensor and a node.

use crate::v4l2::abi::BusCode;
use crate::v4l2::{Call, Node, formats, persist};
use hemilux_core::format::{Format, Pattern, Yuv};

/// Largest number of media bus codes that are read from a pad.
const MOST_CODES: u32 = 128;

/// The samples that a media bus code carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Carried {
    /// A mosaic with this number of bits per sample.
    Mosaic(u32, Pattern),
    /// Samples that nodes deliver in the format with this FourCC.
    Samples(&'static str),
}

/// Readable media bus codes, the most preferred first: mosaics by number of bits, then colours, then grey.
const CODES: [(u32, Carried); 25] = [
    (0x301d, Carried::Mosaic(16, Pattern::Bggr)),
    (0x301e, Carried::Mosaic(16, Pattern::Gbrg)),
    (0x301f, Carried::Mosaic(16, Pattern::Grbg)),
    (0x3020, Carried::Mosaic(16, Pattern::Rggb)),
    (0x3019, Carried::Mosaic(14, Pattern::Bggr)),
    (0x301a, Carried::Mosaic(14, Pattern::Gbrg)),
    (0x301b, Carried::Mosaic(14, Pattern::Grbg)),
    (0x301c, Carried::Mosaic(14, Pattern::Rggb)),
    (0x3008, Carried::Mosaic(12, Pattern::Bggr)),
    (0x3010, Carried::Mosaic(12, Pattern::Gbrg)),
    (0x3011, Carried::Mosaic(12, Pattern::Grbg)),
    (0x3012, Carried::Mosaic(12, Pattern::Rggb)),
    (0x3007, Carried::Mosaic(10, Pattern::Bggr)),
    (0x300e, Carried::Mosaic(10, Pattern::Gbrg)),
    (0x300a, Carried::Mosaic(10, Pattern::Grbg)),
    (0x300f, Carried::Mosaic(10, Pattern::Rggb)),
    (0x3001, Carried::Mosaic(8, Pattern::Bggr)),
    (0x3013, Carried::Mosaic(8, Pattern::Gbrg)),
    (0x3002, Carried::Mosaic(8, Pattern::Grbg)),
    (0x3014, Carried::Mosaic(8, Pattern::Rggb)),
    (0x100a, Carried::Samples("RGB3")),
    (0x1013, Carried::Samples("BGR3")),
    (0x2008, Carried::Samples("YUYV")),
    (0x2011, Carried::Samples("YUYV")),
    (0x2001, Carried::Samples("GREY")),
];

fn carried(code: u32) -> Option<Carried> {
    CODES.iter().find(|(known, _)| *known == code).map(|(_, carried)| *carried)
}

/// Returns whether this program can read samples of `code`.
#[must_use]
pub fn is_read(code: u32) -> bool {
    carried(code).is_some()
}

/// Returns the media bus codes that `pad` of a sub-device offers.
pub(in crate::v4l2) fn offered(node: &mut dyn Node, pad: u32) -> Vec<u32> {
    let mut offered = Vec::new();
    for index in 0..MOST_CODES {
        let mut code = BusCode { pad, index, ..Default::default() };
        if persist(|| node.call(Call::EnumBusCodes(&mut code))).is_err() {
            break;
        }
        offered.push(code.code);
    }
    offered
}

/// Returns the readable codes of `offered`, the most preferred first.
#[must_use]
pub fn ranked(offered: &[u32]) -> Vec<u32> {
    CODES.iter().map(|(code, _)| *code).filter(|code| offered.contains(code)).collect()
}

/// Returns whether a node delivers samples of `code` as frames of `fourcc`.
#[must_use]
pub fn fits(code: u32, fourcc: u32) -> bool {
    match (carried(code), formats::format(fourcc, Yuv::default())) {
        (Some(Carried::Mosaic(bits, pattern)), Some(f)) => is_mosaic(f, bits, pattern),
        (Some(Carried::Samples(name)), Some(_)) => formats::name(fourcc) == name,
        _ => false,
    }
}

fn is_mosaic(format: Format, bits: u32, pattern: Pattern) -> bool {
    format.pattern() == Some(pattern) && format.max_code() == (1 << bits) - 1
}
