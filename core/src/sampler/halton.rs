//! The Halton sequence: radical inverses of the index in bases 2 and 3.

/// Point `index` of the two-dimensional Halton sequence, each coordinate in 0..1.
///
/// A prefix of any length is well spread, and a point never changes.
#[must_use]
pub fn point(index: u32) -> [f64; 2] {
    [f64::from(index.reverse_bits()) / 4_294_967_296.0, radical_inverse(index, 3)]
}

/// The digits of `index` in `base`, mirrored at the point.
#[must_use]
pub fn radical_inverse(mut index: u32, base: u32) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while index > 0 {
        digit /= f64::from(base);
        value += digit * f64::from(index % base);
        index /= base;
    }
    value
}
