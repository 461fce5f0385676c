//! Degradation with frame times given by a formula, at ten bursts a second of simulated time.

use super::*;
use crate::pipeline::WindowMode;
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
    now: Duration,
    within: Vec<bool>,
    levels: Vec<usize>,
    /// Times of the steps, without those in `returns`.
    steps: Vec<Duration>,
    /// Times of the steps down that end a failed trial: within [`TRIAL_FRAMES`] frames of the step up.
    returns: Vec<Duration>,
    /// Number of the frame before the last step, if that was a step up.
    trial: Option<u32>,
}

impl Run {
    fn new() -> Self {
        let ladder = Ladder::new(&Settings::default(), 3);
        let (within, levels, steps, returns) = (vec![], vec![], vec![], vec![]);
        Self { ladder, frame: 0, now: Duration::ZERO, within, levels, steps, returns, trial: None }
    }

    /// Runs `frames` frames; `noise` is the largest relative deviation of a frame's time.
    fn go(&mut self, frames: u32, slowdown: f32, noise: f32) {
        for _ in 0..frames {
            self.frame += 1;
            let random = (self.frame.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
            let (quality, level) = (*self.ladder.quality(), self.ladder.level);
            let us = (cost(&quality, slowdown) * (1.0 + noise * (2.0 * random - 1.0))) as u32;
            self.now += Duration::from_millis(100) * quality.every;
            self.within.push(us <= BUDGET_US * quality.every);
            if self.ladder.add(FrameTime { us, budget_us: BUDGET_US, now: self.now }) {
                let is_up = self.ladder.level < level;
                let is_return = !is_up && self.trial.is_some_and(|began| self.frame - began <= TRIAL_FRAMES);
                self.trial = is_up.then_some(self.frame);
                if is_return { self.returns.push(self.now) } else { self.steps.push(self.now) }
            }
            self.levels.push(self.ladder.level);
        }
    }

    /// Returns the largest number of steps within a minute that begins after `start`.
    fn steps_a_minute(&self, start: Duration) -> usize {
        let within = |from: Duration| {
            self.steps.iter().filter(|at| (from..from + Duration::from_secs(60)).contains(at)).count()
        };
        self.steps.iter().filter(|at| **at > start).map(|at| within(*at)).max().unwrap_or(0)
    }
}

#[test]
fn steps_come_in_the_documented_order_one_at_a_time() {
    let levels = plan::levels(&Settings::default(), 3);
    let names: Vec<_> = levels.iter().map(|level| level.steps.names().collect::<Vec<_>>()).collect();
    let expected = ["exposures", "order", "order", "lights", "rate", "rate", "rate", "lights", "lights"];
    for (level, names) in names.iter().enumerate() {
        let (mut found, mut expected) = (names.clone(), expected[..level].to_vec());
        found.sort_unstable();
        expected.sort_unstable();
        assert_eq!(found, expected, "level {level}");
    }
    assert_eq!(levels.len(), expected.len() + 1);
    let last = levels.last().expect("levels");
    assert_eq!((last.exposures, last.order, last.lights, last.every), (2, 4, 8, 8));
    assert_eq!(last.steps.count(Step::Lights), 3);
}

#[test]
fn settings_at_the_limit_of_a_step_have_no_level_of_it() {
    let settings = Settings { lights: 4, order: Some(4), ..Settings::default() };
    let levels = plan::levels(&settings, 1);
    assert_eq!(levels.iter().map(|level| level.every).collect::<Vec<_>>(), [1, 2, 4, 8], "the rate alone");
}

#[test]
fn a_sliding_window_has_no_level_with_fewer_exposures() {
    let settings = Settings { window: WindowMode::Sliding, lights: 4, order: Some(4), ..Settings::default() };
    let levels = plan::levels(&settings, 3);
    assert!(levels.iter().all(|level| level.exposures == 3), "{levels:?}");
    assert_eq!(levels.iter().map(|level| level.every).collect::<Vec<_>>(), [1, 2, 4, 8]);
}

#[test]
fn ten_frames_after_a_slowdown_ninety_nine_of_a_hundred_are_within_the_budget() {
    for slowdown in [1.0, 2.0, 4.0, 8.0, 16.0] {
        let mut run = Run::new();
        run.go(50, 1.0, 0.02);
        assert_eq!(run.steps, [], "nothing to do");
        run.go(6_000, slowdown, 0.02);
        let late = &run.within[60..];
        let share = late.iter().filter(|within| **within).count() as f32 / late.len() as f32;
        assert!(share >= 0.99, "slowdown {slowdown}: {share} of the frames");
        assert_eq!(run.levels[60], run.levels[61], "settled after ten frames");
    }
}

#[test]
fn a_steady_load_makes_at_most_one_step_or_failed_trial_a_minute() {
    for (slowdown, noise) in (10..180).flat_map(|tenths| [0.03, 0.1].map(|n| (tenths as f32 / 10.0, n))) {
        let mut run = Run::new();
        run.go(20, slowdown, noise);
        let settled = run.now;
        while run.now < Duration::from_secs(3600) {
            run.go(1, slowdown, noise);
        }
        let most = run.steps_a_minute(settled);
        assert!(most <= 1, "slowdown {slowdown}, noise {noise}: {most} steps in a minute: {:?}", run.steps);
        let steps = run.steps.iter().filter(|at| **at > settled).count();
        assert!(steps <= 8, "slowdown {slowdown}, noise {noise}: {steps} steps in an hour");
        assert!(run.returns.len() <= 6, "slowdown {slowdown}, noise {noise}: {:?}", run.returns);
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
