//! Sets of a sliding window, one for every camera frame, beside sets of whole bursts, under light that moves and changes.

use hemilux::calibration::{Burst, Frame, Pixels};
use hemilux::pipeline::{Pipeline, Settings, WindowMode};
use hemilux_core::mains::Lamps;
use hemilux_core::wire::FramesLeftOut;
use hemilux_sim::burst::{Sensor, THESIS_EXPOSURES_S};
use hemilux_sim::contender::judged;
use hemilux_sim::env::EnvMap;
use hemilux_sim::metrics::stability::{LightSource, tracking_error_deg};
use hemilux_sim::metrics::{Domain, LitSet, Reference, TexelGrid, luminance};
use hemilux_sim::scenario::stage::{DAYLIGHT, WARM, at, energy, room, with_disc, with_window};
use hemilux_sim::scenario::world::{Filming, Timing, World};
use std::f64::consts::TAU;

/// Number of exposures of a burst.
const EXPOSURES: usize = 3;
/// Number of first frames without a requirement.
const SETTLED: usize = 12;
/// Frames per second.
const RATE_HZ: f64 = 28.0;

/// Returns the interior without its own lamp, whose part below the horizon is black.
fn interior() -> EnvMap {
    EnvMap::from_fn(192, 96, |d| if d[2] < 0.0 { [0.0; 3] } else { room(d).map(|v| v.min(3.0)) })
}

/// Returns the interior with a lamp of its energy and of 3 degrees radius at `direction`.
fn lit_from(direction: [f64; 3]) -> EnvMap {
    let room = interior();
    with_disc(&room, bulb(direction), WARM, energy(&room))
}

fn bulb(direction: [f64; 3]) -> LightSource {
    LightSource { direction, radius_deg: 3.0 }
}

/// Returns the direction of a bulb that swings by 35 degrees in two seconds.
fn swing(frame: usize) -> [f64; 3] {
    at(40.0, 35.0 * (TAU * frame as f64 / (2.0 * RATE_HZ)).sin())
}

/// Returns the interior with a window of its energy, past which a dark figure walks in two seconds.
fn walk(frame: usize) -> EnvMap {
    let (room, middle, half_deg) = (interior(), at(65.0, -90.0), [28.0, 18.0]);
    let area_sr = 4.0 * half_deg.map(|deg: f64| deg.to_radians().tan()).iter().product::<f64>() * 0.8;
    let pane = DAYLIGHT.map(|c| (c * energy(&room) / area_sr) as f32);
    let x = 3.0 * frame as f64 / (2.0 * RATE_HZ) - 1.5;
    with_window(&room, middle, half_deg, |u, v, _| {
        let is_figure = (u - x).abs() * half_deg[0] < 5.0 && v < 0.5;
        if is_figure { [0.08; 3] } else { pane }
    })
}

/// A camera that takes one frame of each map of a sequence, the exposures in turn.
struct Camera {
    lens: hemilux::recorded::LensFile,
    scale: Option<f64>,
}

impl Camera {
    fn new(brightest: &EnvMap) -> Self {
        let text = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [192, 192]\ncentre = [95.5, 95.5]\nfocal = [60.5, 60.5]\nmax_angle_deg = 89.9\n";
        let lens = hemilux::recorded::parse_lens(std::path::Path::new("lens.toml"), text).expect("a lens");
        let mut camera = Self { lens, scale: None };
        camera.scale = Some(camera.film(brightest).calibration().scale);
        camera
    }

    fn film(&self, map: &EnvMap) -> Filming {
        let world = World { still: map.clone(), lit: None, lamps: Vec::new() };
        let exposures = THESIS_EXPOSURES_S.to_vec();
        let timing = Timing { rate_hz: RATE_HZ, exposures, line_s: 20e-6, rotates: false };
        let sensor = Sensor { bits: 12, full_well: 10_000.0, read_noise: 3.0 };
        Filming::new(&world, self.lens.clone(), timing, sensor, self.scale)
    }

    /// Returns the frame with the number `frame`, which shows `map`.
    fn take(&self, map: &EnvMap, frame: usize) -> Frame {
        self.film(map).burst(frame / EXPOSURES).frames.swap_remove(frame % EXPOSURES)
    }

