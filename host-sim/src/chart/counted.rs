//! Counts of the instructions per frame of a sampler or of the pipeline, from runs of this program under callgrind; unlike times, the counts are
//! repeatable.

use super::Point;
use crate::bench::Case;
use crate::error::SimError;
use crate::maps::Maps;
use crate::metrics::Domain;
use crate::scenario::stage;
use hemilux::samplers::{self, Shape};
use hemilux_core::SamplerKind;
use hemilux_core::polar::Grid;
use hemilux_core::sampler::Request;
use std::process::Command;

/// Numbers of frames of the two runs under callgrind; the difference between the two counts belongs to the additional frames.
const FRAMES: [usize; 2] = [2, 10];
/// Grid of the latitude-longitude map that the sampler `pharr` reads.
const GRID: Grid = Grid { width: 256, height: 128, domain: Domain::Sphere };

/// Updates a sampler with a procedural map `frames` times without output, so that callgrind counts the sampler alone.
///
/// # Errors
/// [`SimError`] for a number of lights that the sampler does not support.
pub fn sample_frames(sampler: SamplerKind, lights: usize, frames: usize) -> Result<(), SimError> {
    let shape = Shape { domain: Domain::Sphere, order: samplers::order_for(lights), grid: GRID };
    let mut sampler = samplers::make(sampler, &shape, lights)?;
    let mut maps = Maps::new(shape.domain, shape.order, shape.grid);
    maps.fill_at_centres(stage::room);
    for _ in 0..frames {
        std::hint::black_box(sampler.update(&maps.view(), &Request::of_lights(lights)));
    }
    Ok(())
}

/// Sets the instructions per frame of the points of core samplers with `lights` lights, if valgrind is installed.
pub(super) fn add(points: &mut [Point], lights: usize) {
    for point in points.iter_mut().filter(|p| SamplerKind::NAMES.contains(&p.sampler) && p.lights == lights) {
        let run = |frames| count(point.sampler, lights, frames);
        let [few, many] = FRAMES.map(run);
        point.instructions = few.zip(many).map(|(a, b)| b.saturating_sub(a) / (FRAMES[1] - FRAMES[0]) as u64);
    }
}

/// Returns the instructions per frame of a case of `bench`; `None` without valgrind.
#[must_use]
pub fn of_bench(case: &Case) -> Option<u64> {
    let run = |frames: usize| {
        under_callgrind(&["bench", "--case", &case.to_string(), "--frames", &frames.to_string()])
    };
    let [few, many] = FRAMES.map(run);
    few.zip(many).map(|(a, b)| b.saturating_sub(a) / (FRAMES[1] - FRAMES[0]) as u64)
}

/// Returns the instructions of a run of `sample-frames`; `None` if callgrind is not installed or its output has no count.
fn count(sampler: &str, lights: usize, frames: usize) -> Option<u64> {
    let (lights, frames) = (lights.to_string(), frames.to_string());
    under_callgrind(&["sample-frames", "--sampler", sampler, "--lights", &lights, "--frames", &frames])
}

/// Runs this program with `arguments` under callgrind and returns the number of instructions.
fn under_callgrind(arguments: &[&str]) -> Option<u64> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe().ok()?)
        .args(arguments)
        .output()
        .ok()?;
    let report = String::from_utf8_lossy(&output.stderr);
    let (_, collected) = report.split_once("Collected :")?;
    collected.split_whitespace().next()?.parse().ok()
}
