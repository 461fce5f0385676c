//! A corner of a calibration board that was detected in a picture.

use nalgebra::Vector2;

/// A detected corner: its column and row on the board, and its pixel in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sighting {
    /// Column and row of the corner on the board.
    pub cell: [i32; 2],
    /// Pixel at which the corner was detected.
    pub at: Vector2<f64>,
}
