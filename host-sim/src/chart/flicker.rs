//! Flicker of each method by number of lights: the mean over scenarios with motion or switching.

use super::Point;
use crate::contender;
use crate::progress;
use crate::scenario::{self, Setting};
use crate::stress::StressJudge;

/// Names of the scenarios over which flicker is averaged; their maps have the size of the quick stress report.
pub(super) const SCENARIOS: [&str; 5] = ["swinging-bulb", "walker", "clouds", "seam", "switch"];

/// Numbers of lights for which a chart shows flicker.
const COUNTS: &[usize] = &[4, 16, 64, 256, 1024];
/// Numbers of lights for which a quick chart shows flicker.
const QUICK: &[usize] = &[16, 64];

/// Sets the flicker of those points whose number of lights is in [`COUNTS`], or in [`QUICK`] if `quick`.
pub(super) fn add(points: &mut [Point], quick: bool) {
    let counts = if quick { QUICK } else { COUNTS };
    let bar = progress::bar("flicker", SCENARIOS.len());
    let rows = progress::on_all_cores(SCENARIOS.len(), |k| {
        let scenario = scenario::make(SCENARIOS[k], &Setting::QUICK).expect("the name of a scenario");
        let judge = StressJudge::new(&scenario);
        let mut runs = contender::run_core(&scenario, counts);
        runs.extend(contender::run_baselines(&scenario, counts));
        bar.inc(1);
        runs.iter().map(|run| judge.row(run)).collect::<Vec<_>>()
    });
    bar.finish_and_clear();
    for point in points {
        let of = rows.iter().flatten().filter(|r| (r.sampler, r.lights) == (point.sampler, point.lights));
        let flicker: Vec<f64> = of.filter_map(|row| row.soft_flicker_mean.or(row.flicker_mean)).collect();
        point.flicker =
            (flicker.len() == SCENARIOS.len()).then(|| flicker.iter().sum::<f64>() / flicker.len() as f64);
    }
}
