//! Drawing of the stress report: one panel per scenario, one line per method, errors and flicker in per cent on one logarithmic axis.

use super::StressRow;
use crate::contender::{MethodKind, methods};
use crate::draw::{BLUE, Canvas, GREEN, GREY, INK, LogAxis, PALE, PURPLE, VERMILLION, plain};
use crate::scenario;
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;

/// Number of panels in a row of the page.
const COLUMNS: usize = 4;
/// Width of the names of the methods, pixels.
const LABELS: f64 = 112.0;
/// Width of the plot of a panel, pixels.
const PLOT: f64 = 190.0;
/// Width of the column of figures at the right of a panel, pixels.
const EXTRA: f64 = 56.0;
/// Height of the line of a method, pixels.
const LINE: f64 = 14.0;
/// Height of the title of a panel, pixels.
const HEAD: f64 = 34.0;
/// Height of the axis labels of a panel, pixels.
const FOOT: f64 = 30.0;
/// Space between panels, pixels.
const MARGIN: f64 = 14.0;
/// Height of the title of the page, pixels.
const TITLE: f64 = 70.0;
/// Height of the legend, pixels; the legend has the position of one more panel.
const LEGEND_HEIGHT: f64 = 210.0;
/// Values at the ends of every panel's axis, per cent.
const RANGE: [f64; 2] = [0.02, 300.0];
/// Ratio of a method's error or flicker to the median of the panel above which the method fails.
const FAILS: f64 = 2.5;
/// Error or flicker, a ratio, above which a method fails in any case.
const BAD: f64 = 0.1;
/// Flicker, a ratio, below which a method does not fail, since it is not visible.
const LEAST_FLICKER: f64 = 0.005;
/// Background colour of the line of a method that fails.
const FAILED: RGBColor = RGBColor(255, 240, 214);

/// Returns the SVG text of the page for one number of lights.
pub(super) fn svg(rows: &[StressRow], lights: usize) -> String {
    let rows: Vec<&StressRow> = rows.iter().filter(|row| row.lights == lights).collect();
    let panels: Vec<Vec<&StressRow>> = scenario::NAMES
        .iter()
        .map(|name| rows.iter().copied().filter(|row| row.scenario == *name).collect())
        .collect();
    let lines = panels.iter().map(Vec::len).max().unwrap_or(0);
    let size =
        [LABELS + PLOT + EXTRA + MARGIN, (HEAD + LINE * lines as f64 + FOOT + MARGIN).max(LEGEND_HEIGHT)];
    // The legend has the position of one more panel.
    let down = (panels.len() + 1).div_ceil(COLUMNS);
    let page = (MARGIN + size[0] * COLUMNS as f64, TITLE + size[1] * down as f64);
    let mut buffer = String::new();
    let canvas = Canvas::new(&mut buffer, (page.0 as u32, page.1 as u32));
    canvas.text(&format!("Where each method fails, {lights} lights"), [MARGIN, 24.0], HPos::Left, 22, INK);
    let note = "Error and flicker of every method over every scenario, per cent of the mean irradiance, log scale; \
                the further left the better.";
    canvas.text(note, [MARGIN, 48.0], HPos::Left, 13, GREY);
    for (k, panel) in panels.iter().enumerate() {
        let corner = [MARGIN + size[0] * (k % COLUMNS) as f64, TITLE + size[1] * (k / COLUMNS) as f64];
        draw_panel(&canvas, corner, scenario::NAMES[k], panel);
    }
    let k = panels.len();
    legend(&canvas, [MARGIN + size[0] * (k % COLUMNS) as f64, TITLE + size[1] * (k / COLUMNS) as f64]);
    canvas.finish();
    buffer
}

fn draw_panel(canvas: &Canvas<'_>, [x, y]: [f64; 2], name: &str, rows: &[&StressRow]) {
    let axis = LogAxis { values: RANGE, pixels: [x + LABELS, x + LABELS + PLOT] };
    let (top, bottom) = (y + HEAD, y + HEAD + LINE * rows.len() as f64);
    canvas.text(name, [x + LABELS, y + 10.0], HPos::Left, 15, INK);
    let extra = Extra::of(rows);
    canvas.text(extra.head(), [x + LABELS + PLOT + EXTRA - 4.0, y + 26.0], HPos::Right, 10, GREY);
    let error = BAD.min(FAILS * median(rows, |r| r.shadowed));
    let flicker = BAD.min((FAILS * median(rows, |r| r.flicker_mean)).max(LEAST_FLICKER));
    let fails = |row: &StressRow| {
        row.shadowed.is_some_and(|v| v > error) || row.flicker_mean.is_some_and(|v| v > flicker)
    };
    for (k, _) in rows.iter().enumerate().filter(|(_, row)| fails(row)) {
        let above = top + LINE * k as f64;
        canvas.rect([x, above], [x + LABELS + PLOT + EXTRA, above + LINE], FAILED);
    }
    for value in axis.ticks() {
        let at = axis.at(value);
        canvas.line(&[[at, top], [at, bottom]], PALE, 1);
        canvas.text(&format!("{} %", plain(value)), [at, bottom + 10.0], HPos::Center, 10, GREY);
    }
    let core: Vec<_> = methods().into_iter().filter(|m| m.kind == MethodKind::Core).collect();
    for (k, row) in rows.iter().enumerate() {
        let middle = top + LINE * (k as f64 + 0.5);
        let colour = if core.iter().any(|m| m.name == row.sampler) { INK } else { GREY };
        canvas.text(row.sampler, [x + LABELS - 6.0, middle], HPos::Right, 11, colour);
        canvas.text(&extra.value(row), [x + LABELS + PLOT + EXTRA - 4.0, middle], HPos::Right, 10, colour);
        marks(canvas, &axis, middle, row);
    }
}

