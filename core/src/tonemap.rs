//! Radiance to what people look at: a sigmoid of log luminance, then the sRGB transfer function.

use crate::color::luminance;

/// Slope of the sigmoid in log-log units: about film's. Less looks flat, more crushes what is dark.
const CONTRAST: f32 = 0.8;

/// Display code, 0..=255, of linear `rgb` where `adaptation` is the luminance that becomes mid-grey.
///
/// The sigmoid Y^n / (Y^n + A^n) of Naka and Rushton, with the colour kept. For pictures alone: within 1 of a code of an `f64` twin.
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

/// sRGB code of linear `v`, clamped to 0..=1.
#[must_use]
pub fn srgb_code(v: f32) -> u8 {
    let v = v.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * libm::powf(v, 1.0 / 2.4) - 0.055 };
    (255.0 * encoded + 0.5) as u8
}
