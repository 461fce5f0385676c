//! Removal of mains flicker by the pipeline of the probe: light of flickering lamps, compared with the light of steady lamps.

use crate::common::{sim_ok, text};
use hemilux::calibration::Pixels;
use hemilux::pipeline::{Pipeline, Processed, Settings};
use hemilux_core::MergeMode;
use hemilux_core::mains::{Flicker, Lamps};
use hemilux_core::wire::{FrameFault, FramesLeftOut};
use hemilux_sim::bench::bursts;
use hemilux_sim::burst::{Sensor, THESIS_EXPOSURES_S};
use hemilux_sim::env::EnvMap;
use hemilux_sim::metrics::stability::LightSource;
use hemilux_sim::scenario::stage::{WARM, at, energy, room};
use hemilux_sim::scenario::world::{Change, Course, Filming, Lamp, Timing, Wave, World};

/// Number of bursts of a simulated run.
const BURSTS: usize = 36;
/// Number of first bursts without a requirement; in them the pipeline measures the flicker.
const SETTLED: usize = 20;

fn lens() -> hemilux::recorded::LensFile {
    let text = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [240, 180]\ncentre = [119.5, 89.5]\nfocal = [73.6, 73.6]\nmax_angle_deg = 80.0\n";
    hemilux::recorded::parse_lens(std::path::Path::new("lens.toml"), text).expect("a lens")
}

fn timing(rate_hz: f64) -> Timing {
    Timing { rate_hz, exposures: THESIS_EXPOSURES_S.to_vec(), line_s: 20e-6, rotates: false }
}

/// Returns a room with two lamps, each with the energy of the room.
fn world(wave: Wave, other: Wave) -> World {
    let still = EnvMap::from_fn(256, 128, |d| room(d).map(|v| v.min(3.0)));
    let flux = energy(&still);
    let lamp = |theta, phi, wave| Lamp {
        source: LightSource { direction: at(theta, phi), radius_deg: 4.0 },
        colour: WARM,
        flux,
        course: Course { wave, phase: 0.3, changes: Vec::new() },
    };
    World { still, lit: None, lamps: vec![lamp(40.0, 120.0, wave), lamp(30.0, -60.0, other)] }
}

/// Scalar flux, horizontal irradiance and flicker of the light set of one burst.
#[derive(Clone, Copy, Debug)]
struct BurstLight {
    values: [f64; 6],
    flicker: Flicker,
}

impl BurstLight {
    fn of(found: &Processed<'_>) -> Self {
        let all = found.scalar_flux.iter().chain(&found.horizontal_irradiance);
        let mut values = [0.0; 6];
        values.iter_mut().zip(all).for_each(|(to, v)| *to = f64::from(*v));
        Self { values, flicker: found.flicker }
    }

    fn difference(&self, other: &Self) -> f64 {
        let off = self.values.iter().zip(other.values).map(|(a, b)| (a / b - 1.0).abs());
        off.fold(0.0, f64::max)
    }
}

fn film(world: &World, timing: Timing) -> Filming {
    Filming::new(world, lens(), timing, Sensor { bits: 12, full_well: 10_000.0, read_noise: 3.0 }, None)
}

fn run(filming: &Filming, bursts: usize, lamps: Lamps) -> Vec<BurstLight> {
    run_with(filming, bursts, Settings { lamps, ..Settings::default() })
}

fn run_with(filming: &Filming, bursts: usize, settings: Settings) -> Vec<BurstLight> {
    let mut pipeline =
        Pipeline::try_new(filming.calibration(), &filming.exposures(), settings).expect("a pipeline");
    (0..bursts)
        .map(|burst| {
            let found = pipeline.process(&filming.burst(burst)).map(|found| {
                assert!(found.frames_left_out.is_empty(), "burst {burst}: {:?}", found.frames_left_out);
                BurstLight::of(&found)
            });
            found.expect("lights")
        })
        .collect()
}

/// Returns the largest relative difference from the light of steady lamps, and the mean relative change from burst to burst, both from burst
/// `settled` on.
fn figures(seen: &[BurstLight], steady: &[BurstLight], settled: usize) -> [f64; 2] {
    let off = (settled..seen.len()).map(|t| seen[t].difference(&steady[t])).fold(0.0, f64::max);
    let flicker: f64 = (settled..seen.len()).map(|t| seen[t].difference(&seen[t - 1])).sum();
    [off, flicker / (seen.len() - settled) as f64]
}

fn compare(wave: Wave, settled: usize) -> [f64; 2] {
    compare_with(wave, settled, Settings::default())
}

fn compare_with(wave: Wave, settled: usize, settings: Settings) -> [f64; 2] {
    let steady = run(&film(&world(Wave::Steady, Wave::Steady), timing(28.0)), BURSTS, Lamps::Off);
    let filming = film(&world(wave, wave), timing(28.0));
    let raw = figures(&run(&filming, BURSTS, Lamps::Off), &steady, settled);
    let seen = run_with(&filming, BURSTS, settings);
    let found = figures(&seen, &steady, settled);
    let percent = |ratios: [f64; 2]| ratios.map(|v| format!("{:.2} %", 100.0 * v)).join(" and ");
    let last = seen.last().expect("sets").flicker;
    eprintln!("{wave:?}: off and flicker {}, as recorded {}; {last:?}", percent(found), percent(raw));
    found
}

