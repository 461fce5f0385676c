//! `hemilux-sim discs`: comparison of lights with disc shape with point lights and with fitted mixtures of spherical Gaussians, over real maps.
//!
//! The first table contains, for each map, the least number of lights with which `adaptive` reaches a shadowed error; the second contains errors
//! and times of discs and of as many lobes of [`baseline::sg_mixture`]. Sets of points are scored as points, sets of discs as discs, mixtures as
//! lobes. Each set is the first of a new sampler, without state of earlier maps.

use crate::baseline;
use crate::contender::{self, Method, MethodKind, judged};
use crate::env::EnvMap;
use crate::error::SimError;
use crate::maps::OrderedMaps;
use crate::metrics::{Domain, LitSet, Reading, Reference};
use crate::output;
use crate::progress;
use hemilux::samplers;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

/// Shadowed errors, as ratios, for which [`DiscMap::fewest`] searches the least number of lights; descending.
pub const TOLERANCES: [f64; 2] = [0.03, 0.02];

/// Names of the variants of `adaptive` in the first table: points or discs, without or with ambient light.
pub const VARIANTS: [&str; 4] = ["adaptive", "adaptive+soft", "adaptive+sh", "adaptive+sh+soft"];

/// Numbers of discs, and of lobes of a mixture, in the second table.
pub const COMPARED: [usize; 4] = [4, 8, 16, 64];

/// Largest number of lights that [`DiscMap::fewest`] tries.
const MOST: usize = 256;

/// Number of columns to which wider maps are resampled for the comparison.
const WIDTH: usize = 512;

/// Number of timed runs of a sampler, of which the shortest time is reported.
const RUNS: usize = 5;

/// Arguments of `discs`.
#[derive(Clone, Debug)]
pub struct DiscsJob {
    /// Folder of the environment maps.
    pub env: PathBuf,
    /// Whether the table of mixtures is left out.
    pub fewest_alone: bool,
}

/// An environment map with the inputs of samplers and the reference integrals of the scores.
pub struct DiscMap {
    env: EnvMap,
    maps: OrderedMaps,
    reference: Reference,
}

/// Errors and time of one method with one number of lights on one map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measured {
    /// Open error of the set, a ratio.
    pub open: f64,
    /// Shadowed error of the set, a ratio.
    pub shadowed: f64,
    /// Time of one decomposition into the lights, milliseconds.
    pub ms: f64,
}

/// Writes the tables of the command to standard output.
///
/// # Errors
/// [`SimError`] with the path of the folder or of the map that cannot be read.
pub fn run(job: &DiscsJob) -> Result<(), SimError> {
    let maps = contender::read_maps(&job.env, WIDTH)?;
    let disc_maps: Vec<DiscMap> = maps.iter().map(|(_, env)| DiscMap::new(env)).collect();
    let mut text = String::new();
    let names: Vec<&str> = maps.iter().map(|(name, _)| name.as_str()).collect();
    write_fewest(&mut text, &names, &disc_maps);
    if !job.fewest_alone {
        write_mixtures(&mut text, &disc_maps);
    }
    output::say(text.as_bytes())
}

impl DiscMap {
    /// Computes the inputs of samplers and the reference integrals of `env`.
    #[must_use]
    pub fn new(env: &EnvMap) -> Self {
        let mut maps = OrderedMaps::new(env, Domain::Sphere, &[1, MOST]);
        maps.fill(env);
        Self { env: env.clone(), maps, reference: Reference::new(env, Domain::Sphere) }
    }

    /// Returns the first set of a new sampler, and its time in milliseconds.
    fn first(&self, method: &Method, lights: usize) -> (LitSet, f64) {
        let (shape, view) = self.maps.of(lights);
        let mut sampler =
            samplers::make(method.sampler(), shape, lights).expect("the method is a sampler of the core");
        let began = Instant::now();
        let made = sampler.update(&view, &method.request(lights));
        (judged(&made), 1e3 * began.elapsed().as_secs_f64())
    }

    /// Returns the errors of a sampler's first set, and the shortest time of five runs.
    #[must_use]
    pub fn measure(&self, method: &Method, lights: usize) -> Measured {
        let (set, _) = self.first(method, lights);
        let ms = (0..RUNS).map(|_| self.first(method, lights).1).fold(f64::INFINITY, f64::min);
        let score = self.reference.score(&set);
        let (open, shadowed) = if method.is_soft() {
            (score.soft_open, score.soft_shadowed)
        } else {
            (score.open, score.shadowed)
        };
        Measured { open, shadowed, ms }
    }

