//! Calibration of a lens from pictures of a chessboard.
//!
//! Corners are found by their surroundings ([`chess_corners`]), joined square by square to grids, and refined; poses follow from the
//! directions of the corners, so that boards beyond 90 degrees from the axis are as good as any. One robust least-squares fit gives
//! lens, poses and the shape of the board, which is never quite flat; corners that were missed are looked for again with its help.

mod board;
mod burst;
mod camera;
mod check;
mod check_file;
mod corners;
mod detect;
mod fit;
mod grey;
mod grid;
mod lens;
mod lens_file;
mod pose;
mod residuals;
mod response;
#[cfg(test)]
mod response_tests;
mod shape;
mod solve;
mod target;
mod uncertainty;
mod vignetting;

pub use board::Board;
pub use burst::exposed;
pub use check::LensRefusal;
pub use check_file::{Fault, check};
pub use grey::Grey;
pub use lens::{Calibrated, Picture, Spread, calibrate};
pub use lens_file::{FileRefusal, response_text, write, write_response, write_vignetting};
pub use residuals::picture as residual_picture;
pub use response::{Exposed, FittedResponse, Neighbours, ResponseRefusal, fit_response};
pub use target::{Target, TargetRefusal, svg as target_svg};
pub use vignetting::{
    FittedVignetting, Reading, Shown, VignettingRefusal, fit_vignetting, flat_field, screen,
};
