//! The shape of a board that is not exactly flat and not printed exactly evenly.

use super::Printed;
use nalgebra::{SMatrix, SVector, Vector3};

/// Number of parameters of a shape.
pub(super) const SHAPE: usize = 5;

/// Deviation of a board from a plane of squares.
///
/// All terms are invariant under a rotation by half a turn, which cannot be seen on a chessboard with an even number of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    /// Relative difference of the spacings of columns and rows, and the shear of the columns; then the height of the bulge along the
    /// columns, the diagonal and the rows, in squares.
    pub values: SVector<f64, SHAPE>,
    /// Centre of the board, and half its size.
    half: [f64; 2],
    printed: Printed,
    /// True if the shape is fixed to a plane: a board with as many rows as columns has no distinct first direction, hence no shape that is
    /// common to all pictures.
    flat: bool,
}

impl Shape {
    /// Returns the shape of a plane of squares.
    pub fn new(printed: Printed) -> Self {
        let half = printed.corners.size().map(|n| 0.5 * printed.line(n - 1));
        let flat = printed.corners.columns == printed.corners.rows;
        Self { values: SVector::zeros(), half, printed, flat }
    }

    /// Returns the position of a corner on a plane, in squares.
    pub fn plane(&self, [i, j]: [i32; 2]) -> Vector3<f64> {
        Vector3::new(self.printed.line(i), self.printed.line(j), 0.0)
    }

    /// Returns the board with the parameters `values`.
    pub fn with(self, values: SVector<f64, SHAPE>) -> Self {
        Self { values, ..self }
    }

    /// Returns the position of a corner, in squares.
    pub fn place(&self, cell: [i32; 2]) -> Vector3<f64> {
        self.plane(cell) + self.derivatives(cell) * self.values
    }

    /// Returns the derivatives of a corner's position with respect to the parameters.
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

    /// Returns the largest distance from a plane, in squares.
    pub fn bulge(&self) -> f64 {
        self.values.iter().skip(2).map(|v| v.abs()).fold(0.0, f64::max)
    }

    /// Calls `fix` with the index of each parameter that is not fitted.
    pub fn fix(&self, fix: impl FnMut(usize)) {
        if self.flat {
            (0..SHAPE).for_each(fix);
        }
    }
}
