//! The shape of a board that is neither quite flat nor printed quite evenly.

use super::Printed;
use nalgebra::{SMatrix, SVector, Vector3};

/// Number of parameters of a shape.
pub(super) const SHAPE: usize = 5;

/// The deviation of a board from a plane of squares.
///
/// All terms stay what they are when the board is turned by half a turn, which a chessboard of an even number of rows does not tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    /// The share by which columns are further apart than rows and by which they lean; then how far the board bulges along its columns, its diagonal and its rows,
    /// in squares.
    pub values: SVector<f64, SHAPE>,
    /// The board's middle, and half its size.
    half: [f64; 2],
    printed: Printed,
    /// A board of as many rows as columns has no first direction, hence no shape that all pictures share.
    flat: bool,
}

impl Shape {
    /// A plane of squares.
    pub fn new(printed: Printed) -> Self {
        let half = printed.corners.size().map(|n| 0.5 * printed.line(n - 1));
        let flat = printed.corners.columns == printed.corners.rows;
        Self { values: SVector::zeros(), half, printed, flat }
    }

    /// The place of a corner on a plane, in squares.
    pub fn plane(&self, [i, j]: [i32; 2]) -> Vector3<f64> {
        Vector3::new(self.printed.line(i), self.printed.line(j), 0.0)
    }

    /// The same board with other parameters.
    pub fn with(self, values: SVector<f64, SHAPE>) -> Self {
        Self { values, ..self }
    }

    /// The place of a corner, in squares.
    pub fn place(&self, cell: [i32; 2]) -> Vector3<f64> {
        self.plane(cell) + self.derivatives(cell) * self.values
    }

    /// By the parameters.
    pub fn derivatives(&self, cell: [i32; 2]) -> SMatrix<f64, 3, SHAPE> {
        let plane = self.plane(cell);
        let (x, y) = (plane.x - self.half[0], plane.y - self.half[1]);
        let (u, v) = (x / self.half[0].max(1.0), y / self.half[1].max(1.0));
        let mut d = SMatrix::zeros();
        d[(0, 0)] = x;
        d[(0, 1)] = y;
        d[(2, 2)] = u * u;
        d[(2, 3)] = u * v;
        d[(2, 4)] = v * v;
        d
    }

    /// Largest distance from a plane, in squares.
    pub fn bulge(&self) -> f64 {
        self.values.iter().skip(2).map(|v| v.abs()).fold(0.0, f64::max)
    }

    /// Calls `fix` for each parameter that is not varied.
    pub fn fix(&self, fix: impl FnMut(usize)) {
        if self.flat {
            (0..SHAPE).for_each(fix);
        }
    }
}
