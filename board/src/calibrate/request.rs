//! The input of a lens calibration: pictures, the board and options.

use super::board::{Board, Printed};
use super::grey::Grey;

/// A picture with the name that error messages use.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the picture, usually its file.
    pub name: String,
    /// Samples of the picture.
    pub grey: Grey,
}

/// Board and options of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Board of the pictures.
    pub board: Printed,
    /// Whether pictures that all appear mirrored by their squares are accepted, since the board may be printed in inverted colours.
    pub any_colours: bool,
}

impl From<Board> for Request {
    fn from(board: Board) -> Self {
        Self { board: board.into(), any_colours: false }
    }
}
