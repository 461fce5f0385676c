//! Unpacks rows of frames into codes: one slice per exposure.

use super::bin::Bins;
use super::planes::{PAIRED, Planes};
use super::yuv::{self, Pairs};
use crate::format::{Format, Layout, raw10, raw12};
use crate::merge::{Codes, MAX_EXPOSURES, MergeView, Samples};
use crate::pixel_table::CHUNK;

/// Number of samples of a chunk, rounded up to whole pairs of mosaic cells.
const WORDS: usize = 4 * (CHUNK + 2);

/// Buffers for the unpacked codes of one chunk. Formats that need no unpacking have empty buffers, so that they take no stack.
pub(crate) struct Scratch<'s> {
    planes: &'s mut [Planes],
    /// Intermediate values of the conversion from luma and chroma; `None` if `planes` is empty.
    pairs: Option<&'s mut Pairs>,
    words: &'s mut [[u16; WORDS]],
    /// The smallest saturated code; a mean over binned samples of which one reaches it is saturated.
    saturated: u32,
}

/// A consumer of the unpacked codes of a part, such as the merge.
pub(crate) trait Reader {
    /// Returns whether the consumer reads bytes of three channels as separate planes.
    fn wants_planes(&self) -> bool;

    /// Returns whether the frames from `index` to the last suffice; `codes` are the codes of frame `index`.
    fn suffices(&self, index: usize, codes: &Codes<'_>) -> bool;
}

impl Reader for MergeView<'_> {
    fn wants_planes(&self) -> bool {
        self.wants_planes()
    }

    fn suffices(&self, index: usize, codes: &Codes<'_>) -> bool {
        self.suffices(index, codes)
    }
}

/// A part of an image row: the row, the first pixel and the number of pixels. A pixel of a mosaic is a 2 x 2 cell.
#[derive(Clone, Copy)]
pub(crate) struct Part {
    pub(crate) row: usize,
    pub(crate) first: usize,
    pub(crate) len: usize,
}

impl Scratch<'_> {
    /// Calls `f` with the buffers that `format` needs for one chunk; `wants_planes` states whether the merge reads separate planes.
    pub(crate) fn with<R>(format: Format, wants_planes: bool, f: impl FnOnce(Scratch<'_>) -> R) -> R {
        match format {
            Format::Yuyv(_) | Format::Nv12(_) | Format::Bayer8(_) => planes(f),
            Format::Rgb24 | Format::Bgr24 if wants_planes => planes(f),
            Format::Bayer16(..) | Format::Raw10(_) | Format::Raw12(_) => words(f),
            _ => f(Scratch { planes: &mut [], pairs: None, words: &mut [], saturated: u32::MAX }),
        }
    }

    /// Sets the smallest saturated code of the frames.
    pub(super) fn saturated_from(self, code: u32) -> Self {
        Self { saturated: code, ..self }
    }

    /// Unpacks `part`, of at most [`CHUNK`] pixels, from the last frame to the first until [`Reader::suffices`] returns true; the remaining
    /// frames are [`Codes::Unread`].
    // Not inlined: its locals take no stack below the merge.
    #[inline(never)]
    pub(crate) fn codes<'a, 'c>(
        &'a mut self,
        frames: &[Samples<'a>],
        layout: &Layout,
        part: Part,
        reader: &impl Reader,
        codes: &'c mut [Codes<'a>; MAX_EXPOSURES],
    ) -> &'c [Codes<'a>] {
        let slots = codes.get_mut(..frames.len().min(MAX_EXPOSURES)).unwrap_or_default();
        if let Some(bytes) =
            plain_bytes(layout.format()).filter(|bytes| !(reader.wants_planes() && *bytes == 3))
        {
            let at = part.row * layout.bytes_per_line() + bytes * part.first;
            for (i, (slot, frame)) in slots.iter_mut().zip(frames).enumerate().rev() {
                let Samples::U8(all) = frame else { continue };
                *slot = Codes::Bytes(all.get(at..at + bytes * part.len).unwrap_or_default());
                if reader.suffices(i, slot) {
                    break;
                }
            }
            return slots;
        }
        let saturated = self.saturated;
        let (mut planes, mut words) = (self.planes.iter_mut(), self.words.iter_mut());
        for (i, (slot, frame)) in slots.iter_mut().zip(frames).enumerate().rev() {
            *slot = match frame {
                Samples::U16(all) => {
                    let at = part.row * (layout.bytes_per_line() / 2) + 3 * part.first;
                    Codes::Words(all.get(at..at + 3 * part.len).unwrap_or_default())
                }
                Samples::U8(all) if layout.bin() > 1 => {
                    let bins = Bins::new(all, layout, part.row, part.first, saturated);
                    binned(&bins, layout.format(), part.len, planes.next(), words.next())
                }
                Samples::U8(all) => {
                    let planes = planes.next().zip(self.pairs.as_deref_mut());
                    unpack(all, layout, part, planes, words.next()).unwrap_or(Codes::NONE)
                }
            };
            if reader.suffices(i, slot) {
                break;
            }
        }
        slots
    }
}

