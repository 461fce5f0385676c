//! Tone mapping for pictures: a sigmoid of log luminance, followed by the sRGB transfer function.
//!
//! ```
//! use hemilux_core::tonemap::sigmoid;
//! // The adaptation luminance becomes mid-grey: half of the linear range.
//! assert_eq!(sigmoid([0.3; 3], 0.3), [188; 3]);
//! ```

use crate::color::luminance;

/// Slope of the sigmoid in log-log units, about that of film. A lower value gives flat pictures; a higher one darkens shadows.
const CONTRAST: f32 = 0.8;

/// Returns the display codes, 0..=255, of linear `rgb`; luminance `adaptation` is displayed as half of the linear range.
///
/// Applies the sigmoid Y^n / (Y^n + A^n) of Naka and Rushton to the luminance and keeps the chromaticity. Within 1 code of an `f64`
/// implementation.
#[must_use]
pub fn sigmoid(rgb: [f32; 3], adaptation: f32) -> [u8; 3] {
    let y = luminance(rgb);
    if y.is_nan() || y <= 0.0 || adaptation <= 0.0 {
        return [0; 3];
    }
    let ratio = libm::powf(y / adaptation, CONTRAST);
    let display = ratio / (ratio + 1.0);
    rgb.map(|v| srgb_code(v / y * display))
}

/// Returns the sRGB code of linear `v`, which is clamped to 0..=1.
///
/// # Accuracy
/// Within 0.01 of a code of the formula before rounding. A table takes a fifth of the instructions of `powf` on ARMv7; the power function
/// of micromath errs by up to eleven codes (`examples/math`).
#[must_use]
pub fn srgb_code(v: f32) -> u8 {
    let v = v.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * power(v) - 0.055 };
    (255.0 * encoded + 0.5) as u8
}

/// Number of octaves below 1 that the table covers: down to 1/512, below which the transfer function is linear.
const OCTAVES: u32 = 9;

/// Number of mantissa bits that select a table entry: 64 entries per octave, between which linear interpolation is within 1e-5 of the
/// curve.
const STEP_BITS: u32 = 6;
const SHIFT: u32 = f32::MANTISSA_DIGITS - 1 - STEP_BITS;
const STEPS: usize = (OCTAVES << STEP_BITS) as usize;

/// Bit pattern of the smallest argument in the table: the bits of a float are nearly proportional to its logarithm.
const BASE: u32 = 1f32.to_bits() - (OCTAVES << (f32::MANTISSA_DIGITS - 1));

/// Values of v^(1 / 2.4) at the table entries.
static POWERS: [f32; STEPS + 1] = {
    let mut powers = [0.0; STEPS + 1];
    let mut i = 0;
    while i <= STEPS {
        powers[i] = twelfth_root_of_fifth_power(f32::from_bits(BASE + ((i as u32) << SHIFT)) as f64) as f32;
        i += 1;
    }
    powers
};

/// Returns `v`^(1 / 2.4) by interpolation, for `v` from 1/512 to 1.
fn power(v: f32) -> f32 {
    let bits = v.to_bits().wrapping_sub(BASE);
    let steps = POWERS.get((bits >> SHIFT) as usize..).and_then(|p| p.first_chunk());
    let Some([a, b]) = steps else { return v };
    let part = (bits & ((1 << SHIFT) - 1)) as f32 * (1.0 / (1u32 << SHIFT) as f32);
    a + (b - a) * part
}

/// Solves y^12 = x^5 by Newton's method, started at 1, for x in 0..=1.
const fn twelfth_root_of_fifth_power(x: f64) -> f64 {
    let x5 = x * x * x * x * x;
    let mut y = 1.0;
    let mut round = 0;
    while round < 64 {
        let y3: f64 = y * y * y;
        let y11 = y3 * y3 * y3 * y * y;
        y -= (y11 * y - x5) / (12.0 * y11);
        round += 1;
    }
    y
}
