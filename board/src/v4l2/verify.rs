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

/// Range of relative codes that are compared: noise and the black level dominate below it, tone compression begins above it.
const TRUSTED: std::ops::Range<f32> = 0.05..0.93;

/// Least number of compared samples, of the 3,072 samples of a frame: fewer samples may all lie on a moving
/// object.
const ENOUGH: usize = 48;

/// Largest distance of two frames that are compared, in frames: light and objects move in the meantime.
const NEIGHBOURS: u32 = 4;

/// Largest distance, in frames, of a frame from an older certain frame with which it is also compared.
const REACH: u32 = 6;

/// Number of stored frames whose exposure is certain.
const ANCHORS: usize = 2;

/// Number of stored comparisons, and least number of contradictions among them from which on another control delay
/// is searched.
const REMEMBERED: usize = 12;
const DISAGREEING: usize = 4;

/// Number of contradictions among the stored comparisons from which on no frame counts as certain.
const DISPUTED: usize = 3;

/// Response and levels of a camera's codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeCurve {
    /// Camera response from codes to relative exposure.
    pub response: Response,
    /// Relative code of black, 0 to 1.
    pub black: f64,
    /// Relative code of a sample at relative exposure 1.
    pub white: f64,
}

/// Comparison of the brightness of each frame with that of the frame before.
#[derive(Debug)]
pub struct Verifier {
    levels: CodeCurve,
    measured: MeasuredRatios,
    before: Option<u32>,
    codes: Vec<f32>,
    ratios: Vec<f32>,
    seen: VecDeque<FramePair>,
    /// The newest frames with certain exposures. With equal steps between the exposures, a prediction that is wrong by one exposure
    /// leaves the ratio to the frame before unchanged; the ratio to an older frame reveals the error.
    anchors: VecDeque<Anchor>,
}

/// A frame whose exposure is certain, with which later frames are compared.
#[derive(Debug, Default)]
struct Anchor {
    sequence: u32,
    codes: Vec<f32>,
}

/// Ratio of the brightnesses of two frames.
#[derive(Clone, Copy, Debug)]
struct FramePair {
    /// Sequence number of the older frame.
    before: u32,
    /// Sequence number of the newer frame.
    after: u32,
    /// Natural logarithm of the brightness ratio of the newer frame to the older one.
    log_ratio: f64,
}

impl Verifier {
    /// Creates the comparison for a burst whose exposure times are `seconds`.
    #[must_use]
    pub fn new(levels: CodeCurve, seconds: &[f64]) -> Self {
        Self {
            levels,
            measured: MeasuredRatios::new(seconds),
            before: None,
            codes: Vec::new(),
            ratios: Vec::new(),
            seen: VecDeque::new(),
            anchors: VecDeque::new(),
        }
    }

    /// Compares frame `sequence`, whose brightness samples are `codes`, with the frame before; stores `codes` and returns
    /// the older samples in it.
    pub fn compare(&mut self, sequence: u32, codes: &mut Vec<f32>, schedule: &Schedule) -> Verdict {
        let near = self.before.filter(|b| sequence.wrapping_sub(*b) <= NEIGHBOURS);
        let ratio = near.and_then(|_| log_ratio(self.levels, &mut self.ratios, &self.codes, codes));
        if near.is_some() && schedule.exposure_of(sequence).is_none() {
            // The frame before stays stored: its exposure is predicted, and the next frame is compared with it.
            return Verdict::CannotTell;
        }
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
        let verdict = self.judge(seen, schedule, schedule.delay());
        if !matches!(verdict, Verdict::Agrees | Verdict::Measured) {
            return verdict;
        }
        if self.contradicts_anchor(before, sequence, schedule) {
            return Verdict::Differs;
        }
        if self.is_disputed(schedule) {
            return Verdict::Near;
        }
        self.anchor(sequence);
        verdict
    }

    /// Returns whether the ratio of frame `sequence` to the newest certain frame other than `before` contradicts the schedule.
    fn contradicts_anchor(&mut self, before: u32, sequence: u32, schedule: &Schedule) -> bool {
        let is_near = |a: &&Anchor| a.sequence != before && sequence.wrapping_sub(a.sequence) <= REACH;
        let Some(anchor) = self.anchors.iter().rev().find(is_near) else { return false };
        let ratio = log_ratio(self.levels, &mut self.ratios, &anchor.codes, &self.codes);
        let pair = ratio.map(|log_ratio| FramePair { before: anchor.sequence, after: sequence, log_ratio });
        pair.is_some_and(|pair| self.judge(pair, schedule, schedule.delay()) == Verdict::Differs)
    }

    /// Stores frame `sequence` and its brightness samples as a frame with a certain exposure.
    fn anchor(&mut self, sequence: u32) {
        let mut anchor =
            if self.anchors.len() < ANCHORS { None } else { self.anchors.pop_front() }.unwrap_or_default();
        anchor.sequence = sequence;
        anchor.codes.clone_from(&self.codes);
        self.anchors.push_back(anchor);
    }

    /// Returns the exposure times that were measured from the ratios.
    #[must_use]
    pub fn measured(&self) -> &MeasuredRatios {
        &self.measured
    }

    /// Returns the control delay that explains the recent ratios; `None` if the current delay does.
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
        self.anchors.clear();
        self.measured.forget();
        Some(best)
    }

    /// Returns whether several of the recent ratios contradict the schedule: another ratio may then agree by
    /// chance.
    fn is_disputed(&self, schedule: &Schedule) -> bool {
        let differs = |s: &&FramePair| self.judge(**s, schedule, schedule.delay()) == Verdict::Differs;
        self.seen.iter().filter(differs).count() >= DISPUTED
    }

    fn judge(&self, seen: FramePair, schedule: &Schedule, delay: u32) -> Verdict {
        let slots = (schedule.exposure_with(seen.before, delay), schedule.exposure_with(seen.after, delay));
        match slots {
            (Some(old), Some(new)) => self.measured.judge(old, new, seen.log_ratio),
            _ => Verdict::CannotTell,
        }
    }
}

/// Returns the natural logarithm of the median ratio of relative exposures, `newer` to `older`; `ratios` is working
/// memory.
fn log_ratio(levels: CodeCurve, ratios: &mut Vec<f32>, older: &[f32], newer: &[f32]) -> Option<f64> {
    let CodeCurve { response, black, white } = levels;
    let relative = |code: f32| ((f64::from(code) - black) / (white - black)) as f32;
    ratios.clear();
    for (old, new) in older.iter().zip(newer) {
        let (old, new) = (relative(*old), relative(*new));
        if TRUSTED.contains(&old) && TRUSTED.contains(&new) {
            let light = |x: f32| response.exposure(1, f64::from(x)) as f32;
            ratios.push(light(new) / light(old).max(1e-6));
        }
    }
    if ratios.len() < ENOUGH {
        return None;
    }
    let middle = ratios.len() / 2;
    let (_, median, _) = ratios.select_nth_unstable_by(middle, f32::total_cmp);
    Some(f64::from(median.max(1e-6)).ln())
}
