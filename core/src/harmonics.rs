//! Real spherical harmonics of degree 0 to 2: orthonormal, without the Condon-Shortley phase, in the order of [`Sh9`].
//!
//! ```
//! use glam::Vec3;
//! use hemilux_core::harmonics::{basis, radiance};
//! // A constant radiance of 2 has one coefficient: 2 sqrt(4 pi).
//! let mut sh = [[0.0; 3]; 9];
//! sh[0] = [2.0 * (4.0 * core::f32::consts::PI).sqrt(); 3];
//! assert!((radiance(&sh, Vec3::X)[0] - 2.0).abs() < 1e-5);
//! assert!((basis(Vec3::Z)[0] - 0.2821).abs() < 1e-4);
//! ```

use crate::light::Sh9;
use glam::Vec3;

/// Returns the values of the nine basis functions at the unit vector `d`.
#[must_use]
pub fn basis(d: Vec3) -> [f32; 9] {
    let Vec3 { x, y, z } = d;
    [
        0.282_094_8,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * z * z - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (x * x - y * y),
    ]
}

/// Returns the radiance of the series `sh` towards the unit vector `d`; it can be negative.
#[must_use]
pub fn radiance(sh: &Sh9, d: Vec3) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (row, value) in sh.iter().zip(basis(d)) {
        crate::color::add(&mut sum, row.map(|c| c * value));
    }
    sum
}
