//! Conversion of a burst's frames to grey pictures.

use super::Grey;
use crate::calibration::{Burst, Calibration, Frame};
use hemilux_core::{Response, read_rgb_row};

/// Largest accepted fraction of clipped pixels in a frame, 0 to 1.
const MOST_CLIPPED: f64 = 0.01;

/// Returns the frame with the longest exposure that has few clipped pixels, else that with the shortest exposure, as a grey picture of the
/// frame's size; `None` if a frame is incomplete.
#[must_use]
pub fn grey_of(burst: &Burst, calibration: &Calibration) -> Option<Grey> {
    let mut best = None;
    for frame in &burst.frames {
        let picture = grey(frame, calibration)?;
        let clipped = picture.pixels().iter().filter(|v| **v >= 250).count() as f64;
        let is_clipped = clipped > MOST_CLIPPED * picture.pixels().len() as f64;
        if best.is_none() || !is_clipped {
            best = Some(picture);
        }
    }
    best
}

/// Converts a frame to a grey picture of its green channel, which has the most samples in a mosaic; linear frames are converted by a curve
/// that preserves differences in the shadows.
#[must_use]
pub fn grey(frame: &Frame, calibration: &Calibration) -> Option<Grey> {
    let layout = &calibration.layout;
    if frame.pixels.samples().len() < layout.frame_samples() {
        return None;
    }
    let (black, white) = (calibration.levels.black, calibration.levels.white);
    let is_linear = matches!(calibration.response, Response::Linear);
    let code = |v: u16| {
        let x = ((f64::from(v) - black) / (white - black)).clamp(0.0, 1.0);
        (255.0 * if is_linear { x.sqrt() } else { x }).round() as u8
    };
    let mut row = vec![[0u16; 3]; layout.width() as usize];
    let mut pixels = Vec::with_capacity(row.len() * layout.height() as usize);
    for y in 0..layout.height() {
        read_rgb_row(layout, frame.pixels.samples(), y, &mut row);
        pixels.extend(row.iter().map(|rgb| code(rgb[1])));
    }
    Grey::new(row.len(), pixels)
}
