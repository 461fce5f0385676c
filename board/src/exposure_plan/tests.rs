//! Plans of exposures, compared with a search over all sets of times, and applied to a simulated camera in changing light.

use super::cover::RadianceShare;
use super::*;
use crate::calibration::{Frame, Pixels};
use hemilux_core::{Exposure, Format, Lens, Levels};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const NOISE: Noise = Noise { read: 0.7, gain: 0.025, dark: 8.0 };
const RANGE: TimeRange = TimeRange { shortest_s: 3e-5, longest_s: 0.033, step_s: 0.0 };
const WHITE: f64 = 255.0;

fn calibration() -> Calibration {
    let lens = Lens::equidistant([31.5, 23.5], 19.6, 1.4).expect("a lens");
    let mut calibration = Calibration::try_new(lens, Format::Rgb24, WIDTH, HEIGHT).expect("a size");
    calibration.levels = Levels { black: NOISE.dark, white: WHITE };
    calibration
}

fn limits() -> Limits {
    Limits::of(&calibration(), &NOISE)
}

/// Generator of pseudo-random numbers from 0 to 1: the generator MMIX of \[Knuth1997\].
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as f64 / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A simulated camera in a room with a dark wall, a bright wall and a window; `light` scales all radiances.
struct RoomCamera {
    random: Random,
    times: Vec<f64>,
    planner: Planner,
}

/// Properties of a burst of the simulated camera.
struct BurstResult {
    /// Fraction of the pixels that are saturated in the shortest exposure, 0 to 1.
    clipped: f64,
    /// Number of exposures of the burst.
    exposures: usize,
    has_changed: bool,
}

impl RoomCamera {
    fn new(times: &[f64]) -> Self {
        let planner = Planner::new(&calibration(), RANGE, &NOISE).expect("a response");
        Self { random: Random(1), times: times.to_vec(), planner }
    }

    /// Returns the radiance of the room at a pixel, relative exposure per second: the brightest is six octaves above the darkest.
    fn radiance(x: u32, y: u32) -> f64 {
        match (x / 8, y / 8) {
            (2..=3, 2..=3) => 640.0,
            (4.., _) => 40.0,
            _ => 10.0,
        }
    }

    /// Takes a burst, with the light of each frame from `light`, and plans the next one.
    fn burst(&mut self, light: impl Fn(usize) -> f64) -> BurstResult {
        let codes = WHITE - NOISE.dark;
        let mut frame = |(i, seconds): (usize, &f64)| {
            let code = |at: u32| {
                let mean = Self::radiance(at % WIDTH, at / WIDTH) * light(i) * seconds * codes;
                let code = mean + NOISE.deviation(mean) * self.random.normal() + NOISE.dark;
                [code.round().clamp(0.0, WHITE) as u8; 3]
            };
            let bytes = (0..WIDTH * HEIGHT).flat_map(code).collect();
            Frame { exposure: Exposure { seconds: *seconds, gain: 1.0 }, pixels: Pixels::U8(bytes) }
        };
        let frames: Vec<_> = self.times.iter().enumerate().map(&mut frame).collect();
        let Pixels::U8(shortest) = &frames[0].pixels else { unreachable!("bytes") };
        let saturated = shortest.iter().filter(|code| f64::from(**code) >= NOISE.dark + 0.98 * codes).count();
        let clipped = saturated as f64 / shortest.len() as f64;
        let exposures = frames.len();
        let next = self.planner.next(&Burst { frames, ..Burst::default() }, clipped);
        let has_changed = next.is_some();
        self.times = next.unwrap_or_else(|| self.times.clone());
        BurstResult { clipped, exposures, has_changed }
    }
}

/// Returns the least number of exposures that cover `light`, by a search over all sets of times with steps of a quarter octave.
fn fewest(light: &[RadianceShare], limits: &Limits) -> usize {
    fn search(
        light: &[RadianceShare],
        limits: &Limits,
        grid: &[f64],
        times: &mut Vec<f64>,
        left: usize,
    ) -> bool {
        if is_covered(light, times, limits, &RANGE) {
            return true;
        }
        (0..grid.len()).any(|i| {
            left > 0 && {
                times.push(grid[i]);
                let found = search(light, limits, &grid[i + 1..], times, left - 1);
                times.pop();
                found
            }
        })
    }
    let octaves = (RANGE.longest_s / RANGE.shortest_s).log2();
    let steps = (4.0 * octaves).floor() as u32;
    let mut grid: Vec<_> = (0..=steps).map(|i| RANGE.shortest_s * (0.25 * f64::from(i)).exp2()).collect();
    grid.push(RANGE.longest_s);
    (1..=3).find(|n| search(light, limits, &grid, &mut Vec::new(), *n)).unwrap_or(4)
}

#[test]
fn plans_have_at_most_one_exposure_more_than_the_optimum() {
    let (mut random, limits) = (Random(3), limits());
    let mut counts = [0; 5];
    for case in 0..200 {
        let span = 2.0 + 16.0 * random.uniform();
        let bright = 4.0 + 12.0 * random.uniform();
        let n = 1 + (6.0 * random.uniform()) as usize;
        let mut radiances: Vec<_> = (0..n).map(|_| (bright - span * random.uniform()).exp2()).collect();
        radiances.sort_by(|a, b| b.total_cmp(a));
        let light: Vec<_> =
            radiances.iter().map(|r| RadianceShare { radiance: *r, share: 1.0 / n as f64 }).collect();
        let best = fewest(&light, &limits);
        counts[best] += 1;
        for (used, more) in [(limits, 0), (limits.narrowed(), 1)] {
            let plan = cover(&light, &used, &RANGE);
            assert!(is_covered(&light, &plan, &limits, &RANGE), "case {case}: {plan:?} of {light:?}");
            assert!(plan.len() <= best + more, "case {case}: {plan:?}, {best} are enough for {light:?}");
            assert!(plan.windows(2).all(|w| w[0] < w[1]), "{plan:?}");
        }
    }
    assert!(counts[1] > 10 && counts[2] > 10, "cases of one and of two exposures: {counts:?}");
}

