//! The actions, as JSON.

use crate::calibrate::{Board, Charuco, Kind, Printed};
use serde::Deserialize;

/// The action that a client requests.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(tag = "do", rename_all = "kebab-case")]
pub(super) enum Action {
    /// Begins the calibration of the lens by a board.
    Start(BoardWish),
    /// Looks at the next picture and takes it if its board is sharp, still and new.
    Look,
    /// Computes the lens from the pictures that were taken.
    Compute,
    /// Finds the image circle in the next picture.
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
    /// Adds the reading of a lit screen in the next picture to those of the vignetting.
    Screen,
    /// Adds readings of an evenly lit surface that fills the view.
    Flat,
    /// Fits the vignetting to its readings.
    FitVignetting,
    /// Computes the response from the next burst.
    Response,
    /// Adds a photometric reading of a luxmeter beside the probe.
    Direct {
        /// Reading of the luxmeter, lux.
        lux: f64,
        /// Class of light source.
        class: Option<String>,
    },
    /// Adds a photometric reading of a luxmeter on a patch.
    Patch {
        /// Corners of the patch, pixels.
        outline: Vec<[f64; 2]>,
        /// Share of the light that it reflects.
        reflectance: f64,
        /// Illuminance on the patch, lux.
        lux: f64,
        /// Class of light source.
        class: Option<String>,
    },
    /// Takes the last addition of a part back.
    Undo {
        /// Part of the calibration.
        part: Part,
    },
    /// Forgets everything that was not saved.
    Reset,
    /// Writes everything to the lens file.
    Save {
        /// Whether better lenses and existing tables are replaced.
        #[serde(default)]
        force: bool,
    },
}

impl Action {
    /// Whether it looks at the next burst.
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

/// The board that is shown.
#[derive(Clone, Debug, Deserialize, PartialEq)]
pub(super) struct BoardWish {
    /// Inner corners, or tags, columns by rows.
    board: String,
    /// `chessboard`, `charuco` or `aprilgrid`.
    kind: Option<String>,
    /// Dictionary of a ChArUco board.
    dictionary: Option<String>,
    /// Side of a marker, in squares.
    marker: Option<f64>,
    /// Gap between tags, in tags.
    gap: Option<f64>,
}

impl BoardWish {
    /// The board, or what was found and what was expected.
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