    fn pipeline(&self, map: &EnvMap, window: WindowMode) -> Pipeline {
        let filming = self.film(map);
        let settings = Settings { window, lamps: Lamps::Off, ..Settings::default() };
        Pipeline::try_new(filming.calibration(), &filming.exposures(), settings).expect("a pipeline")
    }
}

/// The newest set after one frame of a sequence.
#[derive(Clone)]
struct Newest {
    set: LitSet,
    flux: f64,
    left_out: FramesLeftOut,
}

/// Returns the newest set after each frame from the second burst on; the first element is that after the first burst.
fn sets(maps: &[EnvMap], window: WindowMode, spoil: impl Fn(usize, &mut Frame)) -> Vec<Newest> {
    let brightest = maps.iter().max_by(|a, b| energy(a).total_cmp(&energy(b))).expect("maps");
    let camera = Camera::new(brightest);
    let mut pipeline = camera.pipeline(&maps[0], window);
    let take = |frame: usize| {
        let mut taken = camera.take(&maps[frame], frame);
        spoil(frame, &mut taken);
        taken
    };
    let mut burst = Burst { frames: (0..EXPOSURES).map(take).collect(), ..Burst::default() };
    let mut process = |burst: &Burst| {
        let processed = pipeline.process(burst).expect("lights");
        let flux = luminance(processed.scalar_flux.map(f64::from));
        Newest { set: judged(&processed.decomposition), flux, left_out: processed.frames_left_out }
    };
    let mut found = vec![process(&burst)];
    for frame in EXPOSURES..maps.len() {
        let index = frame % EXPOSURES;
        burst.frames[index] = take(frame);
        burst.stale = if window == WindowMode::Sliding { !(1 << index) } else { 0 };
        let is_due = window == WindowMode::Sliding || index == EXPOSURES - 1;
        let next = if is_due { process(&burst) } else { found[found.len() - 1].clone() };
        found.push(next);
    }
    found
}

/// Returns the mean shadowed error of the sets of a sequence, each against the map of its own frame.
fn error(maps: &[EnvMap], sets: &[Newest]) -> f64 {
    let errors = maps
        .iter()
        .skip(EXPOSURES - 1)
        .zip(sets)
        .skip(SETTLED)
        .map(|(map, newest)| Reference::new(map, Domain::Hemisphere).score(&newest.set).shadowed);
    let errors: Vec<f64> = errors.collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Returns the number of frames by which the sets of a swinging bulb are late: that with the least mean tracking error.
fn lag(maps: &[EnvMap], sets: &[Newest]) -> usize {
    let grid = TexelGrid::new(&maps[0], Domain::Hemisphere);
    let late_by = |late: usize| -> f64 {
        let frames = SETTLED..maps.len();
        let errors = frames.map(|frame| {
            let set = &sets[frame + 1 - EXPOSURES].set;
            tracking_error_deg(&grid, &maps[frame - late], set, swing(frame - late)).expect("a bulb")
        });
        errors.sum()
    };
    let errors: Vec<f64> = (0..6).map(late_by).collect();
    (0..6).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).expect("a lag")
}

#[test]
fn a_swinging_bulb_and_a_walker_are_followed_one_frame_late_and_better_than_by_bursts() {
    let swinging: Vec<_> = (0..69).map(|frame| lit_from(swing(frame))).collect();
    let walking: Vec<_> = (0..60).map(walk).collect();
    for (name, maps, is_bulb) in [("bulb", &swinging, true), ("walker", &walking, false)] {
        let [bursts, frames] =
            [WindowMode::Burst, WindowMode::Sliding].map(|window| sets(maps, window, |_, _| {}));
        let errors = [&bursts, &frames].map(|sets| error(maps, sets));
        eprintln!("{name}: shadowed error of bursts and of frames {:.2?} %", errors.map(|e| 100.0 * e));
        // The figures of the README.
        let most = if is_bulb { [0.37, 0.05] } else { [0.043, 0.02] };
        assert!(errors[1] <= errors[0], "{name}: {errors:?}");
        let stated = errors.iter().zip(most).all(|(error, most)| (0.9 * most..most).contains(error));
        assert!(stated, "{name}: {errors:?}");
        let named = frames.iter().filter(|newest| !newest.left_out.is_empty()).count();
        assert!(named <= frames.len() / 20, "{name}: {named} frames named as false");
        if is_bulb {
            let lags = [&bursts, &frames].map(|sets| lag(maps, sets));
            eprintln!("{name}: bursts and frames are {lags:?} frames late");
            assert!(lags[1] <= 1 && lags[0] > lags[1], "{lags:?}");
        }
    }
}

