//! The step of a disc's centre along the gradient of the error.

use super::kernel::MeanVector;
use crate::color::luminance;
use crate::light::Light;
use crate::root::root;
use glam::Vec3;

/// Fraction of a Newton step by which a disc's centre is moved, since the neighbours move in the same iteration.
const RELAXED: f32 = 0.7;

/// Longest step of a disc's centre, in widths of the disc.
const LONGEST: f32 = 0.5;

/// Curvature of the kernel: that of its kink, relative to a disc's width, and that of its smooth part.
const CURVATURE: (f32, f32) = (0.086, 1.15);

/// Least width of a disc for the computation of a step, as half a chord.
const LEAST_WIDTH: f32 = 1e-3;

/// Returns the direction of a disc of mean vector `disc` after a step along `pull`.
pub(super) fn stepped(light: &Light, disc: &MeanVector, pull: Vec3) -> Vec3 {
    let energy = luminance(light.irradiance);
    if energy <= 0.0 {
        return light.direction;
    }
    let width = root(disc.width_squared().max(LEAST_WIDTH * LEAST_WIDTH));
    let stiffness = energy * (CURVATURE.0 / width + CURVATURE.1);
    let step = (pull * (RELAXED / stiffness)).clamp_length_max(LONGEST * width);
    (disc.vector() + step.reject_from_normalized(light.direction)).try_normalize().unwrap_or(light.direction)
}
