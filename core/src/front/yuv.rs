//! Converts luma and chroma to red, green and blue codes in 16-bit integers.

use super::planes::{PAIRED, Planes};
use crate::format::{Matrix, Yuv};

/// Number of pixels per iteration of the conversion: the lanes of two 128-bit vectors.
const STEP: usize = 16;

/// Number of fraction bits of luma and of the chroma contributions: exact for full-range luma, otherwise within 1/64 of a code before
/// rounding.
const PART: u32 = 6;

/// Number of fraction bits of chroma, which fills 16 bits.
const CHROMA: u32 = 8;

/// Number of fraction bits of the chroma coefficients: the upper half of a product then has [`PART`] fraction bits.
const BITS: u32 = 16 + PART - CHROMA;

/// Number of fraction bits of the luma coefficient, whose operand is doubled first.
const LUMA_BITS: u32 = 16 - 1;

/// The coefficients of a conversion from luma and chroma in fixed point.
struct Coefficients {
    /// Factor of luma in red, green and blue, minus 1.
    luma: i16,
    /// Black level of luma, with [`PART`] fraction bits.
    black: i16,
    red: i16,
    green: [i16; 2],
    /// Coefficient of Cb in blue minus 1, since the coefficient may exceed 2.
    blue: i16,
}

impl Coefficients {
    /// Computes the coefficients from the weights kr and kb of red and blue in luma: `R = Y + 2 (1 - kr) Cr`, `B = Y + 2 (1 - kb) Cb`.
    ///
    /// Evaluated at compile time: the multiplication of a vector of 16-bit integers by a constant takes half the instructions.
    const fn of(yuv: Yuv) -> Self {
        let (kr, kb) = match yuv.matrix {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
        };
        let kg = 1.0 - kr - kb;
        let (luma, chroma) = if yuv.limited { (255.0 / 219.0, 255.0 / 224.0) } else { (1.0, 1.0) };
        let green = [chroma * -2.0 * kb * (1.0 - kb) / kg, chroma * -2.0 * kr * (1.0 - kr) / kg];
        Self {
            luma: fixed(luma - 1.0, LUMA_BITS),
            black: if yuv.limited { 16 << PART } else { 0 },
            red: fixed(chroma * 2.0 * (1.0 - kr), BITS),
            green: [fixed(green[0], BITS), fixed(green[1], BITS)],
            blue: fixed(chroma * 2.0 * (1.0 - kb) - 1.0, BITS),
        }
    }
}

/// Returns `v` rounded to `bits` fraction bits.
const fn fixed(v: f64, bits: u32) -> i16 {
    let scaled = v * (1u32 << bits) as f64;
    (if scaled < 0.0 { scaled - 0.5 } else { scaled + 0.5 }) as i16
}

#[inline(always)]
fn product(coefficient: i16, value: i16) -> i32 {
    i32::from(coefficient) * i32::from(value)
}

/// Returns the upper half of a 32-bit sum of products, rounded down.
#[inline(always)]
fn upper(products: i32) -> i16 {
    (products >> 16) as i16
}

/// Intermediate values of the conversion for the pixels of a chunk.
pub(super) struct Pairs {
    /// Luma of each pixel, with [`PART`] fraction bits.
    luma: [i16; PAIRED],
    /// Cb and Cr of each pair of pixels, 0 for grey, with [`CHROMA`] fraction bits.
    chroma: [i16; PAIRED],
    /// Contribution of chroma to red, green and blue of each pixel plus half a code for rounding, with [`PART`] fraction bits.
    parts: [[i16; PAIRED]; 3],
}

impl Pairs {
    pub(super) fn new() -> Self {
        Self { luma: [0; _], chroma: [0; _], parts: [[0; _]; 3] }
    }

    /// Converts the first `count` pixels to red, green and blue bytes in `planes`.
    fn paint(&mut self, count: usize, yuv: Yuv, planes: &mut Planes) {
        match (yuv.matrix, yuv.limited) {
            (Matrix::Bt601, false) => self.paint_as::<false, false>(count, planes),
            (Matrix::Bt601, true) => self.paint_as::<false, true>(count, planes),
            (Matrix::Bt709, false) => self.paint_as::<true, false>(count, planes),
            (Matrix::Bt709, true) => self.paint_as::<true, true>(count, planes),
        }
    }

