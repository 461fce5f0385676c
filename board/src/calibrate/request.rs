//! The input of a lens calibration: pictures, the board and options.

use super::board::{Board, Printed};
use super::grey::Grey;

/// A picture with its name for error messages.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the picture, usually its file.
    pub name: String,
    /// Grey samples of the picture.
    pub grey: Grey,
}

/// Board and options of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Board that the pictures show.
    pub board: Printed,
    /// True if pictures are accepted all of which appear mirrored by the board's squares, since the board may be printed in inverted
    /// colours.
    pub any_colours: bool,
}

impl From<Board> for Request {
    fn from(board: Board) -> Self {
        Self { board: board.into(), any_colours: false }
    }
}
