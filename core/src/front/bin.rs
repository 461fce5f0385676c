//! Bins the samples of a mosaic: the mean over `bin` x `bin` cells of each sample position is one sample of a binned cell.
//!
//! A mean over samples of which one is saturated is saturated: a mean of clipped and unclipped codes would count as valid and darken the
//! edges of lamps.

use crate::format::{Format, Layout, raw10, raw12};

/// The mosaic bytes from which the binned cells of a part of a row are computed.
#[derive(Clone, Copy)]
pub(super) struct Bins<'a> {
    /// The frame's bytes from the first mosaic row of the part on.
    pub(super) bytes: &'a [u8],
    /// Row pitch of the frame, bytes.
    pub(super) pitch: usize,
    /// Index in its row of the first binned cell.
    pub(super) first: usize,
    /// Binary logarithm of the number of cells that form a binned cell on each side, at least 1.
    pub(super) log2: u32,
    /// Smallest sample code that counts as saturated.
    pub(super) saturated: u16,
    /// Largest code of the format, which represents a saturated mean.
    pub(super) most: u16,
}

impl<'a> Bins<'a> {
    pub(super) fn new(bytes: &'a [u8], layout: &Layout, row: usize, first: usize, saturated: u32) -> Self {
        let (pitch, log2) = (layout.bytes_per_line(), layout.bin_log2());
        let most = layout.format().max_code().min(u32::from(u16::MAX)) as u16;
        let bytes = bytes.get((row * pitch) << (log2 + 1)..).unwrap_or_default();
        Self { bytes, pitch, first, log2, saturated: saturated.min(u32::from(most)) as u16, most }
    }

    /// Writes the four means of each binned cell to `out`.
    #[inline(never)]
    pub(super) fn read(&self, format: Format, out: &mut [[u16; 4]]) {
        let twelve = |[a, b, c, d, e, f]: &[u8; 6]| {
            let ([a, b], [c, d]) = (raw12(&[*a, *b, *c]), raw12(&[*d, *e, *f]));
            [a, b, c, d]
        };
        match format {
            Format::Raw10(_) if self.log2 == 1 => self.raw10_by_2(out),
            Format::Raw10(_) => self.mean(out, raw10),
            Format::Raw12(_) => self.mean(out, twelve),
            Format::Bayer8(_) => self.mean(out, |four: &[u8; 4]| four.map(u16::from)),
            Format::Bayer16(..) => {
                self.mean(out, |b: &[u8; 8]| [0, 2, 4, 6].map(|i| u16::from_le_bytes([b[i], b[i + 1]])));
            }
            _ => {}
        }
    }

    /// Returns the groups of `B` bytes in row `row` of the part, from the first binned cell on.
    #[inline(always)]
    fn groups<const B: usize>(&self, row: usize) -> &'a [[u8; B]] {
        let from = row * self.pitch + B * ((self.first << self.log2) / 2);
        self.bytes.get(from..).unwrap_or_default().as_chunks::<B>().0
    }

    /// Writes the means of the binned cells to `out`, in any packing; `unpacked` converts `B` bytes to four samples.
    #[inline(always)]
    fn mean<const B: usize>(&self, out: &mut [[u16; 4]], unpacked: impl Fn(&[u8; B]) -> [u16; 4]) {
        let (groups, shift) = ((1usize << self.log2) / 2, 2 * self.log2);
        for (i, out) in out.iter_mut().enumerate() {
            let (mut sums, mut largest) = ([0u32; 4], [0u16; 4]);
            for row in 0..2usize << self.log2 {
                let all = self.groups::<B>(row).get(groups * i..groups * (i + 1)).unwrap_or_default();
                for group in all {
                    let [a, b, c, d] = unpacked(group);
                    for (at, pair) in [(2 * (row % 2), [a, c]), (2 * (row % 2) + 1, [b, d])] {
                        sums[at] += u32::from(pair[0]) + u32::from(pair[1]);
                        largest[at] = largest[at].max(pair[0]).max(pair[1]);
                    }
                }
            }
            *out = core::array::from_fn(|at| match largest[at] >= self.saturated {
                true => self.most,
                false => ((sums[at] + ((1 << shift) >> 1)) >> shift) as u16,
            });
        }
    }

    /// Writes the means of 2 x 2 cells of packed 10-bit samples: the upper bytes of two samples of a colour are added as halves of a word.
    fn raw10_by_2(&self, out: &mut [[u16; 4]]) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|row| self.groups::<5>(row));
        let (above, below) = (a.iter().zip(c), b.iter().zip(d));
        for (out, (above, below)) in out.iter_mut().zip(above.zip(below)) {
            let ([red, green], [other, blue]) = (self.pair(above), self.pair(below));
            *out = [red, green, other, blue];
        }
    }

    /// Returns the means of the two colours in the two rows of a group of four samples per row.
    #[inline(always)]
    fn pair(&self, (first, second): (&[u8; 5], &[u8; 5])) -> [u16; 2] {
        let upper = |group: &[u8; 5]| group.first_chunk().map_or(0, |four| u32::from_le_bytes(*four));
        let (u, v) = (upper(first), upper(second));
        let (p, q) = (u32::from(first[4]), u32::from(second[4]));
        let mean = |shift: u32| {
            let halves = (u >> (4 * shift) & 0x00ff_00ff) + (v >> (4 * shift) & 0x00ff_00ff);
            let low = (p >> shift & 0x33) + (q >> shift & 0x33);
            let (upper, low) = ((halves & 0xffff) + (halves >> 16), (low & 15) + (low >> 4));
            upper + ((low + 2) >> 2)
        };
        let (even, odd) = (mean(0), mean(2));
        // A single saturated sample raises the mean of four to at least a quarter of its code.
        if even.max(odd) < u32::from(self.saturated) / 4 {
            return [even as u16, odd as u16];
        }
        self.checked([even, odd], raw10(first), raw10(second))
    }

    /// Returns the means of two colours, each replaced by the largest code if a sample of the colour is saturated; the arrays are the
    /// samples of the two rows.
    fn checked(&self, means: [u32; 2], [a, b, c, d]: [u16; 4], [e, f, g, h]: [u16; 4]) -> [u16; 2] {
        let largest = [a.max(c).max(e).max(g), b.max(d).max(f).max(h)];
        core::array::from_fn(|i| if largest[i] >= self.saturated { self.most } else { means[i] as u16 })
    }
}
