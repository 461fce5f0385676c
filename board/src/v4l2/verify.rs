//! Whether exposures are what they are said to be: two neighbours' brightness where both see well.
//!
//! Where two frames show the same light, the ratio of their relative exposures is that of their times. Its median over the places that are neither
//! dark nor clipped in either frame is compared with what the schedule says; when it says otherwise again and again, the delay that
//! explains what is seen replaces the one that was believed.

use super::schedule::{MAX_DELAY, Schedule};
use hemilux_core::Response;
use std::collections::VecDeque;

/// Relative codes between which a sample is compared: below, noise and the black level weigh; above, cameras bend before they clip.
const TRUSTED: std::ops::Range<f32> = 0.05..0.93;

/// Fewest places that are compared, of 3,072: fewer may all lie on something that moves.
const ENOUGH: usize = 48;

/// Largest distance of the two frames, frames: light and things move.
const NEIGHBOURS: u32 = 4;

/// Part of the smallest step between two exposures, in logarithms, by which a ratio may be off. Half would be the border between
/// two explanations.
const TOLERANCE: f64 = 0.4;

/// Largest tolerance: a factor of 1.65, which covers a camera whose tone curve is only roughly known.
const LARGEST_TOLERANCE: f64 = 0.5;

/// Comparisons that are remembered, and how many of them must disagree before another delay is looked for.
const REMEMBERED: usize = 12;
const DISAGREEING: usize = 4;

/// What a comparison says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The ratio is that of the exposures.
    Agrees,
    /// It is not.
    Differs,
    /// Too few places are seen well in both.
    CannotTell,
}

/// What a camera's codes mean.
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
    log_s: Vec<f64>,
    tolerance: f64,
    before: Option<u32>,
    codes: Vec<f32>,
    ratios: Vec<f32>,
    seen: VecDeque<(u32, u32, f64)>,
}

impl Verifier {
    /// Compares frames of exposures of `seconds`.
    #[must_use]
    pub fn new(levels: Levels, seconds: &[f64]) -> Self {
        let log_s: Vec<f64> = seconds.iter().map(|s| s.ln()).collect();
        let gaps = log_s.windows(2).map(|w| (w[1] - w[0]).abs());
        let tolerance = (TOLERANCE * gaps.fold(f64::INFINITY, f64::min)).min(LARGEST_TOLERANCE);
        Self {
            levels,
            log_s,
            tolerance,
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
        self.seen.push_back((before, sequence, ratio));
        self.judge((before, sequence, ratio), schedule, schedule.delay())
    }

    /// The delay that explains what was seen lately, if the believed one does not.
    pub fn better_delay(&mut self, schedule: &Schedule) -> Option<u32> {
        let count =
            |delay, verdict| self.seen.iter().filter(|s| self.judge(**s, schedule, delay) == verdict).count();
        if count(schedule.delay(), Verdict::Differs) < DISAGREEING {
            return None;
        }
        let best = (0..=MAX_DELAY).max_by_key(|d| (count(*d, Verdict::Agrees), MAX_DELAY - d))?;
        let explains = 4 * count(best, Verdict::Agrees) >= 3 * self.seen.len();
        if best == schedule.delay() || !explains {
            return None;
        }
        self.seen.clear();
        Some(best)
    }

    fn judge(&self, (before, after, ratio): (u32, u32, f64), schedule: &Schedule, delay: u32) -> Verdict {
        let log = |sequence| self.log_s.get(schedule.exposure_with(sequence, delay)?).copied();
        match (log(before), log(after)) {
            (Some(b), Some(a)) if (ratio - (a - b)).abs() <= self.tolerance => Verdict::Agrees,
            (Some(_), Some(_)) => Verdict::Differs,
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
