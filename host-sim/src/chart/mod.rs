//! `hemilux-sim chart`: charts of every method's error against its time, and of error and flicker against the number of lights.
//!
//! Every method decomposes every map with every number of lights, on one thread while no other thread of the program runs; the scores are
//! then computed on all cores. `volume` is left out, since it decomposes sequences and not single maps.

pub mod counted;
mod figure;
mod flicker;
mod measure;
#[cfg(test)]
mod tests;

pub use measure::{ChartMap, Timed};

use crate::contender::{self, Method, MethodKind, methods};
use crate::env::EnvMap;
use crate::error::SimError;
use crate::metrics::stability::parsimony;
use crate::metrics::{Domain, Score};
use crate::output;
use crate::progress;
use crate::scenario::stage;
use indicatif::ProgressBar;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Largest number of lights of a method's curve.
pub const MOST: usize = 1024;
/// Number of lights for which the instructions of a method are counted.
const COUNTED: usize = 64;

/// Arguments of `chart`.
#[derive(Clone, Debug)]
pub struct ChartJob {
    /// Path of a folder of maps; `None` for procedural maps.
    pub env: Option<PathBuf>,
    /// Path of the folder for `chart.json`, `chart.txt`, `chart-time.svg` and `chart-lights.svg`.
    pub out: PathBuf,
    /// Whether the chart has three small maps and every other power of two.
    pub quick: bool,
}

/// Figures of one method with one number of lights, over all maps of a chart. Errors are ratios.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Name of the method that the point is of.
    pub sampler: &'static str,
    /// Largest number of lights of a set.
    pub lights: usize,
    /// Median time per map, milliseconds: from the pyramid and the latitude-longitude map to lights for samplers of the core, from the texels to
    /// lights for other methods.
    pub sample_ms: f64,
    /// Open error of the method's sets, mean over the maps.
    pub open: Option<f64>,
    /// Shadowed error of the method's sets, mean over the maps.
    pub shadowed: Option<f64>,
    /// Open error of the method's sets with the lights read as discs, mean over the maps.
    pub soft_open: Option<f64>,
    /// Shadowed error of the method's sets with the lights read as discs, mean over the maps.
    pub soft_shadowed: Option<f64>,
    /// Shadowed error of the method's sets, largest over the maps.
    pub worst_shadowed: Option<f64>,
    /// Energy error of the method's sets, largest over the maps.
    pub energy: Option<f64>,
    /// Flicker of the method's sets, mean over scenarios; lights that are fitted as discs are read as discs. `None` if it was not measured.
    pub flicker: Option<f64>,
    /// Number of maps over which the means are computed.
    pub maps: usize,
    /// Time from a burst of three 640 x 480 frames to lights, milliseconds; `None` for methods outside of the core.
    pub burst_ms: Option<f64>,
    /// Instructions per map that callgrind counts, for samplers of the core with 64 lights; `None` otherwise, or without valgrind.
    pub instructions: Option<u64>,
}

impl Point {
    /// Returns whether the lights are fitted as discs.
    fn is_soft(&self) -> bool {
        self.sampler.ends_with("+soft")
    }

    /// Returns the open error that the chart shows: of discs if the lights are fitted as discs, else of points.
    fn drawn_open(&self) -> Option<f64> {
        if self.is_soft() { self.soft_open } else { self.open }
    }

    /// Returns the shadowed error that the chart shows: of discs if the lights are fitted as discs, else of points.
    fn drawn_shadowed(&self) -> Option<f64> {
        if self.is_soft() { self.soft_shadowed } else { self.shadowed }
    }
}

