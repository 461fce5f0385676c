//! Compares the exposure times that the schedule predicts with the brightness of neighbouring frames.
//!
//! Where two frames show the same light, the ratio of their relative exposures is that of their times. Its median over the samples that are
//! neither dark nor clipped in either frame is compared with the predicted ratio. A ratio within 10 % verifies the frame. When ratios
//! contradict the schedule repeatedly, the delay that explains them replaces the current one; when they stay apart from the control's
//! values at a constant factor, [`Measured`] takes the factor over.

use super::measured::{Measured, Verdict};
use super::schedule::{MAX_DELAY, Schedule};
use hemilux_core::Response;
use std::collections::VecDeque;

/// Relative codes between which a sample is compared: below, noise and the black level weigh; above, cameras bend before they clip.
const TRUSTED: std::ops::Range<f32> = 0.05..0.93;

/// Fewest places that are compared, of 3,072: fewer may all lie on something that moves.
const ENOUGH: usize = 48;

/// Largest distance of the two frames, frames: light and things move.
const NEIGHBOURS: u32 = 4;

/// Comparisons that are remembered, and how many of them must disagree before another delay is looked for.
const REMEMBERED: usize = 12;
const DISAGREEING: usize = 4;

/// The meaning of the codes of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    /// The curve.
    pub response: Response,
    /// Relative code of darkness.
    pub black: f64,
    /// Relative code of relative exposure 1.
    pub white: f64,
}

/// Compares each frame with the one before it.
#[derive(Debug)]
pub struct Verifier {
    levels: Levels,
    measured: Measured,
    before: Option<u32>,
    codes: Vec<f32>,
    ratios: Vec<f32>,
    seen: VecDeque<FramePair>,
}

/// The brightness ratio of two frames.
#[derive(Clone, Copy, Debug)]
struct FramePair {
    /// Sequence number of the older frame.
    before: u32,
    /// Sequence number of the newer frame.
    after: u32,
    /// Natural logarithm of the ratio, newer to older.
    log_ratio: f64,
}

impl Verifier {
    /// Compares frames of exposures of `seconds`.
    #[must_use]
    pub fn new(levels: Levels, seconds: &[f64]) -> Self {
        Self {
            levels,
            measured: Measured::new(seconds),
            before: None,
            codes: Vec::new(),
            ratios: Vec::new(),
            seen: VecDeque::new(),
        }
    }

    /// Compares frame `sequence`, whose samples are `codes`, with the one before; `codes` gets the old samples' memory.
    pub fn compare(&mut self, sequence: u32, codes: &mut Vec<f32>, schedule: &Schedule) -> Verdict {
        let near = self.before.filter(|b| sequence.wrapping_sub(*b) <= NEIGHBOURS);
        let ratio = near.and_then(|_| self.log_ratio(codes));
        std::mem::swap(&mut self.codes, codes);
        let before = self.before.replace(sequence);
        let (Some(before), Some(ratio)) = (before, ratio) else { return Verdict::CannotTell };
        if self.seen.len() == REMEMBERED {
            self.seen.pop_front();
        }
        let seen = FramePair { before, after: sequence, log_ratio: ratio };
        self.seen.push_back(seen);
        if let (Some(old), Some(new)) = (schedule.exposure_of(before), schedule.exposure_of(sequence)) {
            self.measured.note(old, new, ratio);
        }
        self.judge(seen, schedule, schedule.delay())
    }

    /// The exposures as they were measured.
    #[must_use]
    pub fn measured(&self) -> &Measured {
        &self.measured
    }

    /// The delay that explains what was seen lately, if the current one does not.
    pub fn better_delay(&mut self, schedule: &Schedule) -> Option<u32> {
        let count = |delay: u32, counted: &dyn Fn(Verdict) -> bool| {
            self.seen.iter().filter(|s| counted(self.judge(**s, schedule, delay))).count()
        };
        let explained = |delay| count(delay, &|v| !matches!(v, Verdict::Differs | Verdict::CannotTell));
        if count(schedule.delay(), &|v| v == Verdict::Differs) < DISAGREEING {
            return None;
        }
        let best = (0..=MAX_DELAY).max_by_key(|d| (explained(*d), MAX_DELAY - d))?;
        if best == schedule.delay() || 4 * explained(best) < 3 * self.seen.len() {
            return None;
        }
        self.seen.clear();
        self.measured.forget();
        Some(best)
    }

    fn judge(&self, seen: FramePair, schedule: &Schedule, delay: u32) -> Verdict {
        let slots = (schedule.exposure_with(seen.before, delay), schedule.exposure_with(seen.after, delay));
        match slots {
            (Some(old), Some(new)) => self.measured.judge(old, new, seen.log_ratio),
            _ => Verdict::CannotTell,
        }
    }

    /// Logarithm of the median ratio of relative exposures, new to old.
    fn log_ratio(&mut self, codes: &[f32]) -> Option<f64> {
        let Levels { response, black, white } = self.levels;
        let relative = |code: f32| ((f64::from(code) - black) / (white - black)) as f32;
        self.ratios.clear();
        for (old, new) in self.codes.iter().zip(codes) {
            let (old, new) = (relative(*old), relative(*new));
            if TRUSTED.contains(&old) && TRUSTED.contains(&new) {
                let light = |x: f32| response.exposure(1, f64::from(x)) as f32;
                self.ratios.push(light(new) / light(old).max(1e-6));
            }
        }
        if self.ratios.len() < ENOUGH {
            return None;
        }
        let middle = self.ratios.len() / 2;
        let (_, median, _) = self.ratios.select_nth_unstable_by(middle, f32::total_cmp);
        Some(f64::from(median.max(1e-6)).ln())
    }
}
