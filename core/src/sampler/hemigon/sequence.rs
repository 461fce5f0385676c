//! The fixed sequence of points of the unit square.
//!
//! Points of the disk come first: their area coordinate is Halton's in base 3, their turn the one in base 2; the square's points are those
//! that the concentric map takes there. The lower hemisphere's are half a turn off the upper's, so that their errors do not add up.
//! Any prefix is well spread, and no point ever changes.
//!
//! Over nine maps of the whole sphere, mean shadowed error at 16, 64 and 256 lights in %: 15.8, 5.6, 2.3. Halton's points taken as points of
//! the square give 21.3, 8.8, 2.8, R2's 20.8, 8.3, 3.6, random ones 25, 14, 8.

use crate::sampler::halton::radical_inverse;

/// Point `index` of a hemisphere.
#[must_use]
pub fn point(lower: bool, index: u32) -> [f64; 2] {
    let number = index.saturating_add(1);
    let turn = radical_inverse(number, 2) + if lower { 0.5 } else { 0.0 };
    square(radical_inverse(number, 3), if turn < 1.0 { turn } else { turn - 1.0 })
}

/// The concentric map back from the disk: the point with area coordinate `q` and `turn`, both 0..1.
fn square(q: f64, turn: f64) -> [f64; 2] {
    let r = libm::sqrt(q);
    // Eighths of a turn past the middle of the square's side, -1..=1.
    let quarter = libm::floor(4.0 * turn + 0.5);
    let along = r * 2.0 * (4.0 * turn - quarter);
    let (a, b) = match quarter as u32 % 4 {
        0 => (r, along),
        1 => (-along, r),
        2 => (-r, -along),
        _ => (along, -r),
    };
    [(a + 1.0) / 2.0, (b + 1.0) / 2.0]
}