/// Measures all methods and writes the charts.
///
/// # Errors
/// [`SimError`] if a map cannot be read or a file cannot be written.
pub fn run(job: &ChartJob) -> Result<(), SimError> {
    let maps = load(job)?;
    std::fs::create_dir_all(&job.out)
        .map_err(|e| SimError::at(&job.out, e, "a folder that can be created"))?;
    let step = if job.quick { 4 } else { 2 };
    let repeats = if job.quick { 3 } else { 7 };
    let mut points = points(&maps, &methods(), step, repeats);
    measure::bursts(&maps[0], &mut points, repeats)?;
    flicker::add(&mut points, job.quick);
    if !job.quick {
        counted::add(&mut points, COUNTED);
    }
    let name = |file: &str| job.out.join(file);
    output::save(&name("chart.json"), json(&points).as_bytes())?;
    output::save(&name("chart.txt"), text(&points).as_bytes())?;
    output::save(&name("chart-time.svg"), figure::time(&points).as_bytes())?;
    output::save(&name("chart-lights.svg"), figure::lights(&points).as_bytes())?;
    let folder = job.out.display();
    eprintln!("hemilux-sim: wrote chart.json, chart.txt, chart-time.svg and chart-lights.svg to {folder}");
    Ok(())
}

/// Returns the maps of the folder, or procedural maps without a folder; wider maps are resampled to 512 columns. With `--quick` there are at most
/// three maps of 128 columns.
fn load(job: &ChartJob) -> Result<Vec<EnvMap>, SimError> {
    let width = if job.quick { 128 } else { 512 };
    let mut maps: Vec<EnvMap> = match &job.env {
        Some(folder) => contender::read_maps(folder, width)?.into_iter().map(|(_, map)| map).collect(),
        None => procedural(width.min(256)),
    };
    if job.quick {
        maps.truncate(3);
    }
    Ok(maps)
}

/// Returns three procedural maps of `width` columns: an interior, a sunny sky and a cloudy sky.
fn procedural(width: usize) -> Vec<EnvMap> {
    use crate::metrics::stability::LightSource;
    let paint = |radiance: fn([f64; 3]) -> [f32; 3]| EnvMap::from_fn(width, width / 2, radiance);
    let sun = LightSource { direction: stage::at(40.0, 100.0), radius_deg: 1.5 };
    let sky = paint(stage::sky);
    let sunny = stage::with_disc(&sky, sun, stage::DAYLIGHT, 5.0 * stage::energy(&sky));
    let cloudy = stage::repainted(&sky, |d, rgb| rgb.map(|v| v + 1.5 * stage::cloud(d, 0.0) as f32));
    vec![paint(stage::room), sunny, cloudy]
}

/// Returns the numbers of lights of a method's curve: the least number that the method supports, then every power of two (`step` 2) or every
/// other power of two from 16 on (`step` 4), at most [`MOST`].
#[must_use]
pub fn counts(method: &Method, step: usize) -> Vec<usize> {
    let least = method.least(Domain::Sphere);
    let powers = std::iter::successors(Some(if step == 4 { 16 } else { 1 }), |n| Some(n * step));
    let above = powers.take_while(|n| *n <= MOST).filter(|n| *n > least);
    std::iter::once(least).chain(above).collect()
}

/// Measures the core's samplers and the baselines of `methods` over all maps with the numbers of lights of [`counts`]; each time is the median of
/// `repeats` runs.
#[must_use]
pub fn points(maps: &[EnvMap], methods: &[Method], step: usize, repeats: usize) -> Vec<Point> {
    let maps: Vec<ChartMap> = progress::on_all_cores(maps.len(), |k| ChartMap::new(&maps[k]));
    let measured: Vec<&Method> =
        methods.iter().filter(|m| matches!(m.kind, MethodKind::Core | MethodKind::Baseline)).collect();
    let bar = progress::bar("chart", measured.iter().map(|m| counts(m, step).len() * maps.len()).sum());
    let mut points = Vec::new();
    for method in measured {
        let gathered = methods.iter().find(|m| m.kind == MethodKind::Gathered && m.base() == method.name);
        let mut after = Vec::new();
        for lights in counts(method, step) {
            bar.set_message(format!("{} {lights}", method.name));
            let [raw, with_v] = over_maps(&maps, method, lights, repeats, &bar);
            points.push(point(&maps, method.name, lights, &raw));
            after.extend(gathered.map(|method| point(&maps, method.name, lights, &with_v)));
        }
        points.extend(after);
    }
    bar.finish_and_clear();
    points
}

