//! Drawing of a calibration's residuals over the image.

use super::Calibrated;
use std::fmt::Write;

/// Length of the arrow for a residual of one pixel, in pixels of the drawing.
const LENGTH: f64 = 60.0;

/// Draws an arrow from each detected corner in the direction of its residual, with 60 times the residual's length, as SVG.
#[must_use]
pub fn picture(calibrated: &Calibrated) -> String {
    let [width, height] = calibrated.size;
    let arrows: String = calibrated.residuals.iter().map(arrow).collect();
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\">\n<title>Residuals, {LENGTH} times as long</title>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <path d=\"{arrows}\" stroke=\"#b00\" stroke-width=\"1.5\" fill=\"none\"/>\n"
    );
    for degrees in [30.0, 60.0, 90.0] {
        circle(&mut text, calibrated, degrees);
    }
    let _ = writeln!(
        text,
        "<text x=\"8\" y=\"{}\" font-family=\"sans-serif\" font-size=\"16\">RMS {:.3} px, largest {:.3} px; circles at 30, 60 and 90 degrees</text>\n</svg>",
        height - 8,
        calibrated.rms_px,
        calibrated.largest_px
    );
    text
}

fn arrow(residual: &super::lens::Residual) -> String {
    let (at, tip) = (residual.at, residual.off * LENGTH);
    format!("M{:.1} {:.1}l{:.1} {:.1}m-2 -2h4v4h-4z", at.x, at.y, tip.x, tip.y)
}

fn circle(text: &mut String, calibrated: &Calibrated, degrees: f64) {
    let theta = degrees.to_radians();
    let at = |phi: f64| {
        let direction = glam::DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        calibrated.lens.project(direction)
    };
    let points: Option<Vec<_>> = (0..72).map(|i| at(f64::from(i) * 5f64.to_radians())).collect();
    let Some(points) = points else { return };
    let points: String = points.iter().map(|p| format!("{:.1},{:.1} ", p.x, p.y)).collect();
    let _ = writeln!(text, "<polygon points=\"{}\" stroke=\"#999\" fill=\"none\"/>", points.trim_end());
}
