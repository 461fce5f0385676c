//! Tests of the report's JSON, of the committed table, and of the README's figures.

use super::*;
use crate::contender::{MethodKind, methods};

const TINY: Setting = Setting { width: 32, frames: 8, seed: 1, background: None };

#[test]
fn json_has_the_keys_of_the_format_and_null_for_no_meaning() {
    let rows = rows("n-changes", &TINY, false, &COUNTS);
    assert_eq!(rows.len(), methods().len() * COUNTS.len());
    let parsed: serde_json::Value = serde_json::from_str(&json(&rows)).unwrap();
    let keys = [
        "scenario",
        "sampler",
        "lights",
        "shadowed",
        "flicker_mean",
        "flicker_max",
        "soft_shadowed",
        "soft_flicker_mean",
        "soft_flicker_max",
        "unwarranted",
        "step_frames",
        "soft_step_frames",
        "transit",
        "tracking_deg",
        "lag_frames",
        "motion_noise_deg",
        "radius_change",
        "churn",
    ];
    for row in parsed["rows"].as_array().unwrap() {
        let row = row.as_object().unwrap();
        assert!(row.len() == keys.len() && keys.iter().all(|key| row.contains_key(*key)), "{row:?}");
        let undefined = ["step_frames", "transit", "tracking_deg", "lag_frames"];
        assert!(undefined.iter().all(|key| row[*key].is_null()), "{row:?}");
        assert_eq!(row["shadowed"].is_null(), row["sampler"] == "volume", "{row:?}");
    }
}

#[test]
fn switch_scenario_has_leak_step_and_transit_and_no_tracking() {
    for row in rows("switch", &TINY, true, &[16]) {
        assert!(row.unwarranted.is_some() && row.step_frames.is_some() && row.transit.is_some(), "{row:?}");
        assert!(row.tracking_deg.is_none() && row.motion_noise_deg.is_none(), "{row:?}");
        assert!(row.shadowed.unwrap() > 0.0 && row.flicker_max >= row.flicker_mean, "{row:?}");
    }
}

#[test]
fn shadow_scenario_scores_receivers_that_do_not_see_the_sun() {
    let scenario = scenario::make("sun-shadow", &TINY).unwrap();
    let rows = rows("sun-shadow", &TINY, true, &[64]);
    let pharr = rows.iter().find(|r| r.sampler == "pharr" && r.lights == 64).unwrap();
    let tree = rows.iter().find(|r| r.sampler == "q2tree" && r.lights == 64).unwrap();
    assert!(pharr.shadowed > tree.shadowed, "few lights of equal energy are outside of the sun");
    assert!(scenario.in_shadow);
}

#[test]
fn methods_list_the_core_first_and_have_different_names() {
    let all = methods();
    assert!(all[..hemilux_core::SamplerKind::ALL.len()].iter().all(|m| m.kind == MethodKind::Core));
    assert_eq!(all.last().map(|m| m.name), Some("volume"));
    let names: std::collections::HashSet<_> = all.iter().map(|m| m.name).collect();
    assert_eq!(names.len(), all.len());
}

/// Returns the rows of every scenario on small maps.
fn quick(core: bool, counts: &[usize]) -> Vec<Vec<StressRow>> {
    progress::on_all_cores(scenario::NAMES.len(), |k| rows(scenario::NAMES[k], &Setting::QUICK, core, counts))
}

#[test]
fn readme_has_the_number_of_scenarios_in_which_ambient_light_has_the_least_error() {
    let first = |rows: &Vec<StressRow>| {
        // Lights that are fitted as discs are not read as points in this test.
        let hard = rows.iter().filter(|row| !row.sampler.ends_with("+soft"));
        let lit = hard.filter_map(|row| Some((row.shadowed?, row.sampler)));
        lit.min_by(|a, b| a.0.total_cmp(&b.0)).is_some_and(|(_, sampler)| sampler == "adaptive+sh")
    };
    let found = quick(false, &[64]).iter().filter(|rows| first(rows)).count();
    let readme = concat!(env!("CARGO_MANIFEST_DIR"), "/../README.md");
    let readme = std::fs::read_to_string(readme).unwrap();
    let claim =
        format!("the least error of all methods in {found} of the {} scenarios", scenario::NAMES.len());
    let words: Vec<&str> = readme.split_whitespace().collect();
    assert!(words.join(" ").contains(&claim), "expected in README.md: \"{claim}\"");
}

