//! The Halton sequence: low-discrepancy points from radical inverses in bases 2 and 3.

/// Returns point `index` of the two-dimensional Halton sequence; each coordinate is in 0..1.
#[must_use]
pub fn point(index: u32) -> [f64; 2] {
    [f64::from(index.reverse_bits()) / 4_294_967_296.0, radical_inverse(index, 3)]
}

/// Returns the radical inverse: the digits of `index` in `base`, reversed behind the radix point.
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
