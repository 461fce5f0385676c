//! `hemilux-sim reads`: comparison of [`MergeMode::Needed`], which does not read the exposures that are shorter than one without saturated
//! samples, with [`MergeMode::All`]: exposures read, error of the irradiance, instructions.

use crate::bench::bursts::{calibration, make_of};
use crate::bench::case::{self, Case};
use crate::chart::counted;
use crate::error::SimError;
use crate::output;
use hemilux::calibration::{Burst, Calibration};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::scene;
use hemilux_core::pyramid::PyramidView;
use hemilux_core::{Exposure, MergeMode};
use std::fmt::Write;

/// Number of bursts of each scene that are compared.
const BURSTS: usize = 4;
/// HEALPix order of the quads whose first moments illuminate the receivers.
const ORDER: u8 = 4;
/// Number of receivers of the comparison, each with its own normal.
const NORMALS: usize = 96;

/// Figures of [`MergeMode::Needed`] in comparison with [`MergeMode::All`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeededFigures {
    /// Mean number of exposures that the merge reads of a pixel.
    pub exposures_read: f64,
    /// Largest difference between the irradiances of an unoccluded receiver in the two modes, divided by the largest irradiance of a receiver.
    pub open: f64,
}

/// Merges `bursts` in both modes and returns the means of the figures over the bursts.
///
/// # Errors
/// [`SimError`] for bursts that do not fit the calibration.
pub fn compare(calibration: &Calibration, bursts: &[Burst]) -> Result<NeededFigures, SimError> {
    let exposures: Vec<Exposure> =
        bursts.first().into_iter().flat_map(|b| b.frames.iter().map(|f| f.exposure)).collect();
    let pipeline =
        |merge| Pipeline::try_new(*calibration, &exposures, Settings { merge, ..Settings::default() });
    let (mut all, mut needed) = (pipeline(MergeMode::All)?, pipeline(MergeMode::Needed)?);
    let mut mean = NeededFigures { exposures_read: 0.0, open: 0.0 };
    for burst in bursts {
        all.process(burst)?;
        let read = needed.process(burst)?.seen.exposures_read;
        let (truth, found) = (irradiance(&all.map().pyramid), irradiance(&needed.map().pyramid));
        let most = truth.iter().copied().fold(0.0, f64::max);
        let off = truth.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        mean.exposures_read += read / bursts.len() as f64;
        mean.open += off / most / bursts.len() as f64;
    }
    Ok(mean)
}

/// Returns the irradiances of [`NORMALS`] receivers whose normals are spread over the upper hemisphere.
fn irradiance(map: &PyramidView<'_>) -> Vec<f64> {
    let normal = |i: usize| {
        let (z, phi) = ((i as f64 + 0.5) / NORMALS as f64, 2.399_963_229_728_653 * i as f64);
        let across = (1.0 - z * z).sqrt();
        [across * phi.cos(), across * phi.sin(), z]
    };
    let lit = |n: [f64; 3]| {
        let facing = |m: [f32; 4]| (0..3).map(|i| n[i] * f64::from(m[i])).sum::<f64>().max(0.0);
        map.quads_of(ORDER).iter().map(|quad| facing(quad.moment)).sum()
    };
    (0..NORMALS).map(normal).map(lit).collect()
}

/// Writes a table with one row for each pixel format and scene to standard output; with `count`, valgrind counts the instructions of a frame.
///
/// # Errors
/// [`SimError`] for a burst that does not fit its calibration, or if standard output cannot be written.
pub fn run(count: bool) -> Result<(), SimError> {
    let mut text = format!(
        "{:<10}{:<10}{:>16}{:>12}{:>16}{:>16}\n",
        "scene", "format", "exposures read", "open %", "needed", "all"
    );
    for case in case::formats() {
        for name in scene::NAMES {
            let Some(scene) = scene::by_name(name) else { continue };
            let NeededFigures { exposures_read, open } =
                compare(&calibration(&case), &make_of(&case, scene, BURSTS))?;
            let counted = |merge| {
                let case = Case { merge, ..case.clone() };
                // `bench` counts instructions with the scene `room` alone.
                let n = (count && name == "room").then(|| counted::of_bench(&case)).flatten();
                n.map_or("-".into(), |n| n.to_string())
            };
            let _ = writeln!(
                text,
                "{name:<10}{:<10}{exposures_read:>16.3}{:>12.4}{:>16}{:>16}",
                case.format_name(),
                100.0 * open,
                counted(MergeMode::Needed),
                counted(MergeMode::All)
            );
        }
    }
    output::say(text.as_bytes())
}
