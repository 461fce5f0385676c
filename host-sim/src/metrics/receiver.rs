//! Receivers of the scores: 768 open receivers, and 512 receivers with an occluding cone.

use std::f64::consts::TAU;

use super::vector::dot;

/// Number of open receivers of the scores.
pub const OPEN: usize = 768;
/// Number of shadowed receivers of the scores.
pub const SHADOWED: usize = 512;

/// Returns direction `k` of the spherical Fibonacci lattice of `count` points: z = 1 - (2k + 1) / count, phi = 2 pi frac(0.6180339887498949
/// k).
#[must_use]
pub fn fib(k: usize, count: usize) -> [f64; 3] {
    let z = 1.0 - (2 * k + 1) as f64 / count as f64;
    let phi = TAU * (k as f64 * 0.618_033_988_749_894_9).fract();
    let r = (1.0 - z * z).sqrt();
    [r * phi.cos(), r * phi.sin(), z]
}

/// A receiver: a normal and a cone of directions that contribute no light.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Unit normal of the receiving surface.
    pub normal: [f64; 3],
    /// Axis of the cone from which no light reaches the receiver.
    pub axis: [f64; 3],
    /// Cosine of the cone's half-angle; a value above 1 means that there is no cone.
    pub cos_half_angle: f64,
}

impl Receiver {
    /// Returns the weight of light from the unit vector `d`: max(0, n . d) with the normal n, and 0 inside of the cone.
    #[must_use]
    pub fn weight(&self, d: [f64; 3]) -> f64 {
        if dot(self.axis, d) > self.cos_half_angle { 0.0 } else { dot(self.normal, d).max(0.0) }
    }
}

/// Returns open receiver `k` of [`OPEN`].
#[must_use]
pub fn open(k: usize) -> Receiver {
    let normal = fib(k, OPEN);
    Receiver { normal, axis: normal, cos_half_angle: 2.0 }
}

/// Returns shadowed receiver `k` of [`SHADOWED`]: a cone of 10 to 60 degrees half-angle around another lattice point.
#[must_use]
pub fn shadowed(k: usize) -> Receiver {
    let half_angle_deg = 10.0 + 50.0 * ((k as f64 + 0.5) * 0.754_877_666_246_692_7).fract();
    Receiver {
        normal: fib(k, SHADOWED),
        axis: fib((197 * k + 101) % SHADOWED, SHADOWED),
        cos_half_angle: half_angle_deg.to_radians().cos(),
    }
}
