//! Counts the instructions of one frame's sampling by running this program under callgrind; unlike times, the counts are repeatable.

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

/// Numbers of frames of the two runs; the difference of their counts is the work of the frames between.
const FRAMES: [usize; 2] = [2, 10];
/// Size of the latitude-longitude map that pharr reads.
const GRID: Grid = Grid { width: 256, height: 128, domain: Domain::Sphere };

/// Samples a procedural map `frames` times without output, so that callgrind counts the sampler alone.
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

/// Adds the instructions per frame to the core's points of `lights` lights, if valgrind is installed.
pub(super) fn add(points: &mut [Point], lights: usize) {
    for point in points.iter_mut().filter(|p| SamplerKind::NAMES.contains(&p.sampler) && p.lights == lights) {
        let run = |frames| count(point.sampler, lights, frames);
        let [few, many] = FRAMES.map(run);
        point.instructions = few.zip(many).map(|(a, b)| b.saturating_sub(a) / (FRAMES[1] - FRAMES[0]) as u64);
    }
}

/// Instructions per frame of a case of `bench`; `None` without valgrind.
#[must_use]
pub fn of_bench(case: &Case) -> Option<u64> {
    let run = |frames: usize| {
        under_callgrind(&["bench", "--case", &case.to_string(), "--frames", &frames.to_string()])
    };
    let [few, many] = FRAMES.map(run);
    few.zip(many).map(|(a, b)| b.saturating_sub(a) / (FRAMES[1] - FRAMES[0]) as u64)
}

/// Returns the instructions of a whole run; `None` if callgrind is not installed or its output has no count.
fn count(sampler: &str, lights: usize, frames: usize) -> Option<u64> {
    let (lights, frames) = (lights.to_string(), frames.to_string());
    under_callgrind(&["sample-frames", "--sampler", sampler, "--lights", &lights, "--frames", &frames])
}

fn under_callgrind(arguments: &[&str]) -> Option<u64> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe().ok()?)
        .args(arguments)
        .output()
        .ok()?;
    let said = String::from_utf8_lossy(&output.stderr);
    let (_, collected) = said.split_once("Collected :")?;
    collected.split_whitespace().next()?.parse().ok()
}