    /// Converts the first `count` pixels in loops over 16-bit integers in whole vectors; lanes beyond `count` may hold stale values, which are
    /// not read.
    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    fn paint_as<const BT709: bool, const LIMITED: bool>(&mut self, count: usize, planes: &mut Planes) {
        let m = const {
            let matrix = if BT709 { Matrix::Bt709 } else { Matrix::Bt601 };
            Coefficients::of(Yuv { limited: LIMITED, matrix })
        };
        const HALF: i16 = 1 << (PART - 1);
        let count = STEP * count.div_ceil(STEP).min(PAIRED / STEP);
        let luma = &mut self.luma[..count];
        if LIMITED {
            for y in &mut *luma {
                // The difference is rounded up, since the contribution of chroma is rounded down.
                let below = m.black.wrapping_sub(*y);
                *y = upper(product(m.luma, below << 1)).wrapping_add(below).wrapping_neg();
            }
        }
        let pairs = self.chroma[..count].as_chunks::<2>().0;
        let [red, green, blue] = self.parts.each_mut().map(|part| &mut part[..count]);
        let (red, blue) = (red.as_chunks_mut::<2>().0, blue.as_chunks_mut::<2>().0);
        for (([cb, cr], red), blue) in pairs.iter().zip(red).zip(blue) {
            let whole = *cb >> (CHROMA - PART);
            *red = [upper(product(m.red, *cr)).wrapping_add(HALF); 2];
            *blue = [upper(product(m.blue, *cb)).wrapping_add(whole).wrapping_add(HALF); 2];
        }
        for ([cb, cr], green) in pairs.iter().zip(green.as_chunks_mut::<2>().0) {
            *green = [upper(product(m.green[0], *cb) + product(m.green[1], *cr)).wrapping_add(HALF); 2];
        }
        for (plane, part) in planes.iter_mut().zip(&self.parts) {
            for ((to, y), c) in plane[..count].iter_mut().zip(&*luma).zip(&part[..count]) {
                *to = (y.saturating_add(*c) >> PART).clamp(0, 255) as u8;
            }
        }
    }
}

/// Converts a row of bytes Y0 Cb Y1 Cr to red, green and blue bytes in `planes`.
#[inline(never)]
pub(super) fn from_yuyv(line: &[u8], yuv: Yuv, pairs: &mut Pairs, planes: &mut Planes) {
    for ((y, c), pair) in pairs.luma.iter_mut().zip(&mut pairs.chroma).zip(line.as_chunks::<2>().0) {
        let word = u16::from_le_bytes(*pair);
        (*y, *c) = (((word & 255) << PART) as i16, (word & 0xff00 ^ 0x8000) as i16);
    }
    pairs.paint(line.len() / 2, yuv, planes);
}

/// Converts a row of luma bytes and the row of Cb Cr pairs of the same pixels to red, green and blue bytes in `planes`.
#[inline(never)]
pub(super) fn from_nv12(luma: &[u8], chroma: &[u8], yuv: Yuv, pairs: &mut Pairs, planes: &mut Planes) {
    for (to, y) in pairs.luma.iter_mut().zip(luma) {
        *to = i16::from(*y) << PART;
    }
    for (to, c) in pairs.chroma.iter_mut().zip(chroma) {
        *to = (u16::from(c ^ 128) << CHROMA) as i16;
    }
    pairs.paint(luma.len(), yuv, planes);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares every luma with a grid of chroma to the formulas in floats, except within 1/40 of a code of a rounding boundary.
    #[test]
    fn rgb_codes_match_the_float_formulas() {
        for (matrix, kr, kb) in [(Matrix::Bt601, 0.299, 0.114), (Matrix::Bt709, 0.2126, 0.0722)] {
            for limited in [false, true] {
                let (mut pairs, mut planes) = (Pairs::new(), [[0; PAIRED]; 4]);
                let (black, luma, chroma) =
                    if limited { (16.0, 255.0 / 219.0, 255.0 / 224.0) } else { (0.0, 1.0, 1.0) };
                for (y, (cb, cr)) in (0..=255u8).flat_map(|y| {
                    let grid = (0..=255u8).step_by(15);
                    grid.clone().flat_map(move |cb| grid.clone().map(move |cr| (y, (cb, cr))))
                }) {
                    let line = [y, cb, 255 - y, cr];
                    from_yuyv(&line, Yuv { limited, matrix }, &mut pairs, &mut planes);
                    let [b, r] = [cb, cr].map(|c| chroma * (f64::from(c) - 128.0));
                    let (red, blue) = (2.0 * (1.0 - kr) * r, 2.0 * (1.0 - kb) * b);
                    let green = -(kr * red + kb * blue) / (1.0 - kr - kb);
                    for (i, y) in [y, 255 - y].into_iter().enumerate() {
                        for (plane, add) in planes.iter().zip([red, green, blue]) {
                            let exact = (luma * (f64::from(y) - black) + add).clamp(0.0, 255.0);
                            let off = (f64::from(plane[i]) - exact).abs();
                            assert!(off < 0.525, "{matrix:?} {limited} {line:?}: {} for {exact}", plane[i]);
                        }
                    }
                }
            }
        }
    }
}
