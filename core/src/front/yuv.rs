//! Luma and chroma to red, green and blue codes, in integers of four fraction bits.

use super::rows::PAIRED;
use crate::format::{Matrix, Yuv};

/// Fraction bits of the coefficients.
const BITS: u32 = 13;

/// A colour matrix, 2^-[`BITS`].
struct Coefficients {
    luma: i32,
    black: i32,
    red: i32,
    green: [i32; 2],
    blue: i32,
}

impl Coefficients {
    /// From the weights of red and blue in luma: `R = Y + 2 (1 - kr) Cr` and so on.
    fn of(yuv: Yuv) -> Self {
        let (kr, kb) = match yuv.matrix {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
        };
        let kg = 1.0 - kr - kb;
        let (luma, chroma) = if yuv.limited { (255.0 / 219.0, 255.0 / 224.0) } else { (1.0, 1.0) };
        let q = |v: f64| libm::round(v * f64::from(1u32 << BITS)) as i32;
        Self {
            luma: q(luma),
            black: if yuv.limited { 16 } else { 0 },
            red: q(chroma * 2.0 * (1.0 - kr)),
            green: [q(chroma * -2.0 * kb * (1.0 - kb) / kg), q(chroma * -2.0 * kr * (1.0 - kr) / kg)],
            blue: q(chroma * 2.0 * (1.0 - kb)),
        }
    }

    /// Red, green and blue of two pixels that share their chroma.
    #[inline(always)]
    fn rgb(&self, y: [i32; 2], cb: i32, cr: i32) -> [[u8; 2]; 3] {
        let (cb, cr) = (cb - 128, cr - 128);
        let half = 1 << (BITS - 1);
        let luma = y.map(|y| (y - self.black) * self.luma + half);
        let chroma = [self.red * cr, self.green[0] * cb + self.green[1] * cr, self.blue * cb];
        chroma.map(|c| luma.map(|y| ((y + c) >> BITS).clamp(0, 255) as u8))
    }
}

/// The planes as pairs.
fn pairs(planes: &mut [[u8; PAIRED]; 3]) -> [&mut [[u8; 2]]; 3] {
    planes.each_mut().map(|plane| plane.as_chunks_mut::<2>().0)
}

/// From Y0 Cb Y1 Cr.
pub(super) fn from_yuyv(line: &[u8], yuv: Yuv, planes: &mut [[u8; PAIRED]; 3]) {
    let m = Coefficients::of(yuv);
    let [r, g, b] = pairs(planes);
    let (groups, _) = line.as_chunks::<4>();
    for (((r, g), b), group) in r.iter_mut().zip(g).zip(b).zip(groups) {
        // As one word: four of these fill a vector.
        let word = u32::from_le_bytes(*group);
        let byte = |i: u32| (word >> (8 * i) & 255) as i32;
        [*r, *g, *b] = m.rgb([byte(0), byte(2)], byte(1), byte(3));
    }
}

/// From a row of luma and the row of Cb Cr pairs that belongs to it.
pub(super) fn from_nv12(luma: &[u8], chroma: &[u8], yuv: Yuv, planes: &mut [[u8; PAIRED]; 3]) {
    let m = Coefficients::of(yuv);
    let [r, g, b] = pairs(planes);
    let (luma, chroma) = (luma.as_chunks::<2>().0, chroma.as_chunks::<2>().0);
    for ((((r, g), b), y), c) in r.iter_mut().zip(g).zip(b).zip(luma).zip(chroma) {
        [*r, *g, *b] = m.rgb(y.map(i32::from), i32::from(c[0]), i32::from(c[1]));
    }
}
