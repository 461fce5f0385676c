//! `hemilux-sim discs`: lights as discs beside points and beside fitted mixtures of spherical Gaussians, over real maps.
//!
//! Two tables: the fewest lights of `adaptive` for a shadowed error, of each map; and the errors and times of discs and of as many lobes
//! of [`baseline::sg_mixture`]. Sets of points are scored as points, sets of discs as discs, mixtures as lobes. Each set is a sampler's
//! first: nothing is known of the map.

use crate::baseline;
use crate::contender::{self, Kind, Method, judged};
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

/// Shadowed errors for which the fewest lights are found.
pub const TOLERANCES: [f64; 2] = [0.03, 0.02];

/// Ways to ask `adaptive`.
pub const ASKED: [&str; 4] = ["adaptive", "adaptive+soft", "adaptive+sh", "adaptive+sh+soft"];

/// Numbers of lobes and of discs that are compared.
pub const COMPARED: [usize; 4] = [4, 8, 16, 64];

/// Most lights that are tried.
const MOST: usize = 256;

/// Columns to which maps are shrunk, as in `chart`.
const WIDTH: usize = 512;

/// Runs of a sampler whose shortest time counts.
const RUNS: usize = 5;

/// Arguments of `discs`.
#[derive(Clone, Debug)]
pub struct DiscsJob {
    /// Folder of maps.
    pub env: PathBuf,
    /// Leaves the mixtures out.
    pub fewest_alone: bool,
}

/// A map with what it is scored by.
pub struct Ground {
    env: EnvMap,
    maps: OrderedMaps,
    reference: Reference,
}

/// Errors, ratios, and time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measured {
    /// Open error.
    pub open: f64,
    /// Shadowed error.
    pub shadowed: f64,
    /// Time, milliseconds.
    pub ms: f64,
}

/// Prints the tables.
///
/// # Errors
/// [`SimError`] for a folder or a map that cannot be read.
pub fn run(job: &DiscsJob) -> Result<(), SimError> {
    let maps = contender::read_maps(&job.env, WIDTH)?;
    let grounds: Vec<Ground> = maps.iter().map(|(_, env)| Ground::new(env)).collect();
    let mut text = String::new();
    let names: Vec<&str> = maps.iter().map(|(name, _)| name.as_str()).collect();
    write_fewest(&mut text, &names, &grounds);
    if !job.fewest_alone {
        write_mixtures(&mut text, &grounds);
    }
    output::say(text.as_bytes())
}

impl Ground {
    /// Prepares a map.
    #[must_use]
    pub fn new(env: &EnvMap) -> Self {
        let mut maps = OrderedMaps::new(env, Domain::Sphere, &[1, MOST]);
        maps.fill(env);
        Self { env: env.clone(), maps, reference: Reference::new(env, Domain::Sphere) }
    }

    /// The first set of a sampler, and the time that it took, milliseconds.
    fn first(&self, method: &Method, lights: usize) -> (LitSet, f64) {
        let (shape, view) = self.maps.of(lights);
        let mut sampler =
            samplers::make(method.sampler(), shape, lights).expect("a name from the samplers' own list");
        let began = Instant::now();
        let made = sampler.update(&view, &method.request(lights));
        (judged(&made), 1e3 * began.elapsed().as_secs_f64())
    }

    /// Errors of a sampler's first set, and its shortest time.
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

    /// Errors and time of a mixture.
    #[must_use]
    pub fn measure_mixture(&self, lobes: usize) -> Measured {
        let began = Instant::now();
        let lobes = baseline::sg_mixture(&self.env, Domain::Sphere, lobes);
        let ms = 1e3 * began.elapsed().as_secs_f64();
        let points: Vec<_> = lobes.iter().flat_map(baseline::Lobe::points).collect();
        let [open, shadowed] = self.reference.errors_of_points(points.iter().copied());
        Measured { open, shadowed, ms }
    }

    /// The fewest lights that reach each of [`TOLERANCES`], which descend; at most `MOST`.
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

/// A way to ask `adaptive`.
#[must_use]
pub fn asked(name: &'static str) -> Method {
    Method { name, kind: Kind::Core }
}

fn write_fewest(out: &mut String, names: &[&str], grounds: &[Ground]) {
    let found = progress::on_all_cores(grounds.len(), |k| ASKED.map(|name| grounds[k].fewest(&asked(name))));
    let _ = writeln!(out, "Fewest lights for a shadowed error of 3 % and of 2 %\n");
    let _ = writeln!(out, "{:<16}{}", "map", ASKED.map(|name| format!("{name:>20}")).concat());
    for (name, row) in names.iter().zip(&found) {
        let cells = row.map(|[a, b]| format!("{:>20}", format!("{a} / {b}")));
        let _ = writeln!(out, "{name:<16}{}", cells.concat());
    }
    let mean = |asked: usize, tolerance: usize| {
        found.iter().map(|row| row[asked][tolerance] as f64).sum::<f64>() / found.len().max(1) as f64
    };
    let means: Vec<String> = (0..ASKED.len())
        .map(|i| format!("{:>20}", format!("{:.1} / {:.1}", mean(i, 0), mean(i, 1))))
        .collect();
    let _ = writeln!(out, "{:<16}{}", "mean", means.concat());
}

fn write_mixtures(out: &mut String, grounds: &[Ground]) {
    let _ = writeln!(out, "\nMean open and shadowed error, per cent, and time of a map, milliseconds\n");
    let _ = writeln!(
        out,
        "{:>6}{:>30}{:>30}{:>10}{:>10}",
        "lights", "sg-mixture", "adaptive+soft", "error", "time"
    );
    for lights in COMPARED {
        let lobes: Vec<Measured> =
            progress::on_all_cores(grounds.len(), |k| grounds[k].measure_mixture(lights));
        let discs: Vec<Measured> =
            grounds.iter().map(|ground| ground.measure(&asked("adaptive+soft"), lights)).collect();
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

/// The mean of each figure.
#[must_use]
pub fn mean(all: &[Measured]) -> Measured {
    let over = |of: fn(&Measured) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
    Measured { open: over(|m| m.open), shadowed: over(|m| m.shadowed), ms: over(|m| m.ms) }
}
