//! The step of a disc's centre along the gradient of the error.

use super::kernel::MeanVector;
use crate::color::luminance;
use crate::light::Light;
use crate::root::root;
use glam::Vec3;

/// Ratio of the step of a disc's centre to a Newton step, for which three steps leave the least error over the maps; 0.7 needs four, and 1.4
/// is worse for few discs.
const RELAXED: f32 = 1.1;

/// Longest step of a disc's centre, in widths of the disc.
const LONGEST: f32 = 0.5;

/// Curvature of the kernel: that of its kink, relative to a disc's width, and that of its smooth part.
const CURVATURE: (f32, f32) = (0.086, 1.15);

/// Least width of a disc for the computation of a step, as half a chord.
const LEAST_WIDTH: f32 = 1e-3;

/// Returns the direction of the disc `light` after a step along `pull`.
pub(super) fn stepped(light: &Light, pull: Vec3) -> Vec3 {
    let energy = luminance(light.irradiance);
    if energy <= 0.0 {
        return light.direction;
    }
    let disc = MeanVector::of_light(light);
    let width = root(disc.width_squared().max(LEAST_WIDTH * LEAST_WIDTH));
    let stiffness = energy * (CURVATURE.0 / width + CURVATURE.1);
    let step = (pull * (RELAXED / stiffness)).clamp_length_max(LONGEST * width);
    (disc.vector() + step.reject_from_normalized(light.direction)).try_normalize().unwrap_or(light.direction)
}