/// Measures a method on every map; returns its sets, and for baselines the sets after the Voronoi gather.
fn over_maps(
    maps: &[ChartMap],
    method: &Method,
    lights: usize,
    repeats: usize,
    bar: &ProgressBar,
) -> [Vec<Timed>; 2] {
    let (mut raw, mut gathered) = (Vec::new(), Vec::new());
    for map in maps {
        if method.kind == MethodKind::Core {
            raw.push(map.time_core(method, lights, repeats));
        } else {
            let [plain, with_v] = map.time_baseline(method.name, lights);
            raw.push(plain);
            gathered.push(with_v);
        }
        bar.inc(1);
    }
    [raw, gathered]
}

/// Scores the sets of a method over all maps and returns the means and maxima.
fn point(maps: &[ChartMap], sampler: &'static str, lights: usize, runs: &[Timed]) -> Point {
    let scores: Vec<Score> = progress::on_all_cores(runs.len(), |k| maps[k].score(&runs[k].set));
    let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len().max(1) as f64;
    let worst = |of: fn(&Score) -> f64| scores.iter().map(of).fold(0.0, f64::max);
    let finite = |v: f64| v.is_finite().then_some(v);
    Point {
        sampler,
        lights,
        sample_ms: measure::median(runs.iter().map(|run| run.ms).collect()),
        open: finite(mean(|s| s.open)),
        shadowed: finite(mean(|s| s.shadowed)),
        soft_open: finite(mean(|s| s.soft_open)),
        soft_shadowed: finite(mean(|s| s.soft_shadowed)),
        worst_shadowed: finite(worst(|s| s.shadowed)),
        energy: finite(worst(|s| s.energy)),
        flicker: None,
        maps: runs.len(),
        burst_ms: None,
        instructions: None,
    }
}

/// Returns the points as JSON: `{"points": [...]}`, one point per line.
#[must_use]
pub fn json(points: &[Point]) -> String {
    let lines: Vec<String> = points.iter().map(|point| serde_json::json!(point).to_string()).collect();
    format!("{{\"points\": [\n{}\n]}}\n", lines.join(",\n"))
}

/// Returns the least number of lights with which `sampler` has a shadowed error of at most `tolerance`, a ratio; lights that are fitted as discs
/// are read as discs.
#[must_use]
pub fn fewest(points: &[Point], sampler: &str, tolerance: f64) -> Option<usize> {
    let curve = points.iter().filter(|p| p.sampler == sampler);
    parsimony(&curve.filter_map(|p| Some((p.lights, p.drawn_shadowed()?))).collect::<Vec<_>>(), tolerance)
}

/// Returns the points of the chart as a text table.
fn text(points: &[Point]) -> String {
    let mut out = format!(
        "{:<18}{:>7}{:>11}{:>9}{:>11}{:>9}{:>11}{:>11}{:>11}{:>11}{:>11}{:>14}\n",
        "sampler",
        "lights",
        "sample ms",
        "open %",
        "shadowed %",
        "worst %",
        "soft o. %",
        "soft s. %",
        "energy",
        "flicker %",
        "burst ms",
        "instructions"
    );
    for p in points {
        let percent = |v: Option<f64>| v.map_or("-".into(), |v| format!("{:.3}", 100.0 * v));
        let energy = p.energy.map_or("-".into(), |v| format!("{v:.1e}"));
        let burst = p.burst_ms.map_or("-".into(), |v| format!("{v:.3}"));
        let instructions = p.instructions.map_or("-".into(), |v| v.to_string());
        let _ = writeln!(
            out,
            "{:<18}{:>7}{:>11.4}{:>9}{:>11}{:>9}{:>11}{:>11}{energy:>11}{:>11}{burst:>11}{instructions:>14}",
            p.sampler,
            p.lights,
            p.sample_ms,
            percent(p.open),
            percent(p.shadowed),
            percent(p.worst_shadowed),
            percent(p.soft_open),
            percent(p.soft_shadowed),
            percent(p.flicker)
        );
    }
    out
}