#[test]
fn a_lamp_that_moves_between_two_frames_is_one_lamp_in_every_set() {
    let places = [at(35.0, -60.0), at(45.0, 70.0)];
    let maps: Vec<_> = (0..45).map(|frame| lit_from(places[frame / 5 % 2])).collect();
    let (lamp, all) = (energy(&interior()), energy(&maps[0]));
    for (t, newest) in sets(&maps, WindowMode::Sliding, |_, _| {}).iter().enumerate() {
        let at_place = |place: &[f64; 3]| {
            let lights = newest.set.lights.iter().filter(|l| bulb(*place).distance_deg(l.direction) < 6.0);
            lights.map(|l| luminance(l.irradiance)).sum::<f64>() / lamp
        };
        let shares = places.each_ref().map(at_place);
        let count = shares.iter().filter(|share| **share > 0.5).count();
        assert!(count == 1 && (shares[0] - shares[1]).abs() > 0.8, "set {t}: {shares:?}");
        assert!((newest.flux / all - 1.0).abs() < 0.05, "set {t}: {} of {all}", newest.flux);
    }
}

#[test]
fn all_light_that_changes_is_followed_within_one_round_of_the_exposures() {
    for factor in [0.25, 4.0] {
        let scaled = |frame| {
            let map = interior();
            let by = if frame < 21 { 1.0f32.max(1.0 / factor) } else { factor.max(1.0) };
            EnvMap::new(192, 96, map.texels().iter().map(|rgb| rgb.map(|v| v * by)).collect())
        };
        let maps: Vec<_> = (0..33).map(scaled).collect();
        for turn in 0..EXPOSURES {
            let maps = &maps[turn..];
            let found = sets(maps, WindowMode::Sliding, |_, _| {});
            let expected: Vec<f64> = maps.iter().skip(EXPOSURES - 1).map(energy).collect();
            let change = 21 - turn + 1 - EXPOSURES;
            let late = (change..found.len()).rfind(|t| (found[*t].flux / expected[*t] - 1.0).abs() > 0.03);
            let late = late.map_or(0, |t| t + 1 - change);
            eprintln!("light times {factor}, exposure {} first: {late} sets late", (21 - turn) % EXPOSURES);
            assert!(late <= EXPOSURES, "light times {factor}, turn {turn}: {late} sets late");
        }
    }
}

#[test]
fn false_frames_are_named_once_and_leave_the_light_as_it_was() {
    let maps: Vec<_> = (0..60).map(|_| lit_from(at(35.0, 20.0))).collect();
    let expected = energy(&maps[0]);
    let false_frames = [24, 34, 47];
    let blacken = |frame: usize, taken: &mut Frame| {
        if false_frames.contains(&frame)
            && let Pixels::U16(codes) = &mut taken.pixels
        {
            codes.fill(0);
        }
    };
    for (t, newest) in sets(&maps, WindowMode::Sliding, blacken).iter().enumerate() {
        let frame = t + EXPOSURES - 1;
        let named: Vec<_> = newest.left_out.iter().map(|f| f.index).collect();
        let due = false_frames.contains(&frame).then_some(frame % EXPOSURES);
        assert_eq!(named, due.into_iter().collect::<Vec<_>>(), "frame {frame}");
        assert!((newest.flux / expected - 1.0).abs() < 0.02, "frame {frame}: {} of {expected}", newest.flux);
    }
}

#[test]
fn sets_of_a_still_scene_have_the_light_of_its_bursts_within_a_thousandth() {
    let maps: Vec<_> = (0..30).map(|_| lit_from(at(35.0, 20.0))).collect();
    let mean = |window| {
        let found = sets(&maps, window, |_, _| {});
        found.iter().map(|newest| newest.flux).sum::<f64>() / found.len() as f64
    };
    let [bursts, frames] = [WindowMode::Burst, WindowMode::Sliding].map(mean);
    eprintln!("still: {frames} in place of {bursts}");
    assert!((frames / bursts - 1.0).abs() < 1e-3, "{frames}, expected {bursts}");
}