fn marks(canvas: &Canvas<'_>, axis: &LogAxis, y: f64, row: &StressRow) {
    let at = |v: f64| [axis.at(100.0 * v), y];
    if let (Some(mean), Some(max)) = (row.flicker_mean, row.flicker_max) {
        canvas.line(&[at(mean), at(max)], VERMILLION, 1);
        let [x, y] = at(max);
        canvas.line(&[[x, y - 3.0], [x, y + 3.0]], VERMILLION, 1);
        canvas.dot(at(mean), 4, VERMILLION, true);
    }
    row.unwarranted.iter().for_each(|&v| canvas.square(at(v), 3.0, PURPLE));
    row.transit.iter().for_each(|&v| canvas.cross(at(v), 3.0, GREEN));
    row.shadowed.iter().for_each(|&v| canvas.dot(at(v), 4, BLUE, false));
}

/// Returns the median of a figure over a panel's methods; infinity if no method has the figure.
fn median(rows: &[&StressRow], of: impl Fn(&StressRow) -> Option<f64>) -> f64 {
    let mut values: Vec<f64> = rows.iter().filter_map(|row| of(row)).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// The figure in the column at the right of a panel.
#[derive(Clone, Copy)]
enum Extra {
    Lag,
    Tracking,
    Step,
    Noise,
    Churn,
}

impl Extra {
    /// Returns the first figure that a row of the panel contains, in the order of the variants; `Churn` otherwise.
    fn of(rows: &[&StressRow]) -> Self {
        if rows.iter().any(|r| r.lag_frames.is_some()) {
            Self::Lag
        } else if rows.iter().any(|r| r.tracking_deg.is_some()) {
            Self::Tracking
        } else if rows.iter().any(|r| r.step_frames.is_some()) {
            Self::Step
        } else if rows.iter().any(|r| r.motion_noise_deg.is_some()) {
            Self::Noise
        } else {
            Self::Churn
        }
    }

    fn head(self) -> &'static str {
        match self {
            Self::Lag => "late by",
            Self::Tracking => "off source",
            Self::Step => "settles in",
            Self::Noise => "moves a frame",
            Self::Churn => "churn a frame",
        }
    }

    fn value(self, row: &StressRow) -> String {
        let text = match self {
            Self::Lag => row.lag_frames.map(|v| format!("{v:.1} fr.")),
            Self::Tracking => row.tracking_deg.map(|v| format!("{v:.1}°")),
            Self::Step => row.step_frames.map(|v| format!("{v} fr.")),
            Self::Noise => row.motion_noise_deg.map(|v| format!("{v:.2}°")),
            Self::Churn => row.churn.map(|v| format!("{v:.1}")),
        };
        text.unwrap_or_else(|| "–".into())
    }
}

fn legend(canvas: &Canvas<'_>, [x, y]: [f64; 2]) {
    let line = |k: usize| y + 40.0 + 22.0 * k as f64;
    let text = |k: usize, words: &str| canvas.text(words, [x + 34.0, line(k)], HPos::Left, 12, INK);
    canvas.text("How to read it", [x, y + 10.0], HPos::Left, 15, INK);
    canvas.dot([x + 14.0, line(0)], 4, BLUE, false);
    text(0, "shadowed error, mean over the frames");
    canvas.dot([x + 8.0, line(1)], 4, VERMILLION, true);
    canvas.line(&[[x + 8.0, line(1)], [x + 24.0, line(1)]], VERMILLION, 1);
    canvas.line(&[[x + 24.0, line(1) - 3.0], [x + 24.0, line(1) + 3.0]], VERMILLION, 1);
    text(1, "flicker: mean to largest");
    canvas.square([x + 14.0, line(2)], 3.0, PURPLE);
    text(2, "leak of a switched lamp (switch)");
    canvas.cross([x + 14.0, line(3)], 3.0, GREEN);
    text(3, "energy in empty sky over the lamp's (switch)");
    canvas.rect([x, line(4) - 7.0], [x + 28.0, line(4) + 7.0], FAILED);
    text(4, &format!("error or flicker > {FAILS} x the median, or > {} %", plain(100.0 * BAD)));
    text(5, "black names: the probe's samplers; grey: the literature's");
    text(6, &format!("what is off the axis stands at its end: {} or {} %", RANGE[0], RANGE[1]));
}
