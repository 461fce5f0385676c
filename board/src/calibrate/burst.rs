//! Recorded bursts as the calibration of the response reads them.

use super::response::Exposed;
use crate::calibration::{Calibration, Pixels};
use crate::recorded::{RecordedError, read_burst};
use glam::DVec2;
use hemilux_core::format::Format;
use std::path::Path;

/// Pixels of each frame at most; more add time and no accuracy.
const MOST_PIXELS: usize = 200_000;

/// Reads a burst: its calibration, its frames in ascending order of exposure, and the size of one code in relative codes.
///
/// # Errors
/// [`RecordedError`]; raw frames are refused, since sensors are linear.
pub fn exposed(folder: &Path) -> Result<(Calibration, Vec<Exposed>, f64), RecordedError> {
    let (calibration, burst) = read_burst(folder)?;
    let format = calibration.layout.format();
    if !matches!(format, Format::Rgb24 | Format::Rgb48) {
        let found = format!("frames of the format {format:?}");
        return Err(RecordedError::new(folder, found, "images: raw frames are linear and need no response"));
    }
    let places = places(&calibration);
    let levels = calibration.levels;
    let range = levels.white - levels.black;
    let relative = |code: u32| ((f64::from(code) - levels.black) / range) as f32;
    let frame = |frame: &crate::calibration::Frame| {
        let code = |at: usize| {
            relative(match &frame.pixels {
                Pixels::U8(codes) => codes[at].into(),
                Pixels::U16(codes) => codes[at].into(),
            })
        };
        let codes = places.iter().map(|at| [code(3 * at), code(3 * at + 1), code(3 * at + 2)]).collect();
        Exposed { exposure: frame.exposure.seconds * frame.exposure.gain, codes }
    };
    Ok((calibration, burst.frames.iter().map(frame).collect(), 1.0 / range))
}

/// The pixels inside of the image circle, thinned.
fn places(calibration: &Calibration) -> Vec<usize> {
    let width = calibration.layout.width() as usize;
    let pixels = width * calibration.layout.height() as usize;
    let sees = |at: &usize| {
        calibration.lens.unproject(DVec2::new((at % width) as f64, (at / width) as f64)).is_some()
    };
    (0..pixels).step_by(pixels.div_ceil(MOST_PIXELS).max(1)).filter(sees).collect()
}
