//! The step of a disc's centre along the gradient of the error.

use super::kernel::MeanVector;
use crate::color::luminance;
use crate::light::Light;
use crate::root::root;
use glam::Vec3;

/// Part of a Newton step that is taken, since the neighbours move in the same iteration.
const RELAXED: f32 = 0.7;

/// Longest step, as a part of the disc's width.
const LONGEST: f32 = 0.5;

/// Curvature of the kernel: of its kink, over a disc's width, and of its smooth part.
const CURVATURE: (f32, f32) = (0.086, 1.15);

/// Least width of a disc, as half a chord.
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
