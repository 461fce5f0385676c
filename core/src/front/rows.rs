//! Rows of packed bytes as codes, a slice for each exposure.

use super::yuv;
use crate::format::{Format, Layout};
use crate::merge::{Codes, MAX_EXPOSURES, Samples};
use crate::plan::CHUNK;

/// Whole groups of samples that a chunk of a mosaic's row may touch.
const WORDS: usize = 2 * CHUNK + 4;

/// Whole pairs of pixels that a chunk may touch.
pub(super) const PAIRED: usize = CHUNK + 2;

/// Unpacked codes of the chunk that is being merged; none for formats that need no unpacking, whose frames then fit a small stack.
pub(super) struct Scratch<'s> {
    planes: &'s mut [[[u8; PAIRED]; 3]],
    words: &'s mut [[u16; WORDS]],
}

/// Part of an image row: the row and its first place, and how many places; those of a mosaic are its 2 x 2 cells.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub(super) row: usize,
    pub(super) first: usize,
    pub(super) len: usize,
}

impl Scratch<'_> {
    /// Calls `f` with as much as the format needs.
    pub(super) fn with<R>(format: Format, f: impl FnOnce(Scratch<'_>) -> R) -> R {
        match format {
            Format::Yuyv(_) | Format::Nv12(_) => planes(f),
            Format::Bayer16(..) | Format::Raw10(_) | Format::Raw12(_) => words(f),
            _ => f(Scratch { planes: &mut [], words: &mut [] }),
        }
    }

    /// The codes of `part` in every frame, of at most [`CHUNK`] places.
    pub(super) fn codes<'a, 'c>(
        &'a mut self,
        frames: &[Samples<'a>],
        layout: &Layout,
        part: Part,
        codes: &'c mut [Codes<'a>; MAX_EXPOSURES],
    ) -> &'c [Codes<'a>] {
        let (mut planes, mut words) = (self.planes.iter_mut(), self.words.iter_mut());
        for (slot, frame) in codes.iter_mut().zip(frames) {
            *slot = match frame {
                Samples::U16(all) => {
                    let at = part.row * (layout.bytes_per_line() / 2) + 3 * part.first;
                    Codes::Words(all.get(at..at + 3 * part.len).unwrap_or_default())
                }
                Samples::U8(all) => {
                    unpack(all, layout, part, planes.next(), words.next()).unwrap_or(Codes::NONE)
                }
            };
        }
        &codes[..frames.len().min(MAX_EXPOSURES)]
    }
}

// A stack frame of its own for each.
#[inline(never)]
fn planes<R>(f: impl FnOnce(Scratch<'_>) -> R) -> R {
    f(Scratch { planes: &mut [[[0; PAIRED]; 3]; MAX_EXPOSURES], words: &mut [] })
}

#[inline(never)]
fn words<R>(f: impl FnOnce(Scratch<'_>) -> R) -> R {
    f(Scratch { planes: &mut [], words: &mut [[0; WORDS]; MAX_EXPOSURES] })
}

/// As [`Scratch::codes`], for one frame; `None` without the room that its format needs.
fn unpack<'a>(
    all: &'a [u8],
    layout: &Layout,
    part: Part,
    planes: Option<&'a mut [[u8; PAIRED]; 3]>,
    words: Option<&'a mut [u16; WORDS]>,
) -> Option<Codes<'a>> {
    let Part { row, first, len } = part;
    let start = row * layout.bytes_per_line();
    let line = |from: usize, count: usize| all.get(start + from..start + from + count).unwrap_or_default();
    // Of two that share something, the first may lie before the part.
    let odd = first % 2;
    let pairs = (odd + len).div_ceil(2);
    Some(match layout.format() {
        Format::Rgb24 | Format::Bgr24 => Codes::Bytes(line(3 * first, 3 * len)),
        Format::Grey => Codes::Bytes(line(first, len)),
        Format::Bayer8(_) => Codes::Bytes(line(2 * first, 2 * len)),
        // Its frames are words already.
        Format::Rgb48 => Codes::NONE,
        Format::Bayer16(..) => {
            let words = words?;
            let (bytes, _) = line(4 * first, 4 * len).as_chunks::<2>();
            words.iter_mut().zip(bytes).for_each(|(word, b)| *word = u16::from_le_bytes(*b));
            some(words, 0, 2 * len)
        }
        Format::Raw10(_) => {
            let words = words?;
            let (groups, _) = line((first - odd) / 2 * 5, pairs * 5).as_chunks::<5>();
            words
                .as_chunks_mut::<4>()
                .0
                .iter_mut()
                .zip(groups)
                .for_each(|(four, group)| *four = raw10(group));
            some(words, 2 * odd, 2 * len)
        }
        Format::Raw12(_) => {
            let words = words?;
            let (groups, _) = line(3 * first, 3 * len).as_chunks::<3>();
            words.as_chunks_mut::<2>().0.iter_mut().zip(groups).for_each(|(two, group)| *two = raw12(group));
            some(words, 0, 2 * len)
        }
        Format::Yuyv(yuv) => {
            let planes = planes?;
            yuv::from_yuyv(line(2 * (first - odd), 4 * pairs), yuv, planes);
            cut(planes, odd, len)
        }
        Format::Nv12(yuv) => {
            let planes = planes?;
            let chroma = (layout.height() as usize + row / 2) * layout.bytes_per_line() + first - odd;
            let chroma = all.get(chroma..chroma + 2 * pairs).unwrap_or_default();
            yuv::from_nv12(line(first - odd, 2 * pairs), chroma, yuv, planes);
            cut(planes, odd, len)
        }
    })
}

fn some(words: &[u16; WORDS], from: usize, len: usize) -> Codes<'_> {
    Codes::Words(words.get(from..from + len).unwrap_or_default())
}

fn cut(planes: &[[u8; PAIRED]; 3], from: usize, len: usize) -> Codes<'_> {
    Codes::Planes(planes.each_ref().map(|plane| plane.get(from..from + len).unwrap_or_default()))
}

/// Four samples of 10 bits.
fn raw10(&[a, b, c, d, low]: &[u8; 5]) -> [u16; 4] {
    let low = u16::from(low);
    [
        u16::from(a) << 2 | low & 3,
        u16::from(b) << 2 | low >> 2 & 3,
        u16::from(c) << 2 | low >> 4 & 3,
        u16::from(d) << 2 | low >> 6,
    ]
}

/// Two samples of 12 bits.
fn raw12(&[a, b, low]: &[u8; 3]) -> [u16; 2] {
    let low = u16::from(low);
    [u16::from(a) << 4 | low & 15, u16::from(b) << 4 | low >> 4]
}
