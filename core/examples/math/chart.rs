//! Formats the comparison of implementations as a table and as a chart.

use super::ways::{Function, WAYS};
use std::fmt::Write;

/// The figures of one function in all implementations.
pub struct Row {
    pub function: &'static Function,
    /// Largest error of each implementation of the function, in the order of [`WAYS`].
    pub errors: [f64; WAYS.len()],
    /// Instructions per call on ARMv7 of each implementation; `None` where they were not counted.
    pub counts: [Option<f64>; WAYS.len()],
}

/// Formats the figures as plain text, one function per line.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from("largest error / instructions of a call on ARMv7\n");
    let _ = write!(text, "{:<10}{:<28}{:<10}", "", "used for", "error is");
    WAYS.iter().for_each(|way| _ = write!(text, "{way:>20}"));
    text.push('\n');
    for row in rows {
        let unit = if row.function.relative { "a ratio" } else { "absolute" };
        let _ = write!(text, "{:<10}{:<28}{unit:<10}", row.function.name, row.function.used);
        for (error, count) in row.errors.iter().zip(row.counts) {
            let count = count.map_or("-".into(), |n| format!("{n:.0}"));
            let _ = write!(text, "{:>20}", format!("{error:.1e} / {count}"));
        }
        text.push('\n');
    }
    text
}

/// Colours of the implementations in the chart, from the palette of Okabe and Ito.
const COLOURS: [&str; WAYS.len()] = ["#0072b2", "#d55e00", "#009e73", "#222222"];

/// Left and right edges of the two panels of the chart, pixels; rows start at `TOP` and are `STEP` apart.
const PANELS: [[f64; 2]; 2] = [[110.0, 470.0], [530.0, 890.0]];
const TOP: f64 = 90.0;
const STEP: f64 = 34.0;

/// Draws the chart: errors on the left, instructions on the right, both on logarithmic axes.
pub fn svg(rows: &[Row]) -> String {
    let bottom = TOP + STEP * rows.len() as f64;
    let mut s = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"920\" height=\"{}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        bottom + 50.0
    );
    let mut put = |x: f64, y: f64, anchor: &str, colour: &str, words: &str| {
        let _ = writeln!(
            s,
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{words}</text>"
        );
    };
    put(16.0, 24.0, "start", "#222222", "Functions of the core: error and time by where they come from");
    for (i, way) in WAYS.iter().enumerate() {
        put(110.0 + 110.0 * i as f64, 50.0, "start", COLOURS[i], &format!("\u{25cf} {way}"));
    }
    put(PANELS[0][0], 74.0, "start", "#777777", "largest error (exact: at the left edge)");
    put(PANELS[1][0], 74.0, "start", "#777777", "instructions of a call on ARMv7");
    for (i, row) in rows.iter().enumerate() {
        put(16.0, TOP + STEP * (i as f64 + 0.5) + 4.0, "start", "#222222", row.function.name);
    }
    for (panel, decades) in [(0, -9..=1), (1, 0..=4)] {
        for decade in decades {
            let x = place(panel, 10f64.powi(decade));
            put(x, bottom + 18.0, "middle", "#777777", &format!("1e{decade}"));
        }
    }
    for (i, row) in rows.iter().enumerate() {
        let y = TOP + STEP * (i as f64 + 0.5);
        for [left, right] in PANELS {
            let _ = writeln!(s, "<path d=\"M{left} {y}H{right}\" stroke=\"#e0e0e0\"/>");
        }
        for (way, colour) in COLOURS.iter().enumerate() {
            // The points of the implementations are offset so that none hides another.
            let y = y + 4.0 * (way as f64 - 1.5);
            let values = [Some(row.errors[way].max(1e-9)), row.counts[way].map(|n| n.max(1.0))];
            for (panel, v) in values.into_iter().enumerate() {
                if let Some(x) = v.map(|v| place(panel, v)) {
                    let _ = writeln!(s, "<circle cx=\"{x:.1}\" cy=\"{y}\" r=\"4\" fill=\"{colour}\"/>");
                }
            }
        }
    }
    s.push_str("</svg>\n");
    s
}

/// Returns the horizontal position, pixels, of a value in a panel: errors from 1e-9 to 10, instructions from 1 to 10,000.
fn place(panel: usize, value: f64) -> f64 {
    let [low, high] = [[-9.0, 1.0], [0.0, 4.0]][panel];
    let [left, right] = PANELS[panel];
    left + (right - left) * ((value.log10() - low) / (high - low)).clamp(0.0, 1.0)
}
