//! Drawing of the charts: curves over the number of lights, logarithmic axes, Pareto fronts.

use super::{Point, fewest};
use crate::contender::{Method, MethodKind, methods};
use crate::draw::{BLUE, Canvas, GREEN, GREY, INK, LogAxis, ORANGE, PALE, PURPLE, SKY, VERMILLION, plain};
use plotters::style::RGBColor;
use plotters::style::text_anchor::HPos;

/// Colours of the methods' curves, in rotation.
const PALETTE: [RGBColor; 7] = [VERMILLION, BLUE, GREEN, PURPLE, ORANGE, SKY, INK];
/// Colour of the Pareto front in the charts.
const FRONT: RGBColor = RGBColor(255, 226, 130);
/// Width and height of the plot of a chart's panel, pixels.
const PANEL: [f64; 2] = [420.0, 420.0];
/// Width of the labels left of a plot, pixels.
const LEFT: f64 = 64.0;
/// Height of the title and the labels above a plot, pixels.
const TOP: f64 = 96.0;
/// Height of the labels below the plot of a panel, pixels.
const FOOT: f64 = 60.0;
/// Width of a chart's legend, pixels.
const LEGEND: f64 = 210.0;
/// Number of lights whose points are drawn larger in the charts.
const MARKED: usize = 64;

/// One panel of a chart: a quantity on each axis, and the labels of the axes.
#[derive(Clone, Copy)]
struct Panel<'a> {
    title: &'a str,
    x_label: &'a str,
    y_label: &'a str,
    x: fn(&Point) -> Option<f64>,
    y: fn(&Point) -> Option<f64>,
    /// Whether the least numbers of lights that reach 5 and 2 per cent are marked.
    parsimony: bool,
}

fn percent(v: Option<f64>) -> Option<f64> {
    v.map(|v| 100.0 * v).filter(|v| *v > 0.0)
}

/// Returns the SVG text of a chart of error against time: sampling alone with both errors, and burst to lights with the shadowed error.
pub(super) fn time(points: &[Point]) -> String {
    let shadowed = Panel {
        title: "Sampling alone: shadowed receivers",
        x_label: "time per map, ms (one thread)",
        y_label: "shadowed error, % of mean irradiance",
        x: |p| Some(p.sample_ms),
        y: |p| percent(p.drawn_shadowed()),
        parsimony: false,
    };
    let open = Panel {
        title: "Sampling alone: open receivers",
        y_label: "open error, % of mean irradiance",
        y: |p| percent(p.drawn_open()),
        ..shadowed
    };
    let burst = Panel {
        title: "Burst of three 640 x 480 frames to lights",
        x_label: "time per burst, ms (one thread)",
        x: |p| p.burst_ms,
        ..shadowed
    };
    let panels = [open, shadowed, burst];
    page("Speed against accuracy: each curve runs over the number of lights", points, &panels)
}

/// Returns the SVG text of a chart of error and flicker against the number of lights; the least numbers with an error of 5 and 2 per cent are
/// marked.
pub(super) fn lights(points: &[Point]) -> String {
    let open = Panel {
        title: "Open receivers",
        x_label: "lights",
        y_label: "open error, % of mean irradiance",
        x: |p| Some(p.lights as f64),
        y: |p| percent(p.drawn_open()),
        parsimony: false,
    };
    let shadowed = Panel {
        title: "Shadowed receivers; crosses: fewest lights for 5 % and 2 %",
        y_label: "shadowed error, % of mean irradiance",
        y: |p| percent(p.drawn_shadowed()),
        parsimony: true,
        ..open
    };
    let flicker = Panel {
        title: "Flicker by number of lights",
        y_label: "mean over bulb, walker, clouds, seam, switch; % of mean irradiance",
        y: |p| percent(p.flicker),
        ..open
    };
    let panels = [open, shadowed, flicker];
    page("How many lights does it take?", points, &panels)
}