/// Returns the number of bytes per pixel of a format whose bytes are codes without unpacking; `None` for other formats.
fn plain_bytes(format: Format) -> Option<usize> {
    match format {
        Format::Rgb24 | Format::Bgr24 => Some(3),
        Format::Grey => Some(1),
        _ => None,
    }
}

// Not inlined: the buffers of each kind take stack only in their own function.
#[inline(never)]
fn planes<R>(f: impl FnOnce(Scratch<'_>) -> R) -> R {
    let planes = &mut [[[0; PAIRED]; 4]; MAX_EXPOSURES];
    f(Scratch { planes, pairs: Some(&mut Pairs::new()), words: &mut [], saturated: u32::MAX })
}

#[inline(never)]
fn words<R>(f: impl FnOnce(Scratch<'_>) -> R) -> R {
    f(Scratch { planes: &mut [], pairs: None, words: &mut [[0; WORDS]; MAX_EXPOSURES], saturated: u32::MAX })
}

/// Unpacks `part` of one frame of a packed format into codes; `None` if the buffers that the format needs are absent.
#[inline(never)]
fn unpack<'a>(
    all: &[u8],
    layout: &Layout,
    part: Part,
    planes: Option<(&'a mut Planes, &mut Pairs)>,
    words: Option<&'a mut [u16; WORDS]>,
) -> Option<Codes<'a>> {
    let Part { row, first, len } = part;
    let at = |row: usize, from: usize, count: usize| {
        let start = row * layout.bytes_per_line() + from;
        // The last row of a frame may end within a pair of cells.
        all.get(start..(start + count).min(all.len())).unwrap_or_default()
    };
    // Two pixels that share bytes are unpacked together, from the even pixel on.
    let odd = first % 2;
    let (first, pairs) = (first - odd, (odd + len).div_ceil(2));
    // `rows` returns the two rows of a mosaic's cells, as slices of `bytes` per two cells.
    let rows = |bytes: usize| [0, 1].map(|i| at(2 * row + i, bytes * (first / 2), bytes * pairs));
    match layout.format() {
        // These formats need no unpacking.
        Format::Grey | Format::Rgb48 => None,
        Format::Rgb24 | Format::Bgr24 => {
            let (pixels, _) = at(row, 3 * part.first, 3 * len).as_chunks::<3>();
            let (planes, _) = planes?;
            let [r, g, b, _] = planes.each_mut();
            for (((r, g), b), pixel) in r.iter_mut().zip(g).zip(b).zip(pixels) {
                (*r, *g, *b) = (pixel[0], pixel[1], pixel[2]);
            }
            Some(cut(planes, 0, len))
        }
        Format::Bayer8(_) => {
            let bytes = planes?.0.as_flattened_mut();
            two_cells(rows(4), bytes, |four: &[u8; 4]| *four);
            Some(Codes::Bytes(bytes.get(4 * odd..4 * (odd + len)).unwrap_or_default()))
        }
        Format::Bayer16(..) => {
            let of = |b: &[u8; 8]| [0, 2, 4, 6].map(|i| u16::from_le_bytes([b[i], b[i + 1]]));
            words.map(|words| cells(rows(8), words, odd, len, of))
        }
        Format::Raw10(_) => words.map(|words| cells(rows(5), words, odd, len, raw10)),
        Format::Raw12(_) => {
            let of = |[a, b, c, d, e, f]: &[u8; 6]| {
                let ([a, b], [c, d]) = (raw12(&[*a, *b, *c]), raw12(&[*d, *e, *f]));
                [a, b, c, d]
            };
            words.map(|words| cells(rows(6), words, odd, len, of))
        }
        Format::Yuyv(yuv) => {
            let (planes, room) = planes?;
            yuv::from_yuyv(at(row, 2 * first, 4 * pairs), yuv, room, planes);
            Some(cut(planes, odd, len))
        }
        Format::Nv12(yuv) => {
            let (planes, room) = planes?;
            let chroma = at(layout.height() as usize + row / 2, first, 2 * pairs);
            yuv::from_nv12(at(row, first, 2 * pairs), chroma, yuv, room, planes);
            Some(cut(planes, odd, len))
        }
    }
}

/// Unpacks the means of a binned mosaic: means of bytes go to `planes`, those of larger codes to `words`.
fn binned<'a>(
    bins: &Bins<'_>,
    format: Format,
    len: usize,
    planes: Option<&'a mut Planes>,
    words: Option<&'a mut [u16; WORDS]>,
) -> Codes<'a> {
    match (planes, words) {
        (Some(planes), _) => {
            let bytes = planes.as_flattened_mut();
            binned_bytes(bins, format, bytes.as_chunks_mut::<4>().0.get_mut(..len).unwrap_or_default());
            Codes::Bytes(bytes.get(..4 * len).unwrap_or_default())
        }
        (None, Some(words)) => {
            bins.read(format, words.as_chunks_mut::<4>().0.get_mut(..len).unwrap_or_default());
            Codes::Words(words.get(..4 * len).unwrap_or_default())
        }
        (None, None) => Codes::NONE,
    }
}

