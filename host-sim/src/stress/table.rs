//! Text form of the stress report. It contains no times, so that equal results have equal text.

use super::StressRow;
use crate::scenario::Setting;
use std::fmt::Write;

/// Returns a table of the rows in their order, with the setting and the meaning of the columns in comments.
#[must_use]
pub fn text(rows: &[StressRow], setting: &Setting, backgrounds: &str) -> String {
    let mut out = format!(
        "# Stress report: {} x {} texels, {} frames, seed {}, {backgrounds}.\n\
         # error: shadowed error, mean over the frames. flicker: change that the scene did not make, mean and largest.\n\
         # soft: the same three figures, and the step, of the lights read as discs of their radius.\n\
         # leak: unwarranted change in what cannot see the switched lamp. step: frames until a change has settled.\n\
         # transit: energy in empty sky over the switched lamp's. track: degrees off a moving source.\n\
         # lag: camera frames by which the sets are late.\n\
         # noise: degrees that lights move per frame of a static noisy scene. radius: largest\n\
         # change of a radius per frame of such a scene. churn: lights born and died per frame.\n\
         # Definitions in host-sim/METRICS.md; a dash where a figure has no meaning.\n",
        setting.width,
        setting.width.div_ceil(2),
        setting.frames,
        setting.seed
    );
    let mut last = "";
    for row in rows {
        if row.scenario != last {
            last = row.scenario;
            let _ = write!(out, "\n{last:<18}{:>6}", "lights");
            let heads = [
                "error %",
                "flicker %",
                "max %",
                "soft %",
                "flicker %",
                "max %",
                "leak %",
                "step",
                "soft step",
                "transit %",
                "track dg",
                "lag",
                "noise dg",
                "radius %",
                "churn",
            ];
            heads.iter().for_each(|head| out.push_str(&format!("{head:>11}")));
            out.push('\n');
        }
        line(&mut out, row);
    }
    out
}

fn line(out: &mut String, row: &StressRow) {
    let _ = write!(out, "{:<18}{:>6}", row.sampler, row.lights);
    let percent = |v: Option<f64>| v.map(|v| 100.0 * v);
    let hard = [row.shadowed, row.flicker_mean, row.flicker_max];
    let soft = [row.soft_shadowed, row.soft_flicker_mean, row.soft_flicker_max];
    for value in hard.into_iter().chain(soft).chain([row.unwarranted]) {
        cell(out, percent(value), 2);
    }
    cell(out, row.step_frames.map(|v| v as f64), 0);
    cell(out, row.soft_step_frames.map(|v| v as f64), 0);
    cell(out, percent(row.transit), 2);
    cell(out, row.tracking_deg, 2);
    cell(out, row.lag_frames, 1);
    cell(out, row.motion_noise_deg, 3);
    cell(out, percent(row.radius_change), 1);
    cell(out, row.churn, 1);
    out.push('\n');
}

fn cell(out: &mut String, value: Option<f64>, decimals: usize) {
    let text = value.map_or("-".to_string(), |v| format!("{v:.decimals$}"));
    let _ = write!(out, "{text:>11}");
}
