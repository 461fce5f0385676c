//! The chart of the errors against the slowdown.

use crate::draw::{BLUE, Canvas, GREY, INK, LogAxis, PALE, VERMILLION, plain};
use plotters::style::text_anchor::HPos;

/// Width and height of the page, pixels.
const PAGE: [u32; 2] = [760, 470];
/// Left and right end of the plot, pixels.
const X: [f64; 2] = [64.0, 736.0];
/// Lower and upper end of the plot, pixels.
const Y: [f64; 2] = [360.0, 72.0];
/// Vertical positions of the two rows of numbers below the plot, pixels.
const ROWS: [f64; 2] = [418.0, 442.0];

/// The quality and the errors at one slowdown.
pub(super) struct ChartPoint {
    pub(super) factor: f32,
    pub(super) lights: usize,
    /// Interval of the processed bursts.
    pub(super) every: u32,
    /// Errors of open and of shadowed receivers, as parts of the mean irradiance.
    pub(super) errors: [f64; 2],
}

/// Returns the SVG text of both errors on logarithmic axes; below them, the numbers of lights and of sets a second where they change.
pub(super) fn draw(points: &[ChartPoint]) -> String {
    let mut buffer = String::new();
    let canvas = Canvas::new(&mut buffer, (PAGE[0], PAGE[1]));
    let x = LogAxis::round(points.iter().map(|p| f64::from(p.factor)), X);
    let y = LogAxis::round(points.iter().flat_map(|p| p.errors.map(|e| 100.0 * e)), Y);
    canvas.text("Accuracy on a slower board that keeps its time budget", [16.0, 24.0], HPos::Left, 20, INK);
    axes(&canvas, &x, &y);
    for (k, colour, name) in [(0, BLUE, "open receivers"), (1, VERMILLION, "shadowed receivers")] {
        let at = |p: &ChartPoint| [x.at(f64::from(p.factor)), y.at(100.0 * p.errors[k])];
        let curve: Vec<_> = points.iter().map(at).collect();
        canvas.line(&curve, colour, 3);
        curve.iter().for_each(|at| canvas.dot(*at, 4, colour, false));
        canvas.text(name, [X[0] + 12.0, curve[0][1] + 16.0], HPos::Left, 13, colour);
    }
    row(&canvas, ROWS[0], "lights", points.iter().map(|p| (x.at(f64::from(p.factor)), p.lights.to_string())));
    let rate = |p: &ChartPoint| plain(10.0 / f64::from(p.every));
    row(&canvas, ROWS[1], "sets/s", points.iter().map(|p| (x.at(f64::from(p.factor)), rate(p))));
    canvas.finish();
    buffer
}

fn axes(canvas: &Canvas<'_>, x: &LogAxis, y: &LogAxis) {
    for factor in [1.0, 2.0, 4.0, 8.0, 16.0] {
        canvas.line(&[[x.at(factor), Y[0]], [x.at(factor), Y[1]]], PALE, 1);
        canvas.text(&plain(factor), [x.at(factor), Y[0] + 12.0], HPos::Center, 11, INK);
    }
    for error in y.ticks() {
        canvas.line(&[[X[0], y.at(error)], [X[1], y.at(error)]], PALE, 1);
        canvas.text(&plain(error), [X[0] - 6.0, y.at(error)], HPos::Right, 11, INK);
    }
    canvas.line(&[[X[0], Y[1]], [X[0], Y[0]], [X[1], Y[0]]], INK, 1);
    canvas.text("error of the newest set, % of mean irradiance", [X[0], Y[1] - 14.0], HPos::Left, 12, GREY);
    canvas.text("slowdown", [(X[0] + X[1]) / 2.0, Y[0] + 30.0], HPos::Center, 12, INK);
}

/// Writes each value that differs from the one to its left.
fn row(canvas: &Canvas<'_>, y: f64, name: &str, values: impl Iterator<Item = (f64, String)>) {
    canvas.text(name, [X[0] - 12.0, y], HPos::Right, 11, GREY);
    let mut last = String::new();
    for (x, value) in values {
        if value != last {
            canvas.text(&value, [x, y], HPos::Center, 11, INK);
        }
        last = value;
    }
}
