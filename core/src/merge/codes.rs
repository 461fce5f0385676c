//! The input of the merge: samples of frames, and unpacked codes.

use super::linear::{Code, extreme};
use crate::pixel_table::{CHUNK, MAX_RUN};

/// The samples of one frame, packed as a [`crate::format::Layout`] states.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// Bytes, for every format except [`crate::format::Format::Rgb48`].
    U8(&'a [u8]),
    /// 16-bit words, for [`crate::format::Format::Rgb48`].
    U16(&'a [u16]),
}

impl<'a> From<&'a [u8]> for Samples<'a> {
    fn from(bytes: &'a [u8]) -> Self {
        Self::U8(bytes)
    }
}

impl<'a> From<&'a [u16]> for Samples<'a> {
    fn from(words: &'a [u16]) -> Self {
        Self::U16(words)
    }
}

impl Samples<'_> {
    /// Returns the number of bytes or words of the frame.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(s) => s.len(),
            Self::U16(s) => s.len(),
        }
    }

    /// Returns whether the frame has no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The unpacked codes of a part of a frame, one per sample.
#[derive(Clone, Copy, Debug)]
pub enum Codes<'a> {
    /// Codes of 8 bits, channels interleaved.
    Bytes(&'a [u8]),
    /// Codes of up to 16 bits, channels interleaved.
    Words(&'a [u16]),
    /// Codes of 8 bits in three planes: red, green, blue.
    Planes([&'a [u8]; 3]),
    /// The codes of an exposure that is not read, because longer exposures determine every sample.
    Unread,
}

impl<'a> Codes<'a> {
    /// Codes of an exposure without samples.
    pub const NONE: Self = Self::Bytes(&[]);

    /// Returns the code of sample `at`; 0 beyond the last sample.
    pub(crate) fn code(&self, at: usize) -> u32 {
        match self {
            Self::Bytes(s) => s.get(at).copied().map_or(0, u32::from),
            Self::Words(s) => s.get(at).copied().map_or(0, u32::from),
            Self::Planes(s) => s[at % 3].get(at / 3).copied().map_or(0, u32::from),
            Self::Unread => 0,
        }
    }

    /// Returns the code of sample `at`; `None` beyond the last sample.
    pub(crate) fn get(&self, at: usize) -> Option<u16> {
        match self {
            Self::Bytes(s) => s.get(at).copied().map(u16::from),
            Self::Words(s) => s.get(at).copied(),
            Self::Planes(s) => s[at % 3].get(at / 3).copied().map(u16::from),
            Self::Unread => None,
        }
    }

    /// Returns the interleaved codes `from` to `from + len`; no codes for planes.
    pub(super) fn part(&self, from: usize, len: usize) -> Self {
        match self {
            Self::Bytes(s) => Self::Bytes(s.get(from..from + len).unwrap_or_default()),
            Self::Words(s) => Self::Words(s.get(from..from + len).unwrap_or_default()),
            Self::Planes(_) => Self::NONE,
            Self::Unread => Self::Unread,
        }
    }

    /// Returns whether the samples of the exposure are read.
    pub(crate) fn is_read(&self) -> bool {
        !matches!(self, Self::Unread)
    }

    /// Returns one bit for each block of [`MAX_RUN`] pixels of `samples` samples, set if a code of the block is `limit` or more.
    pub(crate) fn blocks_that_reach(&self, limit: u32, samples: usize) -> u32 {
        match self {
            Self::Bytes(codes) => blocks(codes, u8::max, limit, samples),
            Self::Words(codes) => blocks(codes, u16::max, limit, samples),
            Self::Planes(planes) => {
                planes.iter().fold(0, |bits, plane| bits | blocks(plane, u8::max, limit, 1))
            }
            Self::Unread => 0,
        }
    }

    /// Returns whether every code is below `limit`.
    pub(crate) fn are_below(&self, limit: u32) -> bool {
        let bytes = |codes: &[u8]| u32::from(extreme(codes, u8::max)) < limit;
        match self {
            Self::Bytes(codes) => bytes(codes),
            Self::Words(codes) => u32::from(extreme(codes, u16::max)) < limit,
            Self::Planes(planes) => planes.iter().all(|plane| bytes(plane)),
            Self::Unread => false,
        }
    }

    /// Returns the codes of channel `k` of `many` channels if they are contiguous, otherwise `None`.
    pub(super) fn plane(&self, k: usize, many: usize) -> Option<&'a [u8]> {
        match (self, many) {
            (Self::Planes(planes), 3) => planes.get(k).copied(),
            (Self::Bytes(bytes), 1) => Some(bytes),
            _ => None,
        }
    }

    pub(super) fn bytes(&self) -> Option<&'a [u8]> {
        if let Self::Bytes(s) = *self { Some(s) } else { None }
    }

    pub(super) fn words(&self) -> Option<&'a [u16]> {
        if let Self::Words(s) = *self { Some(s) } else { None }
    }
}

/// Does the work of [`Codes::blocks_that_reach`] for contiguous codes.
fn blocks<T: Code + Into<u32>>(codes: &[T], most: impl Fn(T, T) -> T, limit: u32, samples: usize) -> u32 {
    const { assert!(CHUNK <= u32::BITS as usize * MAX_RUN, "a bit for each block of a chunk") };
    let reach = |block: &[T]| u32::from(extreme(block, &most).into() >= limit);
    let blocks = codes.chunks(MAX_RUN * samples.max(1)).enumerate();
    blocks.fold(0, |bits, (index, block)| bits | reach(block).unbounded_shl(index as u32))
}

/// The channel (0 red, 1 green, 2 blue) of each sample; the pattern repeats along a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// All samples have the same channel.
    One([usize; 1]),
    /// The samples alternate between three channels.
    Three([usize; 3]),
    /// The samples alternate between four channels: those of a mosaic's 2 x 2 cell.
    Four([usize; 4]),
}

impl Channels {
    /// The samples alternate between red, green and blue.
    pub const RGB: Self = Self::Three([0, 1, 2]);

    /// Returns the length of the pattern: the number of channels that alternate.
    #[must_use]
    pub fn many(&self) -> usize {
        match self {
            Self::One(_) => 1,
            Self::Three(_) => 3,
            Self::Four(_) => 4,
        }
    }

    pub(super) fn of(&self, at: usize) -> usize {
        match self {
            Self::One([c]) => *c,
            Self::Three(c) => c[at % 3],
            Self::Four(c) => c[at % 4],
        }
    }
}
