//! Replay of a recorded sequence with false frames: the frames are left out and reported, and the lights do not change.

use crate::common::{root, sim_ok, text};
use serde_json::Value;
use std::path::Path;

const BURSTS: usize = 24;

/// False frames: index of the burst, index of the exposure in ascending order, and name of the fault.
const FALSE: [(usize, usize, &str); 6] = [
    (8, 2, "black"),
    (10, 1, "saturated"),
    (12, 0, "wrong-exposure"),
    (14, 1, "black"),
    (16, 2, "wrong-exposure"),
    (20, 0, "saturated"),
];

/// Replaces the pixels of one frame according to the fault.
fn spoil(folder: &Path, index: usize, fault: &str) {
    let file = folder.join(format!("frame-{index}.png"));
    let manifest = std::fs::read_to_string(folder.join("burst.toml")).expect("a manifest");
    let manifest: toml::Table = manifest.parse().expect("TOML");
    let black = &manifest["sensor"]["black"];
    let black = black.as_integer().map_or_else(|| black.as_float().unwrap_or(0.0), |v| v as f64) as u16;
    let mut image = image::open(&file).expect("a frame").to_rgb16();
    for code in image.iter_mut() {
        *code = match fault {
            "black" => 0,
            "saturated" => u16::MAX,
            // The codes are those of half of the stated exposure.
            _ => black + code.saturating_sub(black) / 2,
        };
    }
    image.save(&file).expect("a frame");
}

fn replay(folder: &Path) -> Vec<Value> {
    let lines = sim_ok(&["replay", "--burst", text(folder), "--lights", "64"]);
    lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

/// Returns the largest relative difference between two sets in a channel of scalar flux or horizontal irradiance.
fn difference(set: &Value, expected: &Value) -> f64 {
    let values = |set: &Value| -> Vec<f64> {
        let fields = ["scalar_flux", "horizontal_irradiance"].iter();
        fields
            .flat_map(|f| (0..3).map(|c| set[*f][c].as_f64().expect("a number")).collect::<Vec<_>>())
            .collect()
    };
    values(set).iter().zip(values(expected)).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn six_false_frames_of_a_sequence_are_left_out_and_reported() {
    let folder = tempfile::tempdir().expect("a folder");
    let one = folder.path().join("one");
    let lens = root().join("fixtures/lens-160x140.toml");
    sim_ok(&["burst", "--env", "scene:room", "--lens", text(&lens), "--out", text(&one)]);
    let sequence = folder.path().join("sequence");
    for burst in 0..BURSTS {
        let to = sequence.join(format!("{burst:04}"));
        std::fs::create_dir_all(&to).expect("a folder");
        for entry in std::fs::read_dir(&one).expect("a folder") {
            let entry = entry.expect("a file");
            std::fs::copy(entry.path(), to.join(entry.file_name())).expect("a copy");
        }
    }
    for (burst, index, fault) in FALSE {
        spoil(&sequence.join(format!("{burst:04}")), index, fault);
    }
    let sets = replay(&sequence);
    assert_eq!(sets.len(), BURSTS);
    for (burst, set) in sets.iter().enumerate() {
        let found = &set["frames_left_out"];
        match FALSE.iter().find(|(at, ..)| *at == burst) {
            None => assert!(found.is_null(), "burst {burst}: {found}"),
            Some((_, index, fault)) => {
                assert_eq!(found[0]["index"].as_u64(), Some(*index as u64), "burst {burst}: {found}");
                assert_eq!(found[0]["why"].as_str(), Some(*fault), "burst {burst}");
                // The lamps are valid in the shortest exposure alone: if that exposure is false, the whole burst is left out.
                let others = found.as_array().expect("a list")[1..]
                    .iter()
                    .filter(|f| f["why"] == "incomplete")
                    .count();
                assert_eq!(others, if *index == 0 { 2 } else { 0 }, "burst {burst}: {found}");
            }
        }
        let off = difference(set, &sets[0]);
        eprintln!("burst {burst}: off by {:.3} %, left out {found}", 100.0 * off);
        assert!(off < 0.04, "burst {burst}: off by {off}");
    }
}
