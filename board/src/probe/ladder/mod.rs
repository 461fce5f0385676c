//! Degradation: where frames take longer than the budget of `total`, the quality is lowered step by step; it is raised again where the predicted
//! cost of the richer level fits the budget.
//!
//! The order of the steps is that of [`plan`]. The first step down follows [`PATIENCE`] consecutive frames over
//! the budget, a further one each frame over the budget. When a level is left for a poorer one, the ratio of their costs is stored; the richer
//! level is tried again if this ratio times the present cost is within [`ROOM`] of the budget and the hold time since the last step has passed.
//! After [`TRIAL_FRAMES`] frames, the richer level stays if its mean cost is within [`PASSED`] of the budget. The hold time doubles with each
//! failed trial. The budget of a frame is that of all bursts since the frame before: where every second burst is
//! processed, twice that of one burst.

mod plan;
#[cfg(test)]
mod tests;

pub use plan::Quality;

use crate::pipeline::Settings;
use std::time::Duration;

/// Number of consecutive frames over the budget before the first step down.
const PATIENCE: u32 = 3;

/// Share of the budget, 0 to 1, that the predicted cost of a better level may reach for a step up.
const ROOM: f32 = 0.8;

/// Number of frames after which a step up is judged by the mean cost.
const TRIAL_FRAMES: u32 = 10;

/// Share of the budget that the mean cost of a richer level may have after [`TRIAL_FRAMES`]: above [`ROOM`], since the cost is measured, and
/// below 1, so that the level is not left again by the noise of a steady load.
const PASSED: f32 = 0.9;

/// Least time from a step to the next one up.
const HOLD: Duration = Duration::from_secs(10);

/// Least time from a step of the quality to the next step up after the first failed trial; it doubles with each further failure.
const HOLD_AFTER_FAILURE: Duration = Duration::from_secs(150);

/// Longest hold time from a step of the quality to the next step up.
const LONGEST_HOLD: Duration = Duration::from_secs(3600);

/// Time within which a step down after a step up counts as a failed trial.
const TRIAL: Duration = Duration::from_secs(60);

/// Interval at which a stored cost ratio moves towards 1, and the factor by which its distance from 1 shrinks: a ratio that was measured
/// under a load of other programs decays.
const FORGET: (Duration, f32) = (Duration::from_secs(60), 0.9);

/// Number of frames after a step down within which one frame over the budget suffices for the next step down.
const DESCENT: u32 = 3;

/// Weight of the newest frame in the smoothed cost of a level, 0 to 1.
const NEWEST: f32 = 0.2;

/// The time that one frame took, and its budget.
#[derive(Clone, Copy, Debug)]
pub struct FrameTime {
    /// Time from the end of the burst to the finished light set, microseconds.
    pub us: u32,
    /// Time budget of a frame at the full rate, microseconds.
    pub budget_us: u32,
    /// Time from the start of the probe to the finished light set.
    pub now: Duration,
}

/// The present level of the quality, and the measured costs of all levels.
#[derive(Clone, Debug)]
pub struct Ladder {
    levels: Vec<Quality>,
    level: usize,
    /// Cost of each level divided by the cost of the next poorer level, as measured when the level was left last.
    ratios: Vec<f32>,
    /// Smoothed time of a frame at the present level, microseconds; 0 before the level's first frame.
    cost_us: f32,
    /// Cost of the better level that the last step left, microseconds; `None` once the ratio of the costs is measured.
    left_us: Option<f32>,
    /// Number of consecutive frames over the budget.
    misses: u32,
    /// Number of frames since the last step of the quality.
    frames: u32,
    stepped_at: Duration,
    forgot_at: Duration,
    went_up: bool,
    failures: u32,
    down: u64,
    up: u64,
}

impl Ladder {
    /// Creates the levels for `settings` with bursts of `exposures` exposures, at full quality.
    #[must_use]
    pub fn new(settings: &Settings, exposures: usize) -> Self {
        let levels = plan::levels(settings, exposures);
        let ratios = vec![1.0; levels.len()];
        Self {
            levels,
            level: 0,
            ratios,
            cost_us: 0.0,
            left_us: None,
            misses: 0,
            frames: u32::MAX,
            stepped_at: Duration::ZERO,
            forgot_at: Duration::ZERO,
            went_up: false,
            failures: 0,
            down: 0,
            up: 0,
        }
    }

