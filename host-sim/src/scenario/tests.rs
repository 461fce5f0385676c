//! Tests of the scenarios' energies, supports, changes and seeds.

use super::stage::energy;
use super::*;
use crate::metrics::luminance;

const SMALL: Setting = Setting { width: 64, frames: 9, seed: 7, background: None };

fn scenario(name: &str) -> Scenario {
    make(name, &SMALL).unwrap()
}

fn changed(a: &EnvMap, b: &EnvMap) -> Vec<[f64; 3]> {
    let differs = (0..a.texels().len()).filter(|&k| a.texels()[k] != b.texels()[k]);
    differs.map(|k| a.direction(k / a.width(), k % a.width())).collect()
}

#[test]
fn all_scenarios_are_complete_deterministic_and_seeded() {
    for name in NAMES {
        let (a, b) = (scenario(name), scenario(name));
        assert_eq!(a.name, name);
        assert!(
            a.truth == b.truth && a.seen == b.seen && a.share == b.share,
            "{name} differs between two runs"
        );
        // Camera frames: three of each burst.
        let frames = if a.has_lag { 27 } else { 9 };
        assert_eq!([a.truth.len(), a.seen().len(), a.sources.len()], [frames; 3], "{name}");
        assert!(a.seen().iter().all(|map| map.clipped() + map.negative == 0 && energy(map) > 0.0), "{name}");
        assert!(a.changes.iter().all(|&t| (1..9).contains(&t)), "{name}");
    }
    assert!(make("none", &SMALL).is_none());
    for name in ["noise", "grid-of-lamps", "n-changes"] {
        let (a, b) = (scenario(name), make(name, &Setting { seed: 8, ..SMALL }).unwrap());
        assert!(a.seen() != b.seen() || a.share != b.share, "{name} ignores its seed");
    }
}

#[test]
fn switched_lamp_adds_the_stated_energy_inside_its_disc() {
    let s = scenario("switch");
    let (on, off) = (s.changes[0], s.changes[1]);
    let added = energy(&s.truth[on]) - energy(&s.truth[on - 1]);
    // Texels are f32 with a relative error of 6e-8, and the lamp has half of the energy.
    assert!((added / s.switched_energy.unwrap() - 1.0).abs() < 1e-5, "{added}");
    assert_eq!(s.truth[off], s.truth[0], "the map after the lamp is switched off equals the first map");
    let lamp = s.sources[on][0];
    let texel_deg = 180.0 / 32.0;
    let far = changed(&s.truth[on], &s.truth[on - 1]);
    assert!(!far.is_empty() && far.iter().all(|&d| lamp.distance_deg(d) < texel_deg), "compact support");
}

#[test]
fn moving_lamps_keep_their_energy_and_their_support() {
    for name in ["swinging-bulb", "seam", "zenith", "rim"] {
        let s = scenario(name);
        let first = energy(&s.truth[0]);
        for t in 1..9 {
            assert!((energy(&s.truth[t]) / first - 1.0).abs() < 1e-6, "{name} {t}");
            let near =
                |d: &[f64; 3]| [t - 1, t].iter().any(|&t| s.sources[t][0].distance_deg(*d) < 180.0 / 32.0);
            assert!(changed(&s.truth[t], &s.truth[t - 1]).iter().all(near), "{name} {t}");
        }
    }
    let sides = |name: &str, of: fn([f64; 3]) -> f64| {
        let s = scenario(name);
        of(s.sources[0][0].direction) * of(s.sources[8][0].direction)
    };
    assert!(sides("seam", |d| d[1]) < 0.0 && sides("zenith", |d| d[0]) < 0.0 && sides("rim", |d| d[2]) < 0.0);
    assert!(scenario("rim").tracked(0).is_some() && scenario("rim").tracked(8).is_none());
}

#[test]
fn mains_flicker_has_mean_1_and_changes_the_lamp_most() {
    // The function 2 sin^2 has the mean 1 and the range 0 to 2; over 206 bursts the phases are evenly spread.
    for name in ["flicker-100hz", "flicker-120hz"] {
        let s = make(name, &Setting { frames: 20, ..SMALL }).unwrap();
        let energies: Vec<f64> = s.seen().iter().map(energy).collect();
        let mean = energies.iter().sum::<f64>() / 20.0 / energy(&s.truth[0]);
        assert!((mean - 1.0).abs() < 0.05, "{name}: {mean}");
        let most = energies.iter().copied().fold(0.0, f64::max);
        assert!(most > 1.2 * energy(&s.truth[0]), "{name} does not flicker");
    }
}

#[test]
fn hue_shift_keeps_every_texels_luminance() {
    let s = scenario("hue-shift");
    let y = |map: &EnvMap, k: usize| luminance(map.texels()[k].map(f64::from));
    for k in 0..s.truth[0].texels().len() {
        assert!((y(&s.truth[4], k) / y(&s.truth[0], k) - 1.0).abs() < 1e-5, "texel {k}");
    }
    assert_ne!(s.truth[4], s.truth[0]);
}

#[test]
fn exposure_faults_change_single_frames_and_no_true_map() {
    let s = scenario("exposure-faults");
    let faulty: Vec<usize> = (0..9).filter(|&t| s.seen()[t] != s.truth[t]).collect();
    assert_eq!(faulty, [2, 5, 8]);
    assert!(
        energy(&s.seen()[2]) < 0.9 * energy(&s.truth[2]),
        "the lamp is valid in the missing exposure alone"
    );
}

#[test]
fn requested_number_of_lights_is_between_the_least_and_the_largest() {
    let s = scenario("n-changes");
    let counts: Vec<usize> = (0..9).map(|t| s.lights(t, 16, 12)).collect();
    assert!(counts.iter().all(|n| (12..=16).contains(n)) && counts.iter().any(|n| *n != counts[0]));
    assert_eq!(scenario("switch").lights(3, 64, 12), 64);
}

#[test]
fn map_of_another_size_can_be_the_background() {
    let bright = EnvMap::new(20, 10, vec![[3.0; 3]; 200]);
    let s = make("switch", &Setting { background: Some(bright), ..SMALL }).unwrap();
    let total = energy(&s.truth[0]) / (12.0 * std::f64::consts::PI);
    assert!((total - 1.0).abs() < 1e-6, "{total}");
}