    /// Returns the errors and the time of a fitted mixture of `lobes` spherical Gaussians.
    #[must_use]
    pub fn measure_mixture(&self, lobes: usize) -> Measured {
        let began = Instant::now();
        let lobes = baseline::sg_mixture(&self.env, Domain::Sphere, lobes);
        let ms = 1e3 * began.elapsed().as_secs_f64();
        let points: Vec<_> = lobes.iter().flat_map(baseline::Lobe::points).collect();
        let [open, shadowed] = self.reference.errors_of_points(points.iter().copied());
        Measured { open, shadowed, ms }
    }

    /// Returns the least number of lights whose shadowed error is at most each of [`TOLERANCES`]; 256 if no smaller number suffices.
    #[must_use]
    pub fn fewest(&self, method: &Method) -> [usize; TOLERANCES.len()] {
        let reading = if method.is_soft() { Reading::Discs } else { Reading::Points };
        let error = |lights| self.reference.shadowed_error(&self.first(method, lights).0, reading);
        let mut lights = usize::from(!method.request(0).ambient);
        TOLERANCES.map(|tolerance| {
            while lights < MOST && error(lights) > tolerance {
                lights += 1;
            }
            lights
        })
    }
}

/// Returns the method of the core with the name `name`, such as one of [`VARIANTS`].
#[must_use]
pub fn variant(name: &'static str) -> Method {
    Method { name, kind: MethodKind::Core }
}

fn write_fewest(out: &mut String, names: &[&str], maps: &[DiscMap]) {
    let found = progress::on_all_cores(maps.len(), |k| VARIANTS.map(|name| maps[k].fewest(&variant(name))));
    let _ = writeln!(out, "Fewest lights for a shadowed error of 3 % and of 2 %\n");
    let _ = writeln!(out, "{:<16}{}", "map", VARIANTS.map(|name| format!("{name:>20}")).concat());
    for (name, row) in names.iter().zip(&found) {
        let cells = row.map(|[a, b]| format!("{:>20}", format!("{a} / {b}")));
        let _ = writeln!(out, "{name:<16}{}", cells.concat());
    }
    let mean = |variant: usize, tolerance: usize| {
        found.iter().map(|row| row[variant][tolerance] as f64).sum::<f64>() / found.len().max(1) as f64
    };
    let means: Vec<String> = (0..VARIANTS.len())
        .map(|i| format!("{:>20}", format!("{:.1} / {:.1}", mean(i, 0), mean(i, 1))))
        .collect();
    let _ = writeln!(out, "{:<16}{}", "mean", means.concat());
}

fn write_mixtures(out: &mut String, maps: &[DiscMap]) {
    let _ = writeln!(out, "\nMean open and shadowed error, per cent, and time of a map, milliseconds\n");
    let _ = writeln!(
        out,
        "{:>6}{:>30}{:>30}{:>10}{:>10}",
        "lights", "sg-mixture", "adaptive+soft", "error", "time"
    );
    for lights in COMPARED {
        let lobes: Vec<Measured> = progress::on_all_cores(maps.len(), |k| maps[k].measure_mixture(lights));
        let discs: Vec<Measured> =
            maps.iter().map(|map| map.measure(&variant("adaptive+soft"), lights)).collect();
        let (lobes, discs) = (mean(&lobes), mean(&discs));
        let cell =
            |m: Measured| format!("{:>9.3} /{:>7.3} {:>9.3} ms", 100.0 * m.open, 100.0 * m.shadowed, m.ms);
        let _ = writeln!(
            out,
            "{lights:>6}{:>30}{:>30}{:>9.2}x{:>10.1e}",
            cell(lobes),
            cell(discs),
            discs.shadowed / lobes.shadowed,
            discs.ms / lobes.ms
        );
    }
}

/// Returns the means of the errors and of the times in `all`; 0 for an empty list.
#[must_use]
pub fn mean(all: &[Measured]) -> Measured {
    let over = |of: fn(&Measured) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
    Measured { open: over(|m| m.open), shadowed: over(|m| m.shadowed), ms: over(|m| m.ms) }
}
