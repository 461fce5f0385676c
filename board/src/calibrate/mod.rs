//! Calibration of a lens, a camera response, a vignetting and a photometric factor from pictures.
//!
//! Corners of a chessboard are detected by their surroundings ([`chess_corners`]), joined square by square to grids, and refined. Poses are
//! computed from the directions of the corners, so that boards beyond 90 degrees from the axis are used too. One robust least-squares fit
//! computes the lens, the poses and the shape of the board, which is never exactly flat; missing corners are then searched at the positions that
//! the fit predicts.

mod board;
mod burst;
mod camera;
mod check;
mod check_file;
mod circle;
mod corners;
mod detect;
mod factor;
mod fit;
mod found;
mod frame;
mod grey;
mod grid;
mod guide;
mod lens;
mod lens_file;
mod photometric;
mod photometric_file;
#[cfg(all(test, feature = "server"))]
mod photometric_tests;
mod pose;
mod request;
mod residuals;
mod response;
#[cfg(test)]
mod response_tests;
mod shape;
mod sighting;
mod solve;
mod tags;
#[cfg(test)]
mod tags_tests;
mod target;
mod uncertainty;
mod vignetting;

pub use board::{Board, Charuco, Kind, Printed};
pub use burst::{Codes, ExposedBurst, exposed, exposed_frames};
pub use check::LensRefusal;
pub use check_file::{Fault, check};
pub use circle::{Circle, CircleLens, CircleRefusal, circle_lens, find_circle};
pub use factor::{Factor, Verdict, combine};
pub use frame::{grey, grey_of};
pub use grey::Grey;
pub use guide::{Guide, MOST_VIEWS, Offer, RINGS, SECTORS, ViewCoverage};
pub use lens::{Calibrated, calibrate};
pub use lens_file::{
    FileRefusal, Stated, response_text, write, write_circle, write_response, write_vignetting,
};
pub use photometric::{FactorReading, Method, PhotometricRefusal, Unseen, measure};
pub use photometric_file::{KeepRefusal, Kept, KeptReadings, keep_reading, kept_factor};
pub use request::{Picture, Request};
pub use residuals::picture as residual_picture;
pub use response::{Exposed, FittedResponse, Neighbours, ResponseRefusal, fit_response};
pub use target::{Ink, Target, TargetRefusal, ink, size as target_size, svg as target_svg};
pub use uncertainty::Spread;
pub use vignetting::{
    CodedPicture, FittedVignetting, Reading, VignettingRefusal, fit_vignetting, flat_field, screen,
};