#[test]
fn quick_table_of_the_core_equals_the_committed_file() {
    let found = text(&quick(true, &COUNTS).concat(), &Setting::QUICK, "procedural backgrounds");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/stress-quick.txt");
    let committed = std::fs::read_to_string(path).unwrap_or_default();
    let differs = found.lines().zip(committed.lines()).find(|(a, b)| a != b);
    assert!(
        found == committed,
        "fixtures/stress-quick.txt differs from the samplers' results; first difference:\n{differs:#?}\n\
         If the change is intended, regenerate the file in a commit of its own:\n\
         cargo run -p hemilux-sim -- stress --quick --core --out /tmp/stress && \
         cp /tmp/stress/stress.txt fixtures/stress-quick.txt"
    );
}

/// Returns the rows of the committed table: scenario, sampler, number of lights, and the further columns; `None` for a dash.
fn committed() -> Vec<(String, String, usize, Vec<Option<f64>>)> {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/stress-quick.txt"));
    let (mut scenario, mut rows) = (String::new(), Vec::new());
    for line in text.expect("the table").lines().filter(|line| !line.starts_with('#')) {
        match line.split_whitespace().collect::<Vec<_>>().as_slice() {
            [name, "lights", ..] => scenario = (*name).into(),
            [sampler, lights, columns @ ..] => {
                let columns = columns.iter().map(|text| text.parse().ok()).collect();
                rows.push((scenario.clone(), (*sampler).into(), lights.parse().expect("a number"), columns));
            }
            _ => {}
        }
    }
    rows
}

/// README: errors and flicker under PWM lamps; errors and tracking lags of the bulb, the walker and the clouds, with bursts and with the sliding
/// window, which has the smaller error, flicker and lag.
#[test]
fn readme_has_the_figures_of_pwm_lamps_and_of_moving_light() {
    const ERROR: usize = 0;
    const FLICKER: usize = 1;
    const LAG: usize = 11;
    let readme = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../README.md"));
    let readme = readme.expect("README.md").split_whitespace().collect::<Vec<_>>().join(" ");
    let rows = committed();
    let figures = |scenario: &str| {
        let is_row = |(s, name, n, _): &&(String, String, usize, _)| {
            (s.as_str(), name.as_str(), *n) == (scenario, "adaptive", 64)
        };
        let (.., columns) = rows.iter().find(is_row).expect("a row");
        move |column: usize| columns[column].expect("a figure")
    };
    for lamps in ["bursts-100-pwm", "bursts-1k-pwm"] {
        let [error, flicker] = [ERROR, FLICKER].map(figures(lamps));
        let told = format!("(`{lamps}`: {error:.1} % error and {flicker:.1} % flicker)");
        assert!(readme.contains(&told), "expected in README.md: \"{told}\"");
    }
    for light in ["swinging", "walker", "clouds"] {
        let [bursts, window] =
            ["bursts", "sliding"].map(|kind| [ERROR, FLICKER, LAG].map(figures(&format!("{kind}-{light}"))));
        assert!((0..3).all(|k| window[k] < bursts[k]), "{light}: {window:?}, bursts {bursts:?}");
        for told in [
            format!("from {:.1} to {:.1} %", bursts[0], window[0]),
            format!("from {:.1} to {:.1} camera frames", bursts[2], window[2]),
        ] {
            assert!(readme.contains(&told), "expected in README.md for {light}: \"{told}\"");
        }
    }
}

/// README: the flicker of discs exceeds the flicker of points by at most 0.12 %; in the scenarios of bursts under
/// bulbs and rectified LEDs, 64 lights flicker by at most 0.05 %.
#[test]
fn readme_figures_of_flicker_agree_with_the_committed_table() {
    const FLICKER: usize = 1;
    const SOFT_FLICKER: usize = 4;
    let rows = committed();
    let mut compared = 0;
    for (scenario, sampler, lights, columns) in &rows {
        let Some(hard) = sampler.strip_suffix("+soft") else { continue };
        let points = rows.iter().find(|(s, name, n, _)| (s, name.as_str(), n) == (scenario, hard, lights));
        let points = points.and_then(|(.., columns)| columns[FLICKER]).expect("a row of points");
        let discs = columns[SOFT_FLICKER].expect("a flicker of discs");
        assert!(
            discs - points < 0.125,
            "{scenario} {sampler} {lights}: {discs} of discs, {points} of points"
        );
        compared += 1;
    }
    let still = ["bursts-steady", "bursts-100-bulb", "bursts-120-bulb", "bursts-100-led", "bursts-120-led"];
    let bursts =
        rows.iter().filter(|(s, name, n, _)| still.contains(&s.as_str()) && name == "adaptive" && *n == 64);
    let bursts: Vec<f64> = bursts.map(|(.., columns)| columns[FLICKER].expect("a flicker")).collect();
    assert!(bursts.len() == still.len() && bursts.iter().all(|flicker| *flicker < 0.055), "{bursts:?}");
    assert!(compared > 60, "{compared} rows");
}
