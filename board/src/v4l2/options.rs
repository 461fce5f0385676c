//! The options of a camera, and the result of their negotiation.

use super::CameraError;
use super::view::View;
use crate::recorded::Shown;
use hemilux_core::Response;
use hemilux_core::lens::Lens;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A control in the place of the exposure, for benches whose camera has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandIn {
    /// The control's name, in any case of letters.
    pub control: String,
    /// Its values, one for each exposure in the same order.
    pub values: Vec<i64>,
}

/// The mode for which a lens file was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensFit {
    /// Columns and rows of the pictures.
    pub size: (u32, u32),
    /// The part of the sensor that they show, where the file tells it: the lens is then converted to other parts.
    pub shown: Option<Shown>,
    /// The lens.
    pub lens: Lens,
}

/// The requested options.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The camera's node, its media device, or the beginning of its sensor's name.
    pub path: PathBuf,
    /// The sensor's sub-device or the beginning of its name, where it is not the only one.
    pub subdevice: Option<PathBuf>,
    /// Columns and rows.
    pub size: (u32, u32),
    /// Whether a sensor that is known is asked for the mode that sees all of it in place of `size`.
    pub full_view: bool,
    /// What pictures must be like, where a lens is known for no other.
    pub lens: Option<LensFit>,
    /// Pixel format; the best readable one otherwise.
    pub fourcc: Option<u32>,
    /// Frames a second.
    pub rate_hz: f64,
    /// Exposure times, seconds.
    pub exposures_s: Vec<f64>,
    /// A control in the place of the exposure.
    pub stand_in: Option<StandIn>,
    /// Frames after the next one until a control acts; found out otherwise.
    pub delay: Option<u32>,
    /// Codes to relative exposure; by the pixel format otherwise.
    pub response: Option<Response>,
    /// Codes of darkness and of relative exposure 1; by the sensor and the pixel format otherwise.
    pub levels: Option<(f64, f64)>,
}

impl Options {
    /// The default options for the camera at `path`.
    #[must_use]
    pub fn of(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            subdevice: None,
            size: (640, 480),
            full_view: true,
            lens: None,
            fourcc: None,
            rate_hz: 30.0,
            exposures_s: vec![0.000_9, 0.005_5, 0.033_3],
            stand_in: None,
            delay: None,
            response: None,
            levels: None,
        }
    }
}

/// One thing that was asked for, and what came of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Agreed {
    /// Name of the option.
    pub what: &'static str,
    /// Asked for.
    pub asked: String,
    /// Got.
    pub got: String,
}

impl LensFit {
    /// Checks that pictures of `size`, which show `view` of the sensor, have a lens.
    pub(super) fn check(&self, got: (u32, u32), view: Option<&View>, path: &Path) -> Result<(), CameraError> {
        let refuse = |found, expected| Err(CameraError::Unfit { path: path.into(), found, expected });
        match (self.shown, view) {
            (Some(shown), Some(view)) if shown.convert(&self.lens, &view.shown()).is_some() => Ok(()),
            (Some(shown), Some(view)) => {
                let [x, y, width, height] = shown.crop;
                let expected = format!(
                    "a mode that shows the middle of {width} x {height} at {x}, {y} as the lens file says: another size= or another lens"
                );
                refuse(format!("pictures of {view}"), expected)
            }
            _ if self.size == got => Ok(()),
            _ => {
                let expected =
                    format!("{} as the lens file says: another size= or another lens", told(self.size));
                refuse(format!("pictures of {} pixels", told(got)), expected)
            }
        }
    }
}

fn told((width, height): (u32, u32)) -> String {
    format!("{width} x {height}")
}
