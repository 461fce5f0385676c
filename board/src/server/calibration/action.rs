//! The actions of `/v1/calibration`, as JSON.

use crate::calibrate::{Board, Charuco, Kind, Printed};
use serde::Deserialize;

/// The action that a client requests.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub(super) enum Action {
    /// Begins the calibration of the lens with pictures of a printed board.
    Start(BoardWish),
    /// Searches the printed board in the next picture; the picture is used if the board is sharp, still and in a new
    /// position.
    Look,
    /// Computes the lens from the pictures of the board that were used.
    Compute,
    /// Detects the image circle of the lens in the next picture.
    FindCircle {
        /// Field of view across the image circle, degrees.
        field_deg: f64,
    },
    /// Sets the image circle of the lens.
    Circle {
        /// Centre of the image circle, pixels.
        centre: [f64; 2],
        /// Radius of the image circle, pixels.
        radius: f64,
        /// Field of view across the image circle, degrees.
        field_deg: f64,
    },
    /// Adds the reading of a lit screen in the next picture to the readings of the vignetting.
    Screen,
    /// Adds vignetting readings of an evenly lit surface that fills the field of view, from the next picture.
    Flat,
    /// Fits the vignetting of the lens to all vignetting readings.
    FitVignetting,
    /// Computes the response of the camera from the frames of the next burst.
    Response,
    /// Adds a photometric reading of a luxmeter next to the probe.
    Direct {
        /// Reading of the luxmeter, lux.
        lux: f64,
        /// Class of the light source, such as `daylight`.
        class: Option<String>,
    },
    /// Adds a photometric reading of a luxmeter that lies on a patch of known reflectance.
    Patch {
        /// Corners of the patch in the picture, pixels.
        outline: Vec<[f64; 2]>,
        /// Reflectance of the patch: above 0, at most 1.
        reflectance: f64,
        /// Illuminance of the patch, which the luxmeter reads, lux.
        lux: f64,
        /// Class of the light source, such as `daylight`.
        class: Option<String>,
    },
    /// Removes the last addition to one part of the calibration.
    Undo {
        /// Part of the calibration from which the last addition is removed.
        part: Part,
    },
    /// Discards all unsaved results of the calibration.
    Reset,
    /// Writes all unsaved results of the calibration to the lens file.
    Save {
        /// True if the results replace tables of the lens file, and a lens of the file that is more accurate.
        #[serde(default)]
        force: bool,
    },
}

impl Action {
    /// Returns true if the action needs the frames of the next burst.
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

/// A part of the calibration whose last addition can be removed.
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
    /// Number of inner corners of the board, or of tags on it, as `COLUMNSxROWS`.
    board: String,
    /// Kind of the printed board: `chessboard`, `charuco` or `aprilgrid`.
    kind: Option<String>,
    /// Name of the marker dictionary of a ChArUco board.
    dictionary: Option<String>,
    /// Side of a marker of a ChArUco board, in sides of a square.
    marker: Option<f64>,
    /// Gap between the tags of an AprilGrid, in sides of a tag.
    gap: Option<f64>,
}

impl BoardWish {
    /// Converts the request to a description of the printed board.
    ///
    /// # Errors
    /// The field of the request that is missing or out of range, with its range.
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
