//! Detection and refinement of the corners of a chessboard's squares.

use super::grey::Grey;
use chess_corners::{ChessError, Detector, DetectorConfig};
use nalgebra::{Matrix2, Vector2};

/// A corner in a picture of a board: a point where two black and two white squares meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    /// Position of the corner, pixels.
    pub at: Vector2<f64>,
    /// Directions of the four edges that meet in the corner, radians, ascending; a dark sector follows the first and the third.
    pub edges: [f64; 4],
}

/// Detects the corners in a picture; `scale` is the number of pixels of the full picture per pixel of `grey`, along a side.
pub(super) fn find(grey: &Grey, scale: f64) -> Result<Vec<Corner>, ChessError> {
    let [width, height] = grey.size();
    let mut detector = Detector::new(DetectorConfig::chess().with_threshold(20.0))?;
    let found = detector.detect_u8(grey.pixels(), width as u32, height as u32)?;
    let corner = |c: &chess_corners::CornerDescriptor| {
        let axes = c.axes?;
        let [a, b] = axes.map(|axis| f64::from(axis.angle));
        let at = Vector2::new(f64::from(c.x), f64::from(c.y));
        let full = (at.add_scalar(0.5) * scale).add_scalar(-0.5);
        let half = std::f64::consts::PI;
        Some(Corner { at: full, edges: [a, b, a + half, b + half] })
    };
    Ok(found.iter().filter_map(corner).collect())
}

/// Largest number of steps of [`refine`] for a corner.
const STEPS: usize = 20;

/// Moves a corner to the point for which the gradients around it are perpendicular to the lines to it: \[Foerstner1987\].
///
/// `radius` is the half-size of the window, pixels. Returns `None` if the corner moves by more than the radius, or has no edges in two
/// directions.
pub(super) fn refine(grey: &Grey, start: Vector2<f64>, radius: f64) -> Option<Vector2<f64>> {
    let mut at = start;
    for _ in 0..STEPS {
        if !grey.holds(at, radius + 2.0) {
            return None;
        }
        let next = step(grey, at, radius)?;
        if (next - start).norm() > radius.max(1.5) {
            return None;
        }
        let moved = (next - at).norm();
        at = next;
        if moved < 2e-3 {
            return Some(at);
        }
    }
    Some(at)
}

/// Computes one step of [`refine`]: the point for which the gradients around `at` are perpendicular to the lines to the point.
fn step(grey: &Grey, at: Vector2<f64>, radius: f64) -> Option<Vector2<f64>> {
    let reach = radius.ceil() as i32;
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let offset = Vector2::new(f64::from(dx), f64::from(dy));
            let gradient = gradient(grey, at + offset);
            let weight = (-2.0 * offset.norm_squared() / (radius * radius)).exp();
            let outer = gradient * gradient.transpose() * weight;
            normal += outer;
            right += outer * offset;
        }
    }
    let eigen = normal.symmetric_eigenvalues();
    if eigen.min() < 0.02 * eigen.max() || eigen.max() <= 0.0 {
        return None;
    }
    Some(at + normal.try_inverse()? * right)
}

fn gradient(grey: &Grey, at: Vector2<f64>) -> Vector2<f64> {
    let difference = |step: Vector2<f64>| 0.5 * (grey.sample(at + step) - grey.sample(at - step));
    Vector2::new(difference(Vector2::x()), difference(Vector2::y()))
}

/// Returns the contrast of four squares around a point, sampled at their centres, as a fraction of their mean.
///
/// Returns `None` if black and white do not alternate around the point.
pub(super) fn alternates(grey: &Grey, around: [Vector2<f64>; 4]) -> Option<f64> {
    let [a, b, c, d] = around.map(|at| grey.sample(at));
    let (low, high) = if a + c < b + d { ([a, c], [b, d]) } else { ([b, d], [a, c]) };
    let gap = high[0].min(high[1]) - low[0].max(low[1]);
    let mean = 0.25 * (a + b + c + d);
    (gap > 8.0 && gap > 0.15 * mean).then(|| gap / mean)
}