#[test]
fn light_of_sinusoids_of_full_depth_equals_light_of_steady_lamps() {
    for hz in [99.8, 100.15, 100.0, 120.0] {
        let [off, flicker] = compare(Wave::Sine { hz, depth: 1.0 }, SETTLED);
        assert!(off < 0.025 && flicker < 0.01, "{hz} Hz: off {off}, flicker {flicker}");
    }
}

#[test]
fn light_of_other_waveforms_equals_light_of_steady_lamps() {
    let waves = [
        Wave::Phosphor { hz: 120.0 },
        Wave::Sine { hz: 100.0, depth: 0.1 },
        Wave::Sine { hz: 120.0, depth: 0.3 },
        Wave::Rectified { hz: 100.0 },
    ];
    for wave in waves {
        let [off, flicker] = compare(wave, SETTLED);
        assert!(off < 0.025 && flicker < 0.01, "{wave:?}: off {off}, flicker {flicker}");
    }
}

/// At 28 frames per second, light of 100 Hz is measured at seven phases, over which the mean of a rectangular wave has an error at its edges: 5 %
/// on average, depending on the phases. With [`MergeMode::Needed`], the exposures that are read differ between the phases until the frequency is
/// measured.
#[test]
fn light_of_rectangular_waves_is_the_mean_over_the_measured_phases() {
    for merge in [MergeMode::All, MergeMode::Needed] {
        let settings = Settings { merge, ..Settings::default() };
        let wave = Wave::Pwm { hz: 100.0, duty: 0.5 };
        let [off, flicker] = compare_with(wave, SETTLED + 6, settings);
        assert!(off < 0.05 && flicker < 0.005, "{merge:?}: off {off}, flicker {flicker}");
    }
}

#[test]
fn light_of_a_steady_scene_is_unchanged() {
    let filming = film(&world(Wave::Steady, Wave::Steady), timing(28.0));
    let (with, without) = (run(&filming, BURSTS, Lamps::Auto), run(&filming, BURSTS, Lamps::Off));
    for (burst, (a, b)) in with.iter().zip(&without).enumerate() {
        assert_eq!(a.values, b.values, "burst {burst}");
        assert_eq!(a.flicker, Flicker::default(), "burst {burst}");
    }
}

/// One of two flickering lamps is switched off and on again; the other lamp and the room do not change.
#[test]
fn switched_lamp_in_flickering_light_is_followed_within_two_bursts() {
    let timing = timing(28.0);
    let [off_at, on_at] = [24, 34].map(|burst| timing.burst_end_s(burst) + 6e-3);
    let switched = |wave| {
        let mut world = world(wave, wave);
        world.lamps[0].course.changes =
            vec![Change { at_s: off_at, level: 0.0 }, Change { at_s: on_at, level: 1.0 }];
        world
    };
    let steady = run(&film(&switched(Wave::Steady), timing.clone()), 44, Lamps::Off);
    let seen = run(&film(&switched(Wave::Sine { hz: 100.0, depth: 1.0 }), timing), 44, Lamps::Auto);
    let mut worst = 0.0f64;
    for burst in SETTLED..44 {
        let off = seen[burst].difference(&steady[burst]);
        eprintln!("burst {burst}: off {:.2} %", 100.0 * off);
        let follows = [25, 35].contains(&burst);
        worst = if follows { worst } else { worst.max(off) };
    }
    assert!(worst < 0.025, "off {worst}");
}

