//! Linear RGB with the primaries of Rec. 709, and luminance.

/// Weights of linear Rec. 709 red, green and blue in luminance.
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Returns the luminance Y = 0.2126 R + 0.7152 G + 0.0722 B of linear `rgb`.
#[must_use]
pub fn luminance(rgb: [f32; 3]) -> f32 {
    LUMINANCE[0] * rgb[0] + LUMINANCE[1] * rgb[1] + LUMINANCE[2] * rgb[2]
}

/// Returns the three channels of `rgb` times `factor`.
#[must_use]
pub fn scaled(rgb: [f32; 3], factor: f32) -> [f32; 3] {
    rgb.map(|v| v * factor)
}

/// Adds `rgb` to `sum`, channel by channel.
pub fn add(sum: &mut [f32; 3], rgb: [f32; 3]) {
    for (s, v) in sum.iter_mut().zip(rgb) {
        *s += v;
    }
}

/// Largest energy of a channel of a texel, in any unit: above any real light, and low enough that sums over 2^28 texels are finite.
pub const MAX_ENERGY: f32 = 1e29;

/// Returns `rgb` with negative channels and NaN replaced by 0 and other channels limited to [`MAX_ENERGY`].
#[must_use]
pub fn sound(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| if v > 0.0 { v.min(MAX_ENERGY) } else { 0.0 })
}
