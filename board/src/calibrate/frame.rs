//! Grey pictures from the frames of a burst.

use super::Grey;
use crate::calibration::{Burst, Calibration, Frame};
use hemilux_core::{Response, read_rgb_row};

/// Largest share of clipped pixels in a picture that is taken.
const MOST_CLIPPED: f64 = 0.01;

/// The longest exposure in which little is clipped, else the shortest, as a grey picture of the frame's size; `None` without whole frames.
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

/// A frame as a grey picture: green, which mosaics sample most densely; a linear one with a curve, so that shadows have codes.
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
