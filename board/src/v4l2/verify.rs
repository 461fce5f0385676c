//! Compares the exposure times that the schedule predicts with the brightness of neighbouring frames.
//!
//! Where two frames show the same light, the ratio of their relative exposures equals that of their exposure times. The median ratio over
//! the samples that are neither dark nor clipped in either frame is compared with the predicted ratio; within 10 % the frame is verified.
//! When ratios contradict the schedule repeatedly, the delay that explains them replaces the current one; when they deviate from the
//! control's values by a constant factor, [`MeasuredRatios`] adopts the factor.

use super::measured::{MeasuredRatios, Verdict};
use super::schedule::{MAX_DELAY, Schedule};
use hemilux_core::Response;
use std::collections::VecDeque;

/// Range of relative codes that are compared: below it noise and the black level dominate, above it cameras compress before they clip.
const TRUSTED: std::ops::Range<f32> = 0.05..0.93;

/// Least number of compared samples, of 3,072: fewer may all lie on a moving object.
const ENOUGH: usize = 48;

/// Largest distance of the two frames, in frames: light and objects move in the meantime.
const NEIGHBOURS: u32 = 4;

/// Number of stored comparisons, and how many of them must disagree before another delay is searched for.
const REMEMBERED: usize = 12;
const DISAGREEING: usize = 4;

/// Meaning of a camera's codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeCurve {
    /// Camera response from codes to relative exposure.
    pub response: Response,
    /// Relative code of black.
    pub black: f64,
    /// Relative code of relative exposure 1.
    pub white: f64,
}

/// Comparison of each frame with the frame before it.
#[derive(Debug)]
pub struct Verifier {
    levels: CodeCurve,
    measured: MeasuredRatios,
    before: Option<u32>,
    codes: Vec<f32>,
    ratios: Vec<f32>,
    seen: VecDeque<FramePair>,
}

/// Brightness ratio of two frames.
#[derive(Clone, Copy, Debug)]
struct FramePair {
    /// Sequence number of the older frame.
    before: u32,
    /// Sequence number of the newer frame.
    after: u32,
    /// Natural logarithm of the ratio of newer to older.
    log_ratio: f64,
}

impl Verifier {
    /// Creates a comparison for frames with exposures of `seconds`.
    #[must_use]
    pub fn new(levels: CodeCurve, seconds: &[f64]) -> Self {
        Self {
            levels,
            measured: MeasuredRatios::new(seconds),
            before: None,
            codes: Vec::new(),
            ratios: Vec::new(),
            seen: VecDeque::new(),
        }
    }

    /// Compares frame `sequence`, whose samples are `codes`, with the frame before; swaps the older samples into `codes`.
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

    /// The exposures as measured from the ratios.
    #[must_use]
    pub fn measured(&self) -> &MeasuredRatios {
        &self.measured
    }

    /// Returns the delay that explains the recent ratios, if the current delay does not.
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

    /// Returns the natural logarithm of the median ratio of relative exposures, newer to older.
    fn log_ratio(&mut self, codes: &[f32]) -> Option<f64> {
        let CodeCurve { response, black, white } = self.levels;
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