#[inline(never)]
fn binned_bytes(bins: &Bins<'_>, format: Format, out: &mut [[u8; 4]]) {
    let mut means = [[0u16; 4]; CHUNK];
    let means = means.get_mut(..out.len()).unwrap_or_default();
    bins.read(format, means);
    out.iter_mut().zip(means).for_each(|(bytes, codes)| *bytes = codes.map(|code| code as u8));
}

/// Unpacks two rows of a mosaic into cells, and returns `len` cells from cell `odd`.
#[inline(always)]
fn cells<'a, const B: usize>(
    rows: [&[u8]; 2],
    words: &'a mut [u16; WORDS],
    odd: usize,
    len: usize,
    unpacked: impl Fn(&[u8; B]) -> [u16; 4],
) -> Codes<'a> {
    two_cells(rows, words, unpacked);
    Codes::Words(words.get(4 * odd..4 * (odd + len)).unwrap_or_default())
}

/// Interleaves two rows of a mosaic's samples into 2 x 2 cells; `unpacked` converts `B` bytes to four samples.
#[inline(always)]
fn two_cells<T, const B: usize>(rows: [&[u8]; 2], out: &mut [T], unpacked: impl Fn(&[u8; B]) -> [T; 4]) {
    let [first, second] = rows.map(|row| row.as_chunks::<B>().0);
    for (out, (first, second)) in out.as_chunks_mut::<8>().0.iter_mut().zip(first.iter().zip(second)) {
        let ([a, b, e, f], [c, d, g, h]) = (unpacked(first), unpacked(second));
        *out = [a, b, c, d, e, f, g, h];
    }
    let whole = first.len().min(second.len());
    if rows[0].len().max(rows[1].len()) > B * whole {
        two_cells_of_a_rest(rows, whole, out, unpacked);
    }
}

/// Interleaves the bytes after `whole` groups of `B` bytes, where a frame ends within a group; the missing bytes count as 0.
#[cold]
#[inline(never)]
fn two_cells_of_a_rest<T, const B: usize>(
    rows: [&[u8]; 2],
    whole: usize,
    out: &mut [T],
    unpacked: impl Fn(&[u8; B]) -> [T; 4],
) {
    let [[a, b, e, f], [c, d, g, h]] = rows.map(|row| {
        let mut group = [0; B];
        let rest = row.get(B * whole..).unwrap_or_default();
        group.iter_mut().zip(rest).for_each(|(to, byte)| *to = *byte);
        unpacked(&group)
    });
    if let Some(out) = out.as_chunks_mut::<8>().0.get_mut(whole) {
        *out = [a, b, c, d, e, f, g, h];
    }
}

/// Returns the columns `from` to `from + len` of the first three planes.
fn cut(planes: &Planes, from: usize, len: usize) -> Codes<'_> {
    let [r, g, b, _] = planes.each_ref().map(|plane| plane.get(from..from + len).unwrap_or_default());
    Codes::Planes([r, g, b])
}
