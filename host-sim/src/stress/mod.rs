//! `hemilux-sim stress`: every scenario x every method x three numbers of lights, as `host-sim/METRICS.md` defines them.

mod figure;
mod judge;
mod table;
#[cfg(test)]
mod tests;

pub use judge::{Judge, Row};
pub use table::text;

use crate::contender;
use crate::error::SimError;
use crate::output;
use crate::progress;
use crate::scenario::{self, Setting};
use std::path::PathBuf;

/// Lights of the report.
pub const COUNTS: [usize; 3] = [16, 64, 256];

/// Options of the report.
#[derive(Clone, Debug)]
pub struct StressJob {
    /// Folder for `stress.json`, `stress.txt` and `stress.svg`.
    pub out: PathBuf,
    /// Smaller maps and shorter sequences.
    pub quick: bool,
    /// The core's samplers alone.
    pub core: bool,
    /// Folder of maps that take turns as backgrounds.
    pub backgrounds: Option<PathBuf>,
}

/// Writes the report and prints its table of 64 lights.
///
/// # Errors
/// [`SimError`].
pub fn run(job: &StressJob) -> Result<(), SimError> {
    let setting = if job.quick { Setting::QUICK } else { Setting::FULL };
    let backgrounds = match &job.backgrounds {
        Some(folder) => contender::read_maps(folder, 512)?,
        None => Vec::new(),
    };
    std::fs::create_dir_all(&job.out).map_err(|e| SimError::at(&job.out, e, "a folder that can be made"))?;
    let bar = progress::bar("stress", scenario::NAMES.len());
    let rows = progress::on_all_cores(scenario::NAMES.len(), |k| {
        let background = (!backgrounds.is_empty()).then(|| backgrounds[k % backgrounds.len()].1.clone());
        let rows = rows(scenario::NAMES[k], &Setting { background, ..setting.clone() }, job.core, &COUNTS);
        bar.set_message(scenario::NAMES[k]);
        bar.inc(1);
        rows
    });
    bar.finish_and_clear();
    let rows: Vec<Row> = rows.into_iter().flatten().collect();
    let name = |file: &str| job.out.join(file);
    output::save(&name("stress.json"), json(&rows).as_bytes())?;
    let ground = if backgrounds.is_empty() { "procedural backgrounds" } else { "real backgrounds" };
    output::save(&name("stress.txt"), text(&rows, &setting, ground).as_bytes())?;
    output::save(&name("stress.svg"), figure::svg(&rows, 64).as_bytes())?;
    eprintln!("hemilux-sim: wrote stress.json, stress.txt and stress.svg to {}", job.out.display());
    Ok(())
}

/// Runs one scenario, every method with each number of lights.
///
/// # Panics
/// If there is no scenario of this name.
#[must_use]
pub fn rows(name: &str, setting: &Setting, core: bool, counts: &[usize]) -> Vec<Row> {
    let scenario = scenario::make(name, setting).expect("the name of a scenario");
    let judge = Judge::new(&scenario);
    let mut runs = contender::run_core(&scenario, counts);
    if !core {
        runs.extend(contender::run_baselines(&scenario, counts));
    }
    runs.iter().map(|run| judge.row(run)).collect()
}

/// `{"rows": [...]}`, one row a line.
#[must_use]
pub fn json(rows: &[Row]) -> String {
    let lines: Vec<String> = rows.iter().map(|row| serde_json::json!(row).to_string()).collect();
    format!("{{\"rows\": [\n{}\n]}}\n", lines.join(",\n"))
}
