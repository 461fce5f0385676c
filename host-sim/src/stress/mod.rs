//! `hemilux-sim stress`: figures of every method over every scenario with three numbers of lights; `host-sim/METRICS.md` defines them.

mod figure;
mod judge;
mod table;
#[cfg(test)]
mod tests;

pub use judge::{StressJudge, StressRow};
pub use table::text;

use crate::contender;
use crate::error::SimError;
use crate::output;
use crate::progress;
use crate::scenario::{self, Setting};
use std::path::PathBuf;

/// Numbers of lights with which the report runs each method.
pub const COUNTS: [usize; 3] = [16, 64, 256];

/// Arguments of `stress`.
#[derive(Clone, Debug)]
pub struct StressJob {
    /// Path of the folder for `stress.json`, `stress.txt` and `stress.svg`.
    pub out: PathBuf,
    /// Whether the maps are smaller and the sequences shorter.
    pub quick: bool,
    /// Whether the methods outside of the core are left out.
    pub core: bool,
    /// Path of a folder of maps that replace the procedural backgrounds, in rotation over the scenarios.
    pub backgrounds: Option<PathBuf>,
}

/// Runs all methods over all scenarios and writes the report as JSON and text, and the drawing for 64 lights.
///
/// # Errors
/// [`SimError`] if a background cannot be read or a file cannot be written.
pub fn run(job: &StressJob) -> Result<(), SimError> {
    let setting = if job.quick { Setting::QUICK } else { Setting::FULL };
    let backgrounds = match &job.backgrounds {
        Some(folder) => contender::read_maps(folder, 512)?,
        None => Vec::new(),
    };
    std::fs::create_dir_all(&job.out)
        .map_err(|e| SimError::at(&job.out, e, "a folder that can be created"))?;
    let bar = progress::bar("stress", scenario::NAMES.len());
    let rows = progress::on_all_cores(scenario::NAMES.len(), |k| {
        let background = (!backgrounds.is_empty()).then(|| backgrounds[k % backgrounds.len()].1.clone());
        let rows = rows(scenario::NAMES[k], &Setting { background, ..setting.clone() }, job.core, &COUNTS);
        bar.set_message(scenario::NAMES[k]);
        bar.inc(1);
        rows
    });
    bar.finish_and_clear();
    let rows: Vec<StressRow> = rows.into_iter().flatten().collect();
    let name = |file: &str| job.out.join(file);
    output::save(&name("stress.json"), json(&rows).as_bytes())?;
    let ground = if backgrounds.is_empty() { "procedural backgrounds" } else { "real backgrounds" };
    output::save(&name("stress.txt"), text(&rows, &setting, ground).as_bytes())?;
    output::save(&name("stress.svg"), figure::svg(&rows, 64).as_bytes())?;
    eprintln!("hemilux-sim: wrote stress.json, stress.txt and stress.svg to {}", job.out.display());
    Ok(())
}

/// Runs the methods over the scenario `name` with each number of lights of `counts`; with `core`, the samplers of the core alone.
///
/// # Panics
/// If there is no scenario `name`.
#[must_use]
pub fn rows(name: &str, setting: &Setting, core: bool, counts: &[usize]) -> Vec<StressRow> {
    let scenario = scenario::make(name, setting).expect("the name of a scenario");
    let judge = StressJudge::new(&scenario);
    let mut runs = contender::run_core(&scenario, counts);
    if !core {
        runs.extend(contender::run_baselines(&scenario, counts));
    }
    runs.iter().map(|run| judge.row(run)).collect()
}

/// Returns the rows as JSON: `{"rows": [...]}`, one row per line.
#[must_use]
pub fn json(rows: &[StressRow]) -> String {
    let lines: Vec<String> = rows.iter().map(|row| serde_json::json!(row).to_string()).collect();
    format!("{{\"rows\": [\n{}\n]}}\n", lines.join(",\n"))
}