fn page(title: &str, points: &[Point], panels: &[Panel<'_>]) -> String {
    let width = (LEFT + PANEL[0]) * panels.len() as f64 + LEGEND + 24.0;
    let mut buffer = String::new();
    let canvas = Canvas::new(&mut buffer, (width as u32, (TOP + PANEL[1] + FOOT) as u32));
    canvas.text(title, [16.0, 26.0], HPos::Left, 22, INK);
    let maps = points.first().map_or(0, |p| p.maps);
    let note = format!(
        "Mean of {maps} maps; lower and further left is better. Yellow: the Pareto front. Large dots: {MARKED} lights. Lights of \
         +soft are drawn as discs, the others as points."
    );
    canvas.text(&note, [16.0, 52.0], HPos::Left, 13, GREY);
    for (k, panel) in panels.iter().enumerate() {
        let left = LEFT + (LEFT + PANEL[0]) * k as f64;
        draw_panel(&canvas, left, panel, points);
    }
    legend(&canvas, (LEFT + PANEL[0]) * panels.len() as f64 + 24.0, points);
    canvas.finish();
    buffer
}

fn draw_panel(canvas: &Canvas<'_>, left: f64, panel: &Panel<'_>, points: &[Point]) {
    let drawn: Vec<(&Point, [f64; 2])> =
        points.iter().filter_map(|p| Some((p, [(panel.x)(p)?, (panel.y)(p)?]))).collect();
    let x = LogAxis::round(drawn.iter().map(|d| d.1[0]), [left, left + PANEL[0]]);
    let y = LogAxis::round(drawn.iter().map(|d| d.1[1]), [TOP + PANEL[1], TOP]);
    axes(canvas, panel, &x, &y);
    let at = |[a, b]: [f64; 2]| [x.at(a), y.at(b)];
    let front: Vec<[f64; 2]> = pareto(drawn.iter().map(|d| d.1).collect()).into_iter().map(at).collect();
    canvas.line(&front, FRONT, 9);
    if panel.parsimony {
        for tolerance in [5.0, 2.0] {
            let level = y.at(tolerance);
            canvas.line(&[[left, level], [left + PANEL[0], level]], GREY, 1);
            canvas.text(
                &format!("{tolerance} %"),
                [left + PANEL[0] - 4.0, level - 8.0],
                HPos::Right,
                11,
                GREY,
            );
        }
    }
    for method in methods() {
        let style = LineStyle::of(&method);
        let curve: Vec<(usize, [f64; 2])> = drawn
            .iter()
            .filter(|(p, _)| p.sampler == method.name)
            .map(|(p, value)| (p.lights, at(*value)))
            .collect();
        style.curve(canvas, &curve);
        if panel.parsimony {
            for tolerance in [0.05, 0.02] {
                let Some(lights) = fewest(points, method.name, tolerance) else { continue };
                let reached = curve.iter().filter(|(n, _)| *n == lights);
                reached.for_each(|(_, at)| canvas.cross(*at, 6.0, style.colour));
            }
        }
    }
}

fn axes(canvas: &Canvas<'_>, panel: &Panel<'_>, x: &LogAxis, y: &LogAxis) {
    let ([left, right], [bottom, top]) = (x.pixels, y.pixels);
    for v in x.ticks() {
        canvas.line(&[[x.at(v), top], [x.at(v), bottom]], PALE, 1);
        canvas.text(&plain(v), [x.at(v), bottom + 12.0], HPos::Center, 11, INK);
    }
    for v in y.ticks() {
        canvas.line(&[[left, y.at(v)], [right, y.at(v)]], PALE, 1);
        canvas.text(&plain(v), [left - 6.0, y.at(v)], HPos::Right, 11, INK);
    }
    canvas.line(&[[left, top], [left, bottom], [right, bottom]], INK, 1);
    canvas.text(panel.title, [left, top - 24.0], HPos::Left, 15, INK);
    canvas.text(panel.y_label, [left, top - 8.0], HPos::Left, 11, GREY);
    canvas.text(panel.x_label, [(left + right) / 2.0, bottom + 32.0], HPos::Center, 12, INK);
}

/// Returns the Pareto front from left to right: the points to which no other point is superior in both values.
fn pareto(mut values: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    values.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut least = f64::INFINITY;
    values.retain(|v| {
        let better = v[1] < least;
        least = least.min(v[1]);
        better
    });
    values
}

/// Line and marker style of a method: thick lines with filled markers for samplers of the core, thin lines with hollow markers for methods of
/// the literature, dashes for variants, black for discs.
struct LineStyle {
    colour: RGBColor,
    kind: MethodKind,
    dashed: bool,
}

impl LineStyle {
    fn of(method: &Method) -> Self {
        let core = |m: &&Method| (m.kind == MethodKind::Core) == (method.kind == MethodKind::Core);
        let all = methods();
        let mut bases: Vec<&str> = all.iter().filter(core).map(Method::base).collect();
        bases.dedup();
        let index = bases.iter().position(|name| *name == method.base()).unwrap_or(0);
        let dashed = method.name.split('+').skip(1).any(|variant| variant != "soft");
        let colour = if method.is_soft() { INK } else { PALETTE[index % PALETTE.len()] };
        Self { colour, kind: method.kind, dashed }
    }

    /// Draws a curve through points, each with its number of lights and its position in pixels.
    fn curve(&self, canvas: &Canvas<'_>, points: &[(usize, [f64; 2])]) {
        let line: Vec<[f64; 2]> = points.iter().map(|(_, at)| *at).collect();
        let width = if self.kind == MethodKind::Core { 3 } else { 1 };
        if self.dashed {
            canvas.dashes(&line, self.colour, width);
        } else {
            canvas.line(&line, self.colour, width);
        }
        for (lights, at) in points {
            let radius = if *lights == MARKED { 5 } else { 2 };
            canvas.dot(*at, radius, self.colour, self.kind != MethodKind::Core);
        }
    }
}

fn legend(canvas: &Canvas<'_>, left: f64, points: &[Point]) {
    canvas.text("fewest lights for 5 %, 2 %", [left + LEGEND - 16.0, TOP - 14.0], HPos::Right, 10, GREY);
    let drawn = methods().into_iter().filter(|m| points.iter().any(|p| p.sampler == m.name));
    for (k, method) in drawn.enumerate() {
        let y = TOP + 10.0 + 19.0 * k as f64;
        let style = LineStyle::of(&method);
        style.curve(canvas, &[(0, [left, y]), (0, [left + 28.0, y])]);
        canvas.text(method.name, [left + 36.0, y], HPos::Left, 12, INK);
        let few = |tolerance| fewest(points, method.name, tolerance).map_or("–".into(), |n| n.to_string());
        let both = format!("{}, {}", few(0.05), few(0.02));
        canvas.text(&both, [left + LEGEND - 16.0, y], HPos::Right, 11, GREY);
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn pareto_front_has_exactly_the_points_without_a_superior_one() {
        let values = vec![[3.0, 1.0], [1.0, 3.0], [2.0, 2.0], [2.5, 2.5], [4.0, 1.0], [1.0, 4.0]];
        assert_eq!(super::pareto(values), [[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]);
    }
}