/// Records bursts of two lamps at 28 Hz and returns the sets that `hemilux-sim replay` computes from them with `arguments`.
fn replay(wave: Wave, has_times: bool, arguments: &[&str]) -> Vec<serde_json::Value> {
    let folder = tempfile::tempdir().expect("a folder");
    let filming = film(&world(wave, wave), timing(28.0));
    for burst in 0..BURSTS {
        filming.record(burst, &folder.path().join(format!("{burst:04}")), has_times).expect("written");
    }
    let lines = sim_ok(&[&["replay", "--burst", text(folder.path())], arguments].concat());
    lines.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

fn flux(set: &serde_json::Value) -> [f64; 6] {
    let values =
        ["scalar_flux", "horizontal_irradiance"].into_iter().flat_map(|name| (0..3).map(move |c| (name, c)));
    let mut all = [0.0; 6];
    all.iter_mut().zip(values).for_each(|(to, (name, c))| *to = set[name][c].as_f64().expect("a number"));
    all
}

/// The recording has time stamps, or the command line a frame rate, or neither.
#[test]
fn flicker_of_a_recorded_sequence_is_removed_with_and_without_time_stamps() {
    let steady = replay(Wave::Steady, true, &[]);
    assert!(steady.iter().all(|set| set.get("mains").is_none()), "steady lamps");
    let difference =
        |a: [f64; 6], b: [f64; 6]| a.iter().zip(b).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
    let cases: [(f64, bool, &[&str]); 4] =
        [(100.0, true, &[]), (120.0, true, &[]), (100.0, false, &["--rate", "28"]), (120.0, false, &[])];
    for (hz, has_times, arguments) in cases {
        let name = format!("{hz} Hz {has_times} {arguments:?}");
        let sets = replay(Wave::Sine { hz, depth: 1.0 }, has_times, arguments);
        let settled = SETTLED..BURSTS;
        let off = settled.clone().map(|t| difference(flux(&sets[t]), flux(&steady[t]))).fold(0.0, f64::max);
        let changes = settled.map(|t| difference(flux(&sets[t]), flux(&sets[t - 1])));
        let flicker = changes.sum::<f64>() / (BURSTS - SETTLED) as f64;
        let last = &sets[BURSTS - 1]["mains"];
        eprintln!("{name}: off {:.2} %, flicker {:.2} %, {last}", 100.0 * off, 100.0 * flicker);
        assert!(off < 0.025 && flicker < 0.01, "{name}: off {off}, flicker {flicker}");
        let is_told = has_times || !arguments.is_empty();
        assert_eq!(last["frequency_hz"].as_f64().map(f64::round), is_told.then_some(hz), "{name}");
    }
}

#[test]
fn no_frame_of_a_room_whose_whole_light_flickers_is_left_out_after_eight_seconds() {
    let case = "rgb24+mains:320x240:q2tree:64".parse().expect("a case");
    let mut bursts = bursts::make(&case);
    let exposures: Vec<_> = bursts[0].frames.iter().map(|frame| frame.exposure).collect();
    let mut pipeline =
        Pipeline::try_new(bursts::calibration(&case), &exposures, Settings::default()).unwrap();
    for burst in 0..160 {
        let processed = pipeline.process(bursts::timed(&mut bursts, burst)).unwrap();
        assert!(burst < 80 || processed.frames_left_out == FramesLeftOut::NONE, "burst {burst}");
        assert!(burst < 80 || processed.flicker.share > 0.9, "burst {burst}: {:?}", processed.flicker);
    }
}

/// Returns a room whose light flickers, but for 5 %.
fn flickering_room(wave: Wave) -> World {
    let room = |share: f32| EnvMap::from_fn(256, 128, |d| room(d).map(|v| share * v.min(3.0)));
    let course = Course { wave, phase: 0.3, changes: Vec::new() };
    World { still: room(0.05), lit: Some((room(1.0), course)), lamps: Vec::new() }
}

/// The frames of a rolling shutter, or short exposures in the dark part of the lamps' period, differ from the other frames whenever a burst meets the
/// same phase; a black frame at a phase at which none was black is still left out.
#[test]
fn no_frame_is_left_out_because_of_lamps_that_light_the_whole_room() {
    let sine = |depth| Wave::Sine { hz: 100.0, depth };
    let cases = [
        (sine(0.6), 28.0, 20e-6, 0.02),
        (sine(1.0), 28.2, 20e-6, 0.02),
        (Wave::Sine { hz: 120.0, depth: 1.0 }, 25.0, 20e-6, 0.02),
        (Wave::Phosphor { hz: 100.0 }, 28.0, 20e-6, 0.02),
        (Wave::Pwm { hz: 100.0, duty: 0.5 }, 28.0, 40e-6, 0.05),
        (Wave::Pwm { hz: 100.0, duty: 0.5 }, 28.2, 1e-9, 0.05),
    ];
    for (wave, rate_hz, line_s, most) in cases {
        let name = format!("{wave:?}, {rate_hz} frames per second, {line_s} s per row");
        let timing = Timing { line_s, ..timing(rate_hz) };
        let steady = film(&flickering_room(Wave::Steady), timing.clone());
        let steady = run(&steady, 2, Lamps::Off)[1];
        let filming = film(&flickering_room(wave), timing);
        let mut pipeline =
            Pipeline::try_new(filming.calibration(), &filming.exposures(), Settings::default()).unwrap();
        let mut worst = 0.0f64;
        for burst in 0..100 {
            let found = pipeline.process(&filming.burst(burst)).unwrap();
            let is_settled = burst >= 70;
            assert!(!is_settled || found.frames_left_out.is_empty(), "{name}: burst {burst}");
            worst = worst.max(if is_settled { BurstLight::of(&found).difference(&steady) } else { 0.0 });
        }
        eprintln!("{name}: off {:.2} %", 100.0 * worst);
        assert!(worst < most, "{name}: off {worst}");
        let mut burst = filming.burst(100);
        match &mut burst.frames[2].pixels {
            Pixels::U16(codes) => codes.fill(0),
            Pixels::U8(codes) => codes.fill(0),
        }
        let left_out = pipeline.process(&burst).unwrap().frames_left_out;
        let mut named = left_out.iter().map(|frame| (frame.index, frame.fault));
        assert!(named.any(|found| found == (2, FrameFault::Black)), "{name}: {left_out:?}");
    }
}
