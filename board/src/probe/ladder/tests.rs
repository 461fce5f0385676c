//! Degradation with frame times given by a formula, at ten frames a second of simulated time.

use super::*;
use hemilux_core::wire::Step;

const BUDGET_US: u32 = 60_000;

/// Returns the time of a frame, microseconds: four fifths of the budget at full quality, times `slowdown`.
fn cost(quality: &Quality, slowdown: f32) -> f32 {
    let part = |value: f32, of: f32| value / of;
    let front = 0.55 * part(quality.exposures as f32, 3.0);
    let map = 0.25 * 0.25f32.powi(6 - i32::from(quality.order));
    let lights = 0.2 * part(quality.lights as f32, 64.0);
    0.8 * BUDGET_US as f32 * slowdown * (front + map + lights)
}

struct Run {
    ladder: Ladder,
    frame: u32,
    within: Vec<bool>,
    levels: Vec<usize>,
}

impl Run {
    fn new() -> Self {
        Self { ladder: Ladder::new(&Settings::default(), 3), frame: 0, within: vec![], levels: vec![] }
    }

    /// Runs `frames` frames; `noise` is the largest relative deviation of a frame's time.
    fn go(&mut self, frames: u32, slowdown: f32, noise: f32) {
        for _ in 0..frames {
            self.frame += 1;
            let random = (self.frame.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
            let us = cost(self.ladder.quality(), slowdown) * (1.0 + noise * (2.0 * random - 1.0));
            let now = Duration::from_millis(100) * self.frame;
            self.within.push(us <= BUDGET_US as f32);
            self.ladder.add(FrameTime { us: us as u32, budget_us: BUDGET_US, now });
            self.levels.push(self.ladder.level);
        }
    }

    fn changes(&self) -> usize {
        self.levels.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }
}

#[test]
fn steps_come_in_the_documented_order_one_at_a_time() {
    let levels = plan::levels(&Settings::default(), 3);
    let names: Vec<_> = levels.iter().map(|level| level.steps.names().collect::<Vec<_>>()).collect();
    let expected = ["exposures", "order", "order", "lights", "lights", "lights", "rate", "rate"];
    for (level, names) in names.iter().enumerate() {
        assert_eq!(names.as_slice(), &expected[..level], "level {level}");
    }
    assert_eq!(levels.len(), expected.len() + 1);
    let last = levels.last().expect("levels");
    assert_eq!((last.exposures, last.order, last.lights, last.every), (2, 4, 8, 4));
    assert_eq!(last.steps.count(Step::Lights), 3);
}

#[test]
fn settings_at_the_limit_of_a_step_have_no_level_of_it() {
    let settings = Settings { lights: 4, order: Some(4), ..Settings::default() };
    let levels = plan::levels(&settings, 1);
    assert_eq!(levels.iter().map(|level| level.every).collect::<Vec<_>>(), [1, 2, 4], "the rate alone");
}

#[test]
fn ten_frames_after_a_slowdown_ninety_nine_of_a_hundred_are_within_the_budget() {
    for slowdown in [1.0, 2.0, 3.0] {
        let mut run = Run::new();
        run.go(50, 1.0, 0.02);
        assert_eq!(run.changes(), 0, "nothing to do");
        run.go(6_000, slowdown, 0.02);
        let late = &run.within[60..];
        let share = late.iter().filter(|within| **within).count() as f32 / late.len() as f32;
        assert!(share >= 0.99, "slowdown {slowdown}: {share} of the frames");
        assert_eq!(run.levels[60], run.levels[61], "settled after ten frames");
    }
}

#[test]
fn a_steady_load_makes_at_most_one_step_a_minute() {
    for slowdown in (10..60).map(|tenths| tenths as f32 / 10.0) {
        let mut run = Run::new();
        run.go(36_000, slowdown, 0.1);
        let settled = &run.levels[20..];
        for (minute, levels) in settled.chunks(600).enumerate() {
            let steps: usize = levels.windows(2).map(|pair| pair[0].abs_diff(pair[1])).sum();
            assert!(steps <= 2, "slowdown {slowdown}, minute {minute}: {steps} steps");
        }
        let steps: usize = settled.windows(2).map(|pair| pair[0].abs_diff(pair[1])).sum();
        assert!(steps <= 20, "slowdown {slowdown}: {steps} steps in an hour");
    }
}

#[test]
fn the_full_quality_is_back_two_minutes_after_the_load_has_gone() {
    let mut run = Run::new();
    run.go(600, 3.0, 0.05);
    assert!(run.ladder.level > 0, "degraded");
    run.go(1_200, 1.0, 0.05);
    assert_eq!(run.ladder.quality().steps, hemilux_core::wire::Degraded::NONE, "{:?}", run.ladder);
}

#[test]
fn single_slow_frames_do_not_lower_the_quality() {
    let mut run = Run::new();
    for _ in 0..100 {
        run.go(20, 1.0, 0.0);
        run.go(2, 5.0, 0.0);
    }
    assert_eq!(run.ladder.steps(), [0, 0]);
}

#[test]
fn a_ratio_measured_under_a_transient_load_decays() {
    let mut run = Run::new();
    run.go(10, 1.0, 0.0);
    // The load ends with the first step: the measured ratio is ten times too large.
    run.go(3, 10.0, 0.0);
    assert_eq!(run.ladder.steps(), [1, 0]);
    run.go(36_000, 0.5, 0.0);
    assert!(run.ladder.quality().steps.is_none(), "{:?}", run.ladder);
}
