//! The kernel K and its derivative in fixed point, from a table over the squared sine of half an angle.
//!
//! The entries of an octave have equal steps, so that the step is proportional to the argument and the error to the kernel's distance from
//! its kink at 0. An entry has the tangent of K at its centre.

use super::kernel::KERNEL;

/// Number of fractional bits of a squared sine: 1 is the argument between opposite directions.
pub(super) const SQUARE_BITS: u32 = 30;

/// Number of fractional bits of K.
pub(super) const KERNEL_BITS: u32 = 14;

/// Number of fractional bits of the derivative of K.
pub(super) const SLOPE_BITS: u32 = 10;

/// The smallest argument of the table is 2 to this power, in units of 2^-30: the squared sine of 0.11 degrees. Smaller arguments count as this one.
const LEAST_BITS: u32 = 12;

/// Number of entries in an octave is 2 to this power.
const STEP_BITS: u32 = 5;

const ENTRIES: usize = 1 << 10;

/// The tangent of K over the squared sine, at the centre of an entry: in the upper half its value at 0, with [`KERNEL_BITS`] fractional bits, in
/// the lower half the derivative with respect to the cosine, with [`SLOPE_BITS`] fractional bits.
static TANGENTS: [u32; ENTRIES] = tangents();

/// Returns `squared`, the squared sine of half an angle with [`SQUARE_BITS`] fractional bits, limited to the range of the table.
#[inline(always)]
pub(super) fn limited(squared: i32) -> i32 {
    squared.clamp(1 << LEAST_BITS, (1 << SQUARE_BITS) - 1)
}

/// Returns the index of the tangent at `squared`, which is [`limited`].
#[inline(always)]
pub(super) fn index(squared: i32) -> u32 {
    let zeros = (squared as u32).leading_zeros();
    // The leading bit of the shifted number adds one octave.
    let octaves = (SQUARE_BITS - LEAST_BITS).wrapping_sub(zeros);
    (octaves << STEP_BITS).wrapping_add(squared as u32 >> ((31 - STEP_BITS).wrapping_sub(zeros) & 31))
}

/// Returns the tangent of an index.
#[inline(always)]
pub(super) fn tangent(index: u32) -> u32 {
    TANGENTS[index as usize % ENTRIES]
}

/// Returns K at `squared`, with [`KERNEL_BITS`] fractional bits.
#[inline(always)]
pub(super) fn kernel(tangent: u32, squared: i32) -> i16 {
    // The derivative with respect to the squared sine is -2 times that with respect to the cosine.
    let change = (squared >> 10).wrapping_mul(slope(tangent).into())
        >> (SQUARE_BITS - 10 + SLOPE_BITS - KERNEL_BITS - 1);
    ((tangent as i32 >> 16) - change) as i16
}

/// Returns the derivative of K with respect to the cosine of the angle, with [`SLOPE_BITS`] fractional bits.
#[inline(always)]
pub(super) fn slope(tangent: u32) -> i16 {
    tangent as i16
}

const fn tangents() -> [u32; ENTRIES] {
    let mut tangents = [0; ENTRIES];
    let mut i = 0;
    while i < ((SQUARE_BITS - LEAST_BITS) << STEP_BITS) as usize {
        let steps = 1 << STEP_BITS;
        let octave = LEAST_BITS as usize + i / steps;
        let squared = (1u64 << octave) as f64 * (1.0 + ((i % steps) as f64 + 0.5) / steps as f64)
            / (1u64 << SQUARE_BITS) as f64;
        tangents[i] = tangent_at(squared);
        i += 1;
    }
    tangents
}

/// Returns the tangent at a squared sine of half the angle.
const fn tangent_at(squared: f64) -> u32 {
    // Newton's iteration from above converges to the root.
    let mut h = 1.0;
    let mut step = 0;
    while step < 30 {
        h = 0.5 * (h + squared / h);
        step += 1;
    }
    let (mut kernel, mut by_root) = (0.0, 0.0);
    let mut c = KERNEL.len();
    while c > 0 {
        c -= 1;
        by_root = by_root * h + kernel;
        kernel = kernel * h + KERNEL[c] as f64;
    }
    // With x the cosine of the angle, h^2 = (1 - x) / 2.
    let slope = nearest(by_root / h * -0.25 * (1 << SLOPE_BITS) as f64);
    let at_zero = kernel + 2.0 * squared * slope as f64 / (1 << SLOPE_BITS) as f64;
    (nearest(at_zero * (1 << KERNEL_BITS) as f64) as u16 as u32) << 16 | slope as u16 as u32
}

const fn nearest(v: f64) -> i16 {
    (if v < 0.0 { v - 0.5 } else { v + 0.5 }) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exact(h: f64) -> f64 {
        KERNEL.iter().rev().fold(0.0, |sum, c| sum * h + f64::from(*c))
    }

    #[test]
    fn table_has_the_kernel_and_its_derivative() {
        for k in 0..40_000 {
            // From the least argument to that of opposite directions, by equal ratios.
            let squared = libm::exp2(-18.0 * (1.0 - f64::from(k) / 40_000.0));
            let h = libm::sqrt(squared);
            let fixed = limited((squared * f64::from(1 << 30)) as i32);
            let tangent = tangent(index(fixed));
            let (kernel, slope) = (kernel(tangent, fixed), slope(tangent));
            let off = f64::from(kernel) / f64::from(1 << KERNEL_BITS) - exact(h);
            assert!(off.abs() < 1.4e-4, "{h}: kernel off by {off}");
            let by_cosine = (exact(h + 1e-5) - exact(h - 1e-5)) / 2e-5 / h * -0.25;
            let off = f64::from(slope) / f64::from(1 << SLOPE_BITS) - by_cosine;
            assert!(off.abs() < 0.004 + 0.02 * by_cosine.abs(), "{h}: slope off by {off} of {by_cosine}");
        }
    }
}
