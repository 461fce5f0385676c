//! The receivers of the error metric: surface points with normals in all directions, unoccluded or with an occluding cone.

use core::f64::consts::TAU;
use glam::Vec3;

/// Number of open receivers of the error metric.
pub const OPEN: usize = 768;

/// Number of shadowed receivers of the error metric.
pub const SHADOWED: usize = 512;

/// A receiver with an occluding cone: light from directions inside the cone does not reach it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadowed {
    /// Normal of the receiver, a unit vector.
    pub normal: Vec3,
    /// Axis of the occluding cone, a unit vector.
    pub axis: Vec3,
    /// Half-angle of the occluding cone, radians: 10 to 60 degrees.
    pub half_angle: f64,
}

/// Returns the normal of open receiver `k` below [`OPEN`].
#[must_use]
pub fn open(k: usize) -> Vec3 {
    lattice(k, OPEN)
}

/// Returns shadowed receiver `k` below [`SHADOWED`].
#[must_use]
pub fn shadowed(k: usize) -> Shadowed {
    let half_angle = 10.0 + 50.0 * libm::fmod((k as f64 + 0.5) * 0.754_877_666_246_692_7, 1.0);
    Shadowed {
        normal: lattice(k, SHADOWED),
        axis: lattice((197 * k + 101) % SHADOWED, SHADOWED),
        half_angle: half_angle.to_radians(),
    }
}

/// Returns point `k` of the spherical Fibonacci lattice of `count` points.
fn lattice(k: usize, count: usize) -> Vec3 {
    let z = 1.0 - (2 * k + 1) as f64 / count as f64;
    let phi = TAU * libm::fmod(k as f64 * 0.618_033_988_749_894_9, 1.0);
    let r = libm::sqrt((1.0 - z * z).max(0.0));
    Vec3::new((r * libm::cos(phi)) as f32, (r * libm::sin(phi)) as f32, z as f32)
}