#[test]
fn an_even_scene_needs_one_exposure_and_a_wide_one_more() {
    let limits = limits();
    let light = |all: &[f64]| -> Vec<RadianceShare> {
        all.iter().map(|r| RadianceShare { radiance: *r, share: 1.0 / all.len() as f64 }).collect()
    };
    let even = cover(&light(&[100.0, 90.0, 40.0]), &limits, &RANGE);
    assert_eq!(even.len(), 1, "{even:?}");
    // The brightest radiance is just below saturation.
    assert!((even[0] * 100.0 / limits.bright - 1.0).abs() < 1e-9, "{even:?}");
    let wide = cover(&light(&[30_000.0, 100.0, 3.0]), &limits, &RANGE);
    assert!(wide.len() >= 2, "{wide:?}");
    let sun = cover(&light(&[1e7, 100.0]), &limits, &RANGE);
    assert_eq!(sun.first(), Some(&RANGE.shortest_s), "brighter than the shortest time can hold: {sun:?}");
}

#[test]
fn a_change_of_light_is_settled_within_three_bursts() {
    for factor in [10.0, 100.0, 1000.0, 0.1, 0.01, 0.001] {
        for within in [false, true] {
            let mut camera = RoomCamera::new(&[0.001, 0.006, 0.033]);
            // The light is within the range that the camera can measure, before and after the change.
            let before = if factor > 1.0 { 0.04 } else { 40.0 };
            (0..6).for_each(|_| _ = camera.burst(|_| before));
            let first = camera.burst(|frame| if within && frame == 0 { before } else { before * factor });
            let rest: Vec<_> = (0..6).map(|_| camera.burst(|_| before * factor)).collect();
            let what = format!("factor {factor}, within {within}");
            assert!(
                first.has_changed || rest[0].has_changed || first.exposures > 1,
                "{what}: nothing changed"
            );
            // The third burst in the new light is the second of `rest`, or the third after a change within a burst.
            let settled = if within { 2 } else { 1 };
            for (i, shown) in rest.iter().enumerate().skip(settled) {
                assert!(shown.clipped <= 0.001, "{what}: {} clipped in burst {i}", shown.clipped);
                assert!(!shown.has_changed || i == settled, "{what}: changed again after burst {i}");
            }
            let last = rest.last().map_or(0, |shown| shown.exposures);
            let truth = [640.0, 40.0, 10.0]
                .map(|r| RadianceShare { radiance: r * before * factor, share: 1.0 / 3.0 });
            let best = fewest(&truth, &limits());
            assert!(last <= best + 1, "{what}: {last} exposures, {best} are enough");
        }
    }
}

#[test]
fn steady_noisy_light_changes_no_exposure_in_300_bursts() {
    for light in [0.01, 0.05, 0.3, 1.0, 1.7, 5.0, 33.0, 40.0] {
        let mut camera = RoomCamera::new(&[0.001, 0.006, 0.033]);
        (0..4).for_each(|_| _ = camera.burst(|_| light));
        let changes = (0..300).filter(|_| camera.burst(|_| light).has_changed).count();
        assert_eq!(changes, 0, "light {light}: {:?}", camera.times);
    }
}

#[test]
fn dusk_over_a_minute_clips_nothing_and_stays_covered() {
    let mut camera = RoomCamera::new(&[0.001, 0.006, 0.033]);
    let light = |i: i32| 40.0 * 10f64.powf(-3.0 * f64::from(i) / 600.0);
    (0..4).for_each(|_| _ = camera.burst(|_| light(0)));
    let mut changes = 0;
    for i in 0..600 {
        let shown = camera.burst(|_| light(i));
        changes += usize::from(shown.has_changed);
        assert!(shown.clipped <= 0.001, "{} clipped in burst {i}", shown.clipped);
    }
    assert!((1..60).contains(&changes), "{changes} changes");
}

#[test]
fn a_clipped_spot_between_the_sampled_pixels_stays_covered() {
    let mut planner = Planner::new(&calibration(), RANGE, &NOISE).expect("a response");
    let frame = |seconds: f64| Frame {
        exposure: Exposure { seconds, gain: 1.0 },
        pixels: Pixels::U8(vec![60; (3 * WIDTH * HEIGHT) as usize]),
    };
    let mut times = vec![0.01];
    let mut changes = 0;
    for i in 0..100 {
        let frames = times.iter().map(|t| frame(*t)).collect();
        // The spot is clipped while the shortest time is above 3 ms.
        let clipped = if times[0] > 0.003 { 1e-5 } else { 0.0 };
        if let Some(next) = planner.next(&Burst { frames, ..Burst::default() }, clipped) {
            (times, changes) = (next, changes + 1);
        }
        // The constant codes are another radiance in each burst, so the first bursts alone are checked.
        if i > 3 {
            assert!(times[0] <= 0.003, "{times:?}");
        }
    }
    assert!(changes > 0, "the spot was seen");
}
