//! Light of a burst that is simulated from a map and replayed, compared with the light of the map.

use crate::common::{root, shared, sim, sim_ok, text};
use hemilux_sim::env::EnvMap;
use hemilux_sim::metrics::{Domain, LitSet, Reading, Reference};
use hemilux_sim::score;
use std::path::Path;

/// Simulates a burst of `map`, replays it, and returns the open and the shadowed difference from `decompose --hemisphere`; `None` if the burst clips.
fn errors(map: &Path, sampler: &str) -> Option<(f64, f64)> {
    let folder = tempfile::tempdir().expect("a folder");
    let burst = folder.path().join("burst");
    let lens = root().join("fixtures/lens-184.toml");
    sim_ok(&["burst", "--env", text(map), "--lens", text(&lens), "--seed", "1", "--out", text(&burst)]);
    let sampling = ["--sampler", sampler, "--lights", "64"];
    let replayed = sim_ok(&[&["replay", "--burst", text(&burst)][..], &sampling].concat());
    if !replayed.contains("\"clipped\":0,") {
        eprintln!("SKIPPED: {} clips in three exposures", map.display());
        return None;
    }
    let direct = sim_ok(&[&["decompose", "--hemisphere", "--env", text(map)][..], &sampling].concat());
    let env = EnvMap::read(map).expect("a map");
    let reference = Reference::new(&env, Domain::Hemisphere);
    let set = |line: &str| -> LitSet {
        let path = folder.path().join("set.json");
        std::fs::write(&path, line).expect("a file");
        score::read_set(&path).expect("a light set")
    };
    let (a, b) = (set(&replayed), set(&direct));
    let rms = |a: Vec<f64>, b: Vec<f64>, mu: f64| {
        let sum: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
        (sum / a.len() as f64).sqrt() / mu
    };
    let open = rms(
        reference.open_of(&a, Reading::Points),
        reference.open_of(&b, Reading::Points),
        reference.open_mu(),
    );
    let shadowed = rms(
        reference.shadowed_of(&a, Reading::Points),
        reference.shadowed_of(&b, Reading::Points),
        reference.shadowed_mu(),
    );
    println!("{} {sampler}: open {:.3} %, shadowed {:.3} %", map.display(), 100.0 * open, 100.0 * shadowed);
    Some((open, shadowed))
}

#[test]
fn light_of_a_replayed_room_agrees_with_its_map() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = folder.path().join("room.exr");
    crate::common::write_room(&map);
    for sampler in ["q2tree", "adaptive"] {
        let (open, shadowed) = errors(&map, sampler).expect("the room does not clip");
        assert!(open <= 0.01 && shadowed <= 0.02, "{sampler}: open {open}, shadowed {shadowed}");
    }
}

#[test]
fn light_of_replayed_real_maps_agrees_with_the_maps() {
    let Some(folder) = shared("hdri") else { return };
    for name in ["apartment.exr", "bridge.exr", "forest.exr", "warehouse.exr"] {
        let Some((open, shadowed)) = errors(&folder.join(name), "q2tree") else { continue };
        assert!(open <= 0.01 && shadowed <= 0.02, "{name}: open {open}, shadowed {shadowed}");
    }
}

#[test]
fn bursts_of_equal_seeds_are_equal_and_of_different_seeds_differ() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = folder.path().join("room.exr");
    crate::common::write_room(&map);
    let lens = root().join("fixtures/lens-160x140.toml");
    let make = |name: &str, seed: &str| {
        let out = folder.path().join(name);
        sim_ok(&["burst", "--env", text(&map), "--lens", text(&lens), "--seed", seed, "--out", text(&out)]);
        std::fs::read(out.join("frame-1.png")).expect("a frame")
    };
    let first = make("a", "7");
    assert!(first == make("b", "7"), "bursts of equal seeds are equal");
    assert!(first != make("c", "8"), "bursts of different seeds differ");
}

#[test]
fn share_outside_of_the_field_of_view_is_reported_as_unseen() {
    let folder = tempfile::tempdir().expect("a folder");
    let (map, out) = (folder.path().join("room.exr"), folder.path().join("burst"));
    crate::common::write_room(&map);
    let lens = root().join("fixtures/lens-160x140.toml");
    sim_ok(&["burst", "--env", text(&map), "--lens", text(&lens), "--out", text(&out)]);
    let unseen = |extrapolation: &str| {
        let line = sim_ok(&["replay", "--burst", text(&out), "--extrapolation", extrapolation]);
        let set: serde_json::Value = serde_json::from_str(&line).expect("JSON");
        (set["unseen"].as_f64().expect("a number"), set["scalar_flux"][1].as_f64().expect("a number"))
    };
    let ((share, dark), (same, filled)) = (unseen("none"), unseen("average"));
    // Outside of the circle of 80 degrees lies the fraction cos(80 deg) = 0.174 of the hemisphere; the sensor ends at 70 degrees above and below,
    // which cuts two more caps.
    assert!((0.174..0.25).contains(&share) && share == same, "unseen {share}");
    assert!(filled > dark, "the average adds light outside of the field of view");
}

#[test]
fn exposure_ratios_are_printed() {
    let Some(folder) = shared("office-burst") else { return };
    let output = sim(&["replay", "--burst", text(&folder)]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("as measured in the pixels") && told.lines().count() >= 11, "{told}");
}
