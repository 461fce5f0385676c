//! The header of 72 bytes before each frame of a pipe.

use crate::v4l2::abi;
use crate::v4l2::formats::{Mismatch, Picture};
use hemilux_core::MAX_EXPOSURES;

/// Length of a header of version 1, bytes.
pub(super) const BYTES: usize = 72;

/// Largest accepted frame of a pipe, bytes.
const MAX_FRAME_BYTES: u32 = 64 << 20;

/// Ranges of the accepted exposure times, seconds, and gains.
const SECONDS: std::ops::RangeInclusive<f64> = 1e-7..=3600.0;
const GAIN: std::ops::RangeInclusive<f64> = 1e-3..=1e5;

/// The header of a frame of a pipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Header {
    /// Size, packing and pixel format of the frame.
    pub picture: Picture,
    /// Length of the frame after the header, bytes.
    pub payload: usize,
    /// Number of exposures in each burst.
    pub count: usize,
    /// Sequence number of the frame, ascending.
    pub sequence: u64,
    /// CLOCK_MONOTONIC at which the exposure of the frame began, nanoseconds; 0 where unknown.
    pub timestamp_ns: u64,
    /// Exposure time of the frame, seconds.
    pub seconds: f64,
    /// Gain of the frame: product of analogue and digital gain.
    pub gain: f64,
    /// Code of a sample that received no light.
    pub black: f64,
}

/// Returns `N` bytes of the header from position `at`; zeros beyond the end of the header.
fn field<const N: usize>(bytes: &[u8; BYTES], at: usize) -> [u8; N] {
    bytes.get(at..).and_then(|b| b.first_chunk()).copied().unwrap_or([0; N])
}

impl Header {
    /// Parses and checks the header of a frame.
    ///
    /// # Errors
    /// The field of the header with the value that was found and the values that are accepted.
    pub fn parse(bytes: &[u8; BYTES]) -> Result<Self, String> {
        let refuse = |found: String, expected: &str| Err(format!("found {found}, expected {expected}"));
        let u16_at = |at| u16::from_le_bytes(field(bytes, at));
        let u32_at = |at| u32::from_le_bytes(field(bytes, at));
        let f64_at = |at| f64::from_le_bytes(field(bytes, at));
        if field::<4>(bytes, 0) != *b"HLXF" || u16_at(4) != 1 || usize::from(u16_at(6)) != BYTES {
            let found = format!("a header that begins with {:02x?}", field::<8>(bytes, 0));
            return refuse(found, "HLXF, version 1 and 72 bytes, each of 16 bits");
        }
        let picture = picture(bytes)
            .map_err(|Mismatch { found, expected }| format!("found {found}, expected {expected}"))?;
        let (payload, whole) = (u32_at(24), picture.layout.frame_bytes());
        if payload > MAX_FRAME_BYTES || (payload as usize) < whole {
            return refuse(format!("a frame of {payload} bytes"), &format!("{whole} to {MAX_FRAME_BYTES}"));
        }
        let count = usize::from(u16_at(30));
        if !(1..=MAX_EXPOSURES).contains(&count) {
            return refuse(format!("bursts of {count} exposures"), &format!("1 to {MAX_EXPOSURES}"));
        }
        let (seconds, gain, black) = (f64_at(48), f64_at(56), f64_at(64));
        if !SECONDS.contains(&seconds) || !GAIN.contains(&gain) {
            return refuse(
                format!("an exposure of {seconds} s and gain {gain}"),
                "1e-7 to 3600 s and 0.001 to 100000",
            );
        }
        if !(0.0..picture.max_code()).contains(&black) {
            return refuse(format!("a black level of {black}"), &format!("0 to {}", picture.max_code()));
        }
        let sequence = u64::from_le_bytes(field(bytes, 32));
        let timestamp_ns = u64::from_le_bytes(field(bytes, 40));
        let payload = payload as usize;
        Ok(Self { picture, payload, count, sequence, timestamp_ns, seconds, gain, black })
    }
}

/// Returns the picture format that a header describes, with the checks that a driver's format passes.
fn picture(bytes: &[u8; BYTES]) -> Result<Picture, Mismatch> {
    let u32_at = |at| u32::from_le_bytes(field(bytes, at));
    let flags = u16::from_le_bytes(field(bytes, 28));
    Picture::of(&abi::PixelFormat {
        fourcc: u32_at(8),
        width: u32_at(12),
        height: u32_at(16),
        bytes_per_line: u32_at(20),
        quantization: if flags & 1 == 0 { abi::FULL_RANGE } else { LIMITED_RANGE },
        ycbcr: if flags & 2 == 0 { YCBCR_601 } else { abi::YCBCR_709 },
        ..abi::PixelFormat::default()
    })
}

/// The values of `V4L2_QUANTIZATION_LIM_RANGE` and `V4L2_YCBCR_ENC_601`.
const LIMITED_RANGE: u32 = 2;
const YCBCR_601: u32 = 1;
