//! Luma and chroma to red, green and blue codes, in 16-bit integers.

use super::rows::{PAIRED, Planes};
use crate::format::{Matrix, Yuv};

/// Fraction bits of the coefficients.
const BITS: u32 = 13;

/// Fraction bits of what luma and chroma add to a code: exact where luma is whole, else within 1/64 of a code before it is rounded.
const PART: u32 = 6;

/// Pairs of pixels that share their chroma, of a chunk: whole vectors of them.
const PAIRS: usize = (PAIRED / 2).next_multiple_of(8);

/// A colour matrix, 2^-[`BITS`].
struct Coefficients {
    luma: i16,
    black: i16,
    red: i16,
    green: [i16; 2],
    blue: i16,
}

impl Coefficients {
    /// From the weights of red and blue in luma: `R = Y + 2 (1 - kr) Cr` and so on.
    ///
    /// Known when the program is compiled, since a vector of 16-bit numbers times a constant takes half the instructions.
    const fn of(yuv: Yuv) -> Self {
        let (kr, kb) = match yuv.matrix {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
        };
        let kg = 1.0 - kr - kb;
        let (luma, chroma) = if yuv.limited { (255.0 / 219.0, 255.0 / 224.0) } else { (1.0, 1.0) };
        Self {
            luma: fixed(luma),
            black: if yuv.limited { 16 } else { 0 },
            red: fixed(chroma * 2.0 * (1.0 - kr)),
            green: [fixed(chroma * -2.0 * kb * (1.0 - kb) / kg), fixed(chroma * -2.0 * kr * (1.0 - kr) / kg)],
            blue: fixed(chroma * 2.0 * (1.0 - kb)),
        }
    }
}

/// The nearest number of 2^-[`BITS`].
const fn fixed(v: f64) -> i16 {
    let scaled = v * (1u32 << BITS) as f64;
    (if scaled < 0.0 { scaled - 0.5 } else { scaled + 0.5 }) as i16
}

/// A value of each pair.
type Values = [i16; PAIRS];

/// Part of a code: the sum of products, rounded down to [`PART`] fraction bits, which does not change how a whole luma plus it is
/// rounded.
#[inline(always)]
fn part(products: i32) -> i16 {
    (products >> (BITS - PART)) as i16
}

/// Room for a chunk: codes of luma of pixels and of chroma of pairs, and what chroma adds to each code.
pub(super) struct Pairs {
    luma: [i16; 2 * PAIRS],
    chroma: [Values; 2],
    parts: [Values; 3],
    /// Both chroma of each pair.
    mixed: [i16; 2 * PAIRS],
    /// How many are used.
    count: usize,
}

impl Pairs {
    pub(super) fn new() -> Self {
        Self { luma: [0; _], chroma: [[0; _]; 2], parts: [[0; _]; 3], mixed: [0; _], count: 0 }
    }

    /// For so many pairs, whose codes are then to be filled in: whole vectors, the last of which may hold what an earlier chunk left, at
    /// places that nobody reads.
    fn of(&mut self, count: usize) -> &mut Self {
        self.count = count.next_multiple_of(8).min(PAIRS);
        self
    }

    /// Paints them.
    fn paint(&mut self, yuv: Yuv, planes: &mut Planes) {
        match (yuv.matrix, yuv.limited) {
            (Matrix::Bt601, false) => self.paint_as::<false, false>(planes),
            (Matrix::Bt601, true) => self.paint_as::<false, true>(planes),
            (Matrix::Bt709, false) => self.paint_as::<true, false>(planes),
            (Matrix::Bt709, true) => self.paint_as::<true, true>(planes),
        }
    }

    /// Each step is a loop over 16-bit numbers of the same kind.
    // A name to look for its vector instructions under.
    #[inline(never)]
    fn paint_as<const BT709: bool, const LIMITED: bool>(&mut self, planes: &mut Planes) {
        let m = const {
            let matrix = if BT709 { Matrix::Bt709 } else { Matrix::Bt601 };
            Coefficients::of(Yuv { limited: LIMITED, matrix })
        };
        let product = |coefficient: i16, value: i16| i32::from(coefficient) * i32::from(value);
        let all = 0..self.count.min(PAIRS);
        let ([cb, cr], [red, green, blue]) = (&self.chroma, &mut self.parts);
        for i in all.clone() {
            red[i] = part(product(m.red, cr[i] - 128));
        }
        for i in all.clone() {
            green[i] = part(product(m.green[0], cb[i] - 128) + product(m.green[1], cr[i] - 128));
        }
        for i in all.clone() {
            blue[i] = part(product(m.blue, cb[i] - 128));
        }
        // Half a code rounds.
        const HALF: i16 = 1 << (PART - 1);
        let luma = &mut self.luma[..2 * all.end];
        if LIMITED {
            // Rounded up, since chroma is rounded down.
            let up = (1 << (BITS - PART)) - 1;
            luma.iter_mut()
                .for_each(|y| *y = part(product(m.luma, y.wrapping_sub(m.black)) + up).wrapping_add(HALF));
        } else {
            luma.iter_mut().for_each(|y| *y = (*y << PART).wrapping_add(HALF));
        }
        let code = |luma: i16, chroma: i16| (luma.saturating_add(chroma) >> PART).clamp(0, 255) as u8;
        for (plane, chroma) in planes.iter_mut().zip(&self.parts) {
            let pairs = plane.as_chunks_mut::<2>().0.iter_mut().zip(luma.as_chunks::<2>().0);
            for ((to, [y0, y1]), c) in pairs.zip(chroma) {
                *to = [code(*y0, *c), code(*y1, *c)];
            }
        }
    }
}

/// From Y0 Cb Y1 Cr.
#[inline(never)]
pub(super) fn from_yuyv(line: &[u8], yuv: Yuv, pairs: &mut Pairs, planes: &mut Planes) {
    let pairs = pairs.of(line.len() / 4);
    split(line, &mut pairs.luma, &mut pairs.mixed);
    let [cb, cr] = &mut pairs.chroma;
    let used = pairs.mixed.as_chunks::<2>().0.iter().take(pairs.count);
    for ((cb, cr), pair) in cb.iter_mut().zip(cr).zip(used) {
        [*cb, *cr] = *pair;
    }
    pairs.paint(yuv, planes);
}

/// From a row of luma and the row of Cb Cr pairs that belongs to it.
#[inline(never)]
pub(super) fn from_nv12(luma: &[u8], chroma: &[u8], yuv: Yuv, pairs: &mut Pairs, planes: &mut Planes) {
    let pairs = pairs.of(chroma.len() / 2);
    pairs.luma.iter_mut().zip(luma).for_each(|(to, y)| *to = i16::from(*y));
    let [cb, cr] = &mut pairs.chroma;
    split(chroma, cb, cr);
    pairs.paint(yuv, planes);
}

/// The first and the second of each two bytes, as the halves of one word.
#[inline(always)]
fn split(bytes: &[u8], first: &mut [i16], second: &mut [i16]) {
    for ((first, second), pair) in first.iter_mut().zip(second).zip(bytes.as_chunks::<2>().0) {
        let word = u16::from_le_bytes(*pair);
        (*first, *second) = ((word & 255) as i16, (word >> 8) as i16);
    }
}
