//! A corner of the board that was detected in a picture.

use nalgebra::Vector2;

/// A detected corner: its position on the board in squares, and its pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sighting {
    /// Column and row of the corner on the board.
    pub cell: [i32; 2],
    /// Pixel of the corner.
    pub at: Vector2<f64>,
}
