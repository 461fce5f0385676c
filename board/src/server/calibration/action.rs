//! The actions of `/v1/calibration`, as JSON.

use crate::calibrate::{Board, Charuco, Kind, Printed};
use serde::Deserialize;

/// The action that a client requests.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub(super) enum Action {
    /// Begins the calibration of the lens with a printed board.
    Start(BoardWish),
    /// Searches the board in the next picture; the picture is used if the board is sharp, still and in a new position.
    Look,
    /// Computes the lens from the pictures with a board.
    Compute,
    /// Detects the image circle in the next picture.
    FindCircle {
        /// Field of view across the circle, degrees.
        field_deg: f64,
    },
    /// Sets the image circle.
    Circle {
        /// Centre of the circle, pixels.
        centre: [f64; 2],
        /// Radius of the circle, pixels.
        radius: f64,
        /// Field of view across the circle, degrees.
        field_deg: f64,
    },
    /// Adds the reading of a lit screen in the next picture to the readings of the vignetting.
    Screen,
    /// Adds readings of an evenly lit surface that fills the field of view.
    Flat,
    /// Fits the vignetting to the readings.
    FitVignetting,
    /// Computes the response from the frames of the next burst.
    Response,
    /// Adds a photometric reading of a luxmeter next to the probe.
    Direct {
        /// Reading of the luxmeter, lux.
        lux: f64,
        /// Class of the light source, such as daylight.
        class: Option<String>,
    },
    /// Adds a photometric reading of a luxmeter on a patch.
    Patch {
        /// Corners of the patch, pixels.
        outline: Vec<[f64; 2]>,
        /// Reflectance of the patch, above 0, at most 1.
        reflectance: f64,
        /// Illuminance on the patch, lux.
        lux: f64,
        /// Class of the light source, such as daylight.
        class: Option<String>,
    },
    /// Removes the last addition to a part.
    Undo {
        /// Part of the calibration whose last addition is removed.
        part: Part,
    },
    /// Discards all unsaved results.
    Reset,
    /// Writes all unsaved results to the lens file.
    Save {
        /// True if better lenses and existing tables of the file are replaced.
        #[serde(default)]
        force: bool,
    },
}

impl Action {
    /// Returns true if the action uses the next burst.
    pub(super) fn needs_view(&self) -> bool {
        matches!(
            self,
            Self::Look
                | Self::FindCircle { .. }
                | Self::Circle { .. }
                | Self::Screen
                | Self::Flat
                | Self::FitVignetting
                | Self::Response
                | Self::Direct { .. }
                | Self::Patch { .. }
        )
    }
}

/// A part of the calibration.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Part {
    Lens,
    Circle,
    Vignetting,
    Response,
    Photometric,
}

/// The printed board that is shown to the camera.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub(super) struct BoardWish {
    /// Number of inner corners, or of tags, as COLUMNSxROWS.
    board: String,
    /// Kind of the board: `chessboard`, `charuco` or `aprilgrid`.
    kind: Option<String>,
    /// Name of the dictionary of a ChArUco board.
    dictionary: Option<String>,
    /// Side of a marker, as a part of a square's side.
    marker: Option<f64>,
    /// Gap between tags, as a part of a tag's side.
    gap: Option<f64>,
}

impl BoardWish {
    /// Converts the request to a board.
    ///
    /// # Errors
    /// The part that is missing or out of range, with its range.
    pub(super) fn printed(&self) -> Result<Printed, String> {
        let board: Board = self.board.parse()?;
        match self.kind.as_deref().unwrap_or("chessboard") {
            "chessboard" => Ok(board.into()),
            "charuco" => {
                let dictionary = self.dictionary.as_deref().unwrap_or("DICT_5X5_100");
                let charuco = Charuco::new(dictionary, self.marker.unwrap_or(0.75));
                let charuco =
                    charuco.ok_or("expected a dictionary of OpenCV and a marker of 0.4 to 0.95 squares")?;
                Ok(Printed { corners: board, kind: Kind::Charuco(charuco) })
            }
            "aprilgrid" => Printed::april_grid(board, self.gap.unwrap_or(0.3))
                .ok_or_else(|| "expected at most 587 tags and a gap of 0.1 to 1 tags".into()),
            _ => Err("expected the kind chessboard, charuco or aprilgrid".into()),
        }
    }
}
