//! The shape of a board that is not exactly flat and not printed exactly evenly.

use super::Printed;
use nalgebra::{SMatrix, SVector, Vector3};

/// Number of parameters of a board's shape.
pub(super) const SHAPE: usize = 5;

/// Deviation of a board from a plane with equal squares.
///
/// All terms are invariant under a rotation by half a turn, which cannot be seen on a chessboard with an even number of rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    /// Relative difference of the spacings of columns and rows, and the shear of the columns; then the height of the bulge along the
    /// columns, the diagonal and the rows, in squares.
    pub values: SVector<f64, SHAPE>,
    /// Half the size of the board, in squares, which is also the position of its centre.
    half: [f64; 2],
    printed: Printed,
    /// True if the shape is fixed to a plane: a board with as many rows as columns has no distinct first direction, hence no shape that is
    /// common to all pictures.
    flat: bool,
}

impl Shape {
    /// Returns the shape of the board `printed` as a plane with equal squares.
    pub fn new(printed: Printed) -> Self {
        let half = printed.corners.size().map(|n| 0.5 * printed.line(n - 1));
        let flat = printed.corners.columns == printed.corners.rows;
        Self { values: SVector::zeros(), half, printed, flat }
    }

    /// Returns the position of the corner in column i and row j on a plane board, in squares from the corner in column 0 and row 0.
    pub fn plane(&self, [i, j]: [i32; 2]) -> Vector3<f64> {
        Vector3::new(self.printed.line(i), self.printed.line(j), 0.0)
    }

    /// Returns this board's shape with the parameters `values`.
    pub fn with(self, values: SVector<f64, SHAPE>) -> Self {
        Self { values, ..self }
    }

    /// Returns the position of the corner `cell` on this board, in squares from the corner in column 0 and row 0.
    pub fn place(&self, cell: [i32; 2]) -> Vector3<f64> {
        self.plane(cell) + self.derivatives(cell) * self.values
    }

    /// Returns the derivatives of the position of the corner `cell` with respect to the shape's parameters.
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

    /// Returns the largest distance of the board from a plane, in squares.
    pub fn bulge(&self) -> f64 {
        self.values.iter().skip(2).map(|v| v.abs()).fold(0.0, f64::max)
    }

    /// Calls `fix` with the index of each parameter of the shape that is not fitted.
    pub fn fix(&self, fix: impl FnMut(usize)) {
        if self.flat {
            (0..SHAPE).for_each(fix);
        }
    }
}
