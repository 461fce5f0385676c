//! Options of a camera, and the result of their negotiation.

use super::view::View;
use super::{CameraError, Size};
use crate::recorded::Shown;
use hemilux_core::lens::Lens;
use hemilux_core::{Levels, Response};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A control that replaces the exposure control, on a test bench whose camera has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandIn {
    /// Name of the replacing control; case is ignored.
    pub control: String,
    /// Values of the control, one for each exposure, in the order of the exposures.
    pub values: Vec<i64>,
}

/// The camera mode to which a lens file applies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensFit {
    /// Size of the pictures of the mode.
    pub size: Size,
    /// Part of the sensor that the pictures cover, if the lens file contains it; the lens can then be converted to other
    /// parts.
    pub shown: Option<Shown>,
    /// Lens model that the lens file states.
    pub lens: Lens,
}

/// Requested options of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Path of the camera's node or media device, or a prefix of its sensor's name.
    pub path: PathBuf,
    /// Path of the sensor's sub-device or a prefix of its name; required if there are several.
    pub subdevice: Option<PathBuf>,
    /// Size of the pictures that is requested from the camera.
    pub size: Size,
    /// True if a sensor of the table is set to the mode that covers the whole sensor, in place of `size`.
    pub full_view: bool,
    /// The mode to which the lens file applies; pictures must have it.
    pub lens: Option<LensFit>,
    /// FourCC of the requested pixel format; by default the most preferred readable one.
    pub fourcc: Option<u32>,
    /// Frame rate that is requested from the camera, hertz.
    pub rate_hz: f64,
    /// Whether a rate of up to 15 % less than `rate_hz` is taken if it shows lamps on the mains at phases that differ from burst to burst.
    pub spreads_phases: bool,
    /// Exposure times that are requested from the camera, seconds.
    pub exposures_s: Vec<f64>,
    /// Whether the exposures follow the light of the scene; `exposures_s` are then those of the first burst.
    pub follows_light: bool,
    /// A control that replaces the exposure control, for a test bench; `None` for a real camera.
    pub stand_in: Option<StandIn>,
    /// Control delay, frames after the next one; `None` if it is measured.
    pub delay: Option<u32>,
    /// Camera response from codes to relative exposure; by default it follows from the pixel format.
    pub response: Option<Response>,
    /// Codes of black and of relative exposure 1; by default they follow from the sensor and the pixel format.
    pub levels: Option<Levels>,
}

impl Options {
    /// Returns the default options for the camera at `path`.
    #[must_use]
    pub fn of(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            subdevice: None,
            size: Size::new(640, 480),
            full_view: true,
            lens: None,
            fourcc: None,
            rate_hz: 30.0,
            spreads_phases: true,
            exposures_s: vec![0.000_9, 0.005_5, 0.033_3],
            follows_light: false,
            stand_in: None,
            delay: None,
            response: None,
            levels: None,
        }
    }
}

/// A requested property and the value that the camera granted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Agreed {
    /// Name of the option whose value was not granted as requested.
    pub what: &'static str,
    /// Description of the requested value.
    pub asked: String,
    /// Description of the granted value.
    pub got: String,
}

impl LensFit {
    /// Checks that the lens file applies to pictures of size `got` that cover `view` of the sensor.
    pub(super) fn check(&self, got: Size, view: Option<&View>, path: &Path) -> Result<(), CameraError> {
        let refuse = |found, expected| Err(CameraError::Unfit { path: path.into(), found, expected });
        match (self.shown, view) {
            (Some(shown), Some(view)) if shown.convert(&self.lens, &view.shown()).is_some() => Ok(()),
            (Some(shown), Some(view)) => {
                let [x, y, width, height] = shown.crop;
                let expected = format!(
                    "a mode that shows the middle of {width} x {height} at {x}, {y} as in the lens file: another size= or another lens"
                );
                refuse(format!("pictures of {view}"), expected)
            }
            _ if self.size == got => Ok(()),
            _ => {
                let expected = format!("{} as in the lens file: another size= or another lens", self.size);
                refuse(format!("pictures of {} pixels", got), expected)
            }
        }
    }
}
