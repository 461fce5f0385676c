//! Limits of the radiance of maps.

/// Largest finite half float, which replaces infinities: they result from overflow.
pub const HALF_MAX: f32 = 65504.0;

/// Largest accepted radiance of 32-bit float and RGBE maps: above every light source in any unit; f32 can represent its square.
pub const FLOAT_MAX: f32 = 1e12;

/// Numbers of texels that [`limit`] changed.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Changed {
    /// Number of texels with a negative value or NaN, which became 0.
    pub negative: usize,
    /// Number of texels of each row that had a channel above the limit.
    pub clipped: Vec<u32>,
}

impl Changed {
    /// Returns the numbers of changed texels of this map and of `other` together.
    #[must_use]
    pub fn with(mut self, other: Self) -> Self {
        self.negative += other.negative;
        self.clipped.iter_mut().zip(other.clipped).for_each(|(all, more)| *all += more);
        self
    }
}

/// Replaces each infinity in rows of `width` texels by [`HALF_MAX`] with its sign, and counts the texels with an infinity.
pub fn limit_infinities(texels: &mut [[f32; 3]], width: usize) -> Changed {
    let mut changed = Changed { negative: 0, clipped: vec![0; texels.len().div_ceil(width.max(1))] };
    for (index, texel) in texels.iter_mut().enumerate() {
        if texel.iter().any(|v| v.is_infinite()) {
            changed.clipped[index / width] += 1;
            *texel = texel.map(|v| if v.is_infinite() { HALF_MAX.copysign(v) } else { v });
        }
    }
    changed
}

/// Limits every channel of rows of `width` texels to 0..=[`HALF_MAX`] (`half`) or 0..=[`FLOAT_MAX`]; an infinity becomes [`HALF_MAX`].
pub fn limit(texels: &mut [[f32; 3]], width: usize, half: bool) -> Changed {
    let most = if half { HALF_MAX } else { FLOAT_MAX };
    let mut changed = Changed { negative: 0, clipped: vec![0; texels.len().div_ceil(width.max(1))] };
    for (index, texel) in texels.iter_mut().enumerate() {
        if texel.iter().all(|v| (0.0..=most).contains(v)) {
            continue;
        }
        changed.negative += usize::from(texel.iter().any(|v| v.is_nan() || *v < 0.0));
        if texel.iter().any(|v| *v > most) {
            changed.clipped[index / width] += 1;
        }
        *texel = texel.map(|v| match v {
            v if v.is_nan() => 0.0,
            f32::INFINITY => HALF_MAX,
            v => v.clamp(0.0, most),
        });
    }
    changed
}
