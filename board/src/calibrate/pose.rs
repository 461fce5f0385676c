//! Computation of the pose of a calibration board in the camera's axes.

use super::camera::Camera;
use super::shape::Shape;
use super::sighting::Sighting;
use nalgebra::{Matrix3, Rotation3, SMatrix, Vector2, Vector3};

/// The pose of a board: rotation and translation from the board's axes to the camera's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Rotation from the board's axes to the camera's.
    pub turn: Rotation3<f64>,
    /// Position of the board's origin, the corner in column 0 and row 0, in the camera's axes, in squares.
    pub shift: Vector3<f64>,
}

impl Pose {
    /// Converts a point in the board's axes to the camera's axes, in squares.
    pub fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.turn * point + self.shift
    }
}

/// Computes the pose of a flat board from the directions of its corners: the eigenvector of the least eigenvalue of the corners' cross
/// products, made orthonormal.
///
/// Directions beyond 90 degrees from the axis are used like all others.
pub(super) fn from_directions(camera: &Camera, shape: &Shape, seen: &[Sighting]) -> Option<Pose> {
    let mean = seen.iter().map(|s| shape.plane(s.cell)).sum::<Vector3<f64>>() / seen.len() as f64;
    let spread = seen.iter().map(|s| (shape.plane(s.cell) - mean).norm()).fold(1e-9, f64::max);
    let placed: Vec<BoardPoint> =
        seen.iter().map(|s| BoardPoint { at: (shape.plane(s.cell) - mean) / spread, pixel: s.at }).collect();
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for BoardPoint { at: p, pixel } in &placed {
        let across = camera.direction(*pixel).cross_matrix();
        let mut rows = SMatrix::<f64, 3, 9>::zeros();
        rows.fixed_columns_mut::<3>(0).copy_from(&(across * p.x));
        rows.fixed_columns_mut::<3>(3).copy_from(&(across * p.y));
        rows.fixed_columns_mut::<3>(6).copy_from(&across);
        normal += rows.transpose() * rows;
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let v = eigen.eigenvectors.column(least).into_owned();
    let column = |i: usize| Vector3::new(v[i], v[i + 1], v[i + 2]);
    let unit = upright(camera, &placed, [column(0), column(3), column(6)])?;
    Some(Pose { turn: unit.turn, shift: unit.shift * spread - unit.turn * mean })
}

/// A corner in board coordinates (from the board's centre, in units of the board's size) with its pixel.
struct BoardPoint {
    at: Vector3<f64>,
    pixel: Vector2<f64>,
}

/// Converts the first two columns of a rotation and a translation to a pose in front of the camera.
fn upright(camera: &Camera, placed: &[BoardPoint], [a, b, t]: [Vector3<f64>; 3]) -> Option<Pose> {
    let facing: f64 = placed
        .iter()
        .map(|BoardPoint { at: p, pixel }| camera.direction(*pixel).dot(&(a * p.x + b * p.y + t)).signum())
        .sum();
    let sign = if facing < 0.0 { -1.0 } else { 1.0 };
    let scale = 0.5 * (a.norm() + b.norm());
    let [a, b, t] = [a, b, t].map(|v| v * (sign / scale));
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let turn = svd.u? * svd.v_t?;
    let turned = || Pose { turn: Rotation3::from_matrix_unchecked(turn), shift: t };
    (turn.determinant() > 0.0 && scale > 0.0).then(turned)
}
