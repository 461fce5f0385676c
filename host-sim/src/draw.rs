//! Primitives of the SVG charts: a palette that colour-blind readers can distinguish, shapes, text, logarithmic axes.

use plotters::backend::SVGBackend;
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::{Circle, DrawingArea, IntoFont, PathElement, RGBColor, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, ShapeStyle};

/// Blue of the palette of Okabe and Ito.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Vermillion of the palette of Okabe and Ito.
pub const VERMILLION: RGBColor = RGBColor(213, 94, 0);
/// Bluish green of the palette of Okabe and Ito.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// Reddish purple of the palette of Okabe and Ito.
pub const PURPLE: RGBColor = RGBColor(204, 121, 167);
/// Orange of the palette of Okabe and Ito.
pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
/// Sky blue of the palette of Okabe and Ito.
pub const SKY: RGBColor = RGBColor(86, 180, 233);
/// Colour of text and axes.
pub const INK: RGBColor = RGBColor(34, 34, 34);
/// Colour of less important text.
pub const GREY: RGBColor = RGBColor(120, 120, 120);
/// Colour of grid lines.
pub const PALE: RGBColor = RGBColor(224, 224, 224);

/// An SVG drawing in memory, whose backend cannot fail.
pub struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

impl<'a> Canvas<'a> {
    /// Creates a white page of `size` pixels (width, height), whose SVG text is written to `buffer`.
    pub fn new(buffer: &'a mut String, size: (u32, u32)) -> Self {
        let canvas = Self {
            area: plotters::prelude::IntoDrawingArea::into_drawing_area(SVGBackend::with_string(
                buffer, size,
            )),
        };
        let (w, h) = (f64::from(size.0), f64::from(size.1));
        canvas.rect([0.0, 0.0], [w, h], RGBColor(255, 255, 255));
        canvas
    }

    /// Draws a filled rectangle with the opposite corners `a` and `b`, pixels.
    pub fn rect(&self, a: [f64; 2], b: [f64; 2], colour: RGBColor) {
        let _ = self.area.draw(&Rectangle::new([pixel(a), pixel(b)], colour.filled()));
    }

    /// Draws a line of `width` pixels through points.
    pub fn line(&self, points: &[[f64; 2]], colour: RGBColor, width: u32) {
        let points: Vec<_> = points.iter().copied().map(pixel).collect();
        let _ = self.area.draw(&PathElement::new(points, colour.stroke_width(width)));
    }

    /// Draws a dashed line of `width` pixels through points.
    pub fn dashes(&self, points: &[[f64; 2]], colour: RGBColor, width: u32) {
        for pair in points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let length = f64::hypot(b[0] - a[0], b[1] - a[1]);
            let at = |s: f64| [0, 1].map(|i| a[i] + (b[i] - a[i]) * (s / length).min(1.0));
            let mut s = 0.0;
            while s < length {
                self.line(&[at(s), at(s + 4.0)], colour, width);
                s += 7.0;
            }
        }
    }

    /// Draws a filled disc of `radius` pixels; with `hole`, a ring of `radius` pixels.
    pub fn dot(&self, at: [f64; 2], radius: i32, colour: RGBColor, hole: bool) {
        let style = if hole { ShapeStyle::from(&colour).stroke_width(2) } else { colour.filled() };
        let _ = self.area.draw(&Circle::new(pixel(at), radius, style));
    }

    /// Draws a filled square with half sides of `half` pixels.
    pub fn square(&self, [x, y]: [f64; 2], half: f64, colour: RGBColor) {
        self.rect([x - half, y - half], [x + half, y + half], colour);
    }

    /// Draws a diagonal cross in a square with half sides of `half` pixels.
    pub fn cross(&self, [x, y]: [f64; 2], half: f64, colour: RGBColor) {
        self.line(&[[x - half, y - half], [x + half, y + half]], colour, 2);
        self.line(&[[x - half, y + half], [x + half, y - half]], colour, 2);
    }

    /// Draws text of `size` pixels, vertically centred at `at`; `side` is the part of the text that is placed at `at`: left end, centre or right end.
    pub fn text(&self, text: &str, at: [f64; 2], side: HPos, size: i32, colour: RGBColor) {
        // A pixel is 1.24 units of text size of the `plotters` crate.
        let size = f64::from(size) * 1.24;
        let style = ("sans-serif", size).into_font().color(&colour).pos(Pos::new(side, VPos::Center));
        let _ = self.area.draw(&Text::new(text.to_string(), pixel(at), style));
    }

    /// Writes the end of the SVG text.
    pub fn finish(self) {
        let _ = self.area.present();
    }
}

/// Rounds a position to the nearest pixel, in the type of the `plotters` crate.
fn pixel([x, y]: [f64; 2]) -> <Shift as CoordTranslate>::From {
    (x.round() as i32, y.round() as i32)
}

/// A logarithmic axis of a chart, which maps values to pixels.
#[derive(Clone, Copy, Debug)]
pub struct LogAxis {
    /// Values at the two ends of the axis.
    pub values: [f64; 2],
    /// Pixels at the two ends of the axis.
    pub pixels: [f64; 2],
}

impl LogAxis {
    /// Returns the position of `value` in pixels; a value outside of the axis has the position of the nearest end.
    #[must_use]
    pub fn at(&self, value: f64) -> f64 {
        let [low, high] = self.values;
        let part = (value.clamp(low, high) / low).ln() / (high / low).ln();
        self.pixels[0] + part * (self.pixels[1] - self.pixels[0])
    }

    /// Returns the tick values of the axis: powers of ten, and if the ends have a ratio below 60 also their multiples by two and five.
    #[must_use]
    pub fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.values;
        let steps: &[f64] = if high / low < 60.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let from = low.log10().floor() as i32;
        let all = (from..from + 20).flat_map(|k| steps.iter().map(move |s| s * 10f64.powi(k)));
        all.filter(|v| (low * 0.999..=high * 1.001).contains(v)).collect()
    }

    /// Returns an axis with round ends that contains all of `values`.
    #[must_use]
    pub fn round(values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Self {
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for v in values.filter(|v| *v > 0.0 && v.is_finite()) {
            (low, high) = (low.min(v), high.max(v));
        }
        if high == 0.0 {
            return Self { values: [0.1, 10.0], pixels };
        }
        let down = |v: f64| {
            let power = 10f64.powf(v.log10().floor());
            let step = [5.0, 2.0, 1.0].into_iter().find(|s| s * power <= v * 1.001);
            power * step.unwrap_or(1.0)
        };
        // Rounding 1 / v down rounds v up.
        let (low, high) = (down(low), 1.0 / down(1.0 / high));
        Self { values: [low, high.max(5.0 * low)], pixels }
    }
}

/// Formats a number with at most six decimals, without trailing zeros or exponent.
#[must_use]
pub fn plain(v: f64) -> String {
    format!("{}", (v * 1e6).round() / 1e6)
}