    /// Returns to the full quality of other settings; the counts of steps stay.
    pub fn reset(&mut self, settings: &Settings, exposures: usize) {
        let (down, up) = (self.down, self.up);
        *self = Self { down, up, ..Self::new(settings, exposures) };
    }

    /// Returns the number of exposures per burst for which the levels are made.
    #[must_use]
    pub fn exposures(&self) -> usize {
        self.levels[0].exposures
    }

    /// Returns the quality of the next frame.
    #[must_use]
    pub fn quality(&self) -> &Quality {
        &self.levels[self.level]
    }

    /// Returns the numbers of steps down and of steps up since the start of the probe.
    #[must_use]
    pub fn steps(&self) -> [u64; 2] {
        [self.down, self.up]
    }

    /// Adds the duration of a frame; returns true if the quality changes with the next frame.
    pub fn add(&mut self, frame: FrameTime) -> bool {
        self.frames = self.frames.saturating_add(1);
        self.learn(frame.us as f32);
        let is_over = frame.us > self.quality().budget_us(frame.budget_us);
        self.misses = if is_over { self.misses + 1 } else { 0 };
        let patience = if self.is_descending() { 1 } else { PATIENCE };
        if self.misses >= patience || self.has_failed(&frame) {
            return self.step_down(frame.now);
        }
        self.forget(frame.now);
        !is_over && self.has_room(&frame) && self.step_up(frame.now)
    }

    fn is_descending(&self) -> bool {
        self.level > 0 && !self.went_up && self.frames <= DESCENT
    }

    /// Updates the cost of the present level, and the ratio of the previous level's cost to the present level's cost.
    fn learn(&mut self, us: f32) {
        self.cost_us = if self.cost_us > 0.0 { self.cost_us + NEWEST * (us - self.cost_us) } else { us };
        if let Some(left_us) = self.left_us {
            self.ratios[self.level - 1] = (left_us / self.cost_us.max(1.0)).max(1.0);
            if self.frames > DESCENT {
                self.left_us = None;
            }
        }
    }

    fn forget(&mut self, now: Duration) {
        if now.saturating_sub(self.forgot_at) >= FORGET.0 {
            self.forgot_at = now;
            self.ratios.iter_mut().for_each(|ratio| *ratio = 1.0 + FORGET.1 * (*ratio - 1.0));
        }
    }

    fn has_room(&self, frame: &FrameTime) -> bool {
        let Some(richer) = self.level.checked_sub(1) else { return false };
        let predicted = self.cost_us * self.ratios[richer];
        let since = frame.now.saturating_sub(self.stepped_at);
        let budget_us = self.levels[richer].budget_us(frame.budget_us);
        self.frames > DESCENT && since >= self.hold() && predicted <= ROOM * budget_us as f32
    }

    /// Returns true if `frame` is the last of a trial whose mean cost is too high.
    fn has_failed(&self, frame: &FrameTime) -> bool {
        let most_us = PASSED * self.quality().budget_us(frame.budget_us) as f32;
        self.went_up && self.frames == TRIAL_FRAMES && self.cost_us > most_us
    }

    fn hold(&self) -> Duration {
        let Some(doublings) = self.failures.checked_sub(1) else { return HOLD };
        HOLD_AFTER_FAILURE.saturating_mul(1 << doublings.min(6)).min(LONGEST_HOLD)
    }

    fn step_down(&mut self, now: Duration) -> bool {
        self.misses = 0;
        if self.level + 1 >= self.levels.len() {
            return false;
        }
        if self.went_up {
            let failed = now.saturating_sub(self.stepped_at) < TRIAL;
            self.failures = if failed { self.failures + 1 } else { 0 };
        }
        self.left_us = Some(self.cost_us);
        self.level += 1;
        self.down += 1;
        self.stepped(now, false);
        true
    }

    fn step_up(&mut self, now: Duration) -> bool {
        self.left_us = None;
        self.level -= 1;
        self.up += 1;
        self.stepped(now, true);
        true
    }

    fn stepped(&mut self, now: Duration, went_up: bool) {
        (self.cost_us, self.frames) = (0.0, 0);
        (self.stepped_at, self.forgot_at, self.went_up) = (now, now, went_up);
    }
}
