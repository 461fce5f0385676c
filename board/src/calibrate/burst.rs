//! Recorded bursts as input of the response calibration.

use super::response::Exposed;
use crate::calibration::{Calibration, Frame, Pixels};
use crate::recorded::{RecordedBurst, RecordedError, read_burst};
use glam::DVec2;
use hemilux_core::format::Format;
use std::path::Path;

/// Largest number of pixels that are read from each frame of a burst; more pixels take time and add no accuracy.
const MOST_PIXELS: usize = 200_000;

/// The frames of a recorded burst as relative codes, with the calibration of its camera.
#[derive(Clone, Debug)]
pub struct ExposedBurst {
    /// Calibration of the burst's camera.
    pub calibration: Calibration,
    /// Relative codes of the pixels of all frames of the burst.
    pub codes: Codes,
}

/// Reads the burst in `folder` and converts its frames to relative codes.
///
/// # Errors
/// [`RecordedError`] for a burst that cannot be read, and for raw frames, since sensors are linear and need no response.
pub fn exposed(folder: &Path) -> Result<ExposedBurst, RecordedError> {
    let RecordedBurst { calibration, burst, .. } = read_burst(folder)?;
    match exposed_frames(&calibration, &burst.frames) {
        Some(codes) => Ok(ExposedBurst { calibration, codes }),
        None => {
            let found = format!("frames of the format {:?}", calibration.layout.format());
            Err(RecordedError::new(folder, found, "images: raw frames are linear and need no response"))
        }
    }
}

/// Relative codes of the pixels of all frames of a burst.
#[derive(Clone, Debug)]
pub struct Codes {
    /// Relative codes of the frames, in ascending order of exposure.
    pub frames: Vec<Exposed>,
    /// Difference of relative code between two neighbouring codes of the frames.
    pub step: f64,
}

/// Computes the relative codes of `frames`; `None` for raw frames and for frames that are shorter than their layout.
#[must_use]
pub fn exposed_frames(calibration: &Calibration, frames: &[Frame]) -> Option<Codes> {
    let is_image = matches!(calibration.layout.format(), Format::Rgb24 | Format::Rgb48);
    let is_whole = |frame: &Frame| frame.pixels.samples().len() >= calibration.layout.frame_samples();
    if !is_image || !frames.iter().all(is_whole) {
        return None;
    }
    let places = places(calibration);
    let levels = calibration.levels;
    let range = levels.white - levels.black;
    let relative = |code: u32| ((f64::from(code) - levels.black) / range) as f32;
    let exposed = |frame: &Frame| {
        let code = |at: usize| {
            relative(match &frame.pixels {
                Pixels::U8(codes) => codes[at].into(),
                Pixels::U16(codes) => codes[at].into(),
            })
        };
        let codes = places.iter().map(|at| [code(3 * at), code(3 * at + 1), code(3 * at + 2)]).collect();
        Exposed { exposure: frame.exposure.seconds * frame.exposure.gain, codes }
    };
    Some(Codes { frames: frames.iter().map(exposed).collect(), step: 1.0 / range })
}

/// Returns the indices of a subset of the pixels inside of the image circle.
fn places(calibration: &Calibration) -> Vec<usize> {
    let width = calibration.layout.width() as usize;
    let pixels = width * calibration.layout.height() as usize;
    let sees = |at: &usize| {
        calibration.lens.unproject(DVec2::new((at % width) as f64, (at / width) as f64)).is_some()
    };
    (0..pixels).step_by(pixels.div_ceil(MOST_PIXELS).max(1)).filter(sees).collect()
}
