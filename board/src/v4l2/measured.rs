//! Exposure times measured from brightness ratios, for cameras whose sensor does not use the value that the control reads back.
//!
//! Ratios do not determine a common factor of all exposures: the median of their deviations from the control's values is set
//! to zero.

use std::collections::VecDeque;

/// Largest deviation of a brightness ratio from the exposure ratio that it verifies, natural logarithm: 10 %.
const VERIFIED: f64 = 0.0953;

/// The result of comparing the brightness ratio of two frames with the expected ratio of their exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The brightness ratio is within 10 % of the ratio of the control's values.
    Agrees,
    /// The brightness ratio is within 10 % of the ratio of the measured exposures, which differ from the
    /// control's values.
    Measured,
    /// The brightness ratio distinguishes the exposures, but is not within 10 % of the expected ratio.
    Near,
    /// The brightness ratio contradicts the predicted exposures.
    Differs,
    /// Too few samples are well exposed in both frames.
    CannotTell,
}

/// Largest deviation of a brightness ratio from the expected ratio, as a fraction of the smallest logarithmic step between two exposures. At
/// one half, two exposures would match the ratio equally well.
const TOLERANCE: f64 = 0.4;

/// Upper limit of the deviation that [`TOLERANCE`] permits, natural logarithm: a factor of 1.65, for a camera whose tone curve is
/// only roughly known.
const LARGEST_TOLERANCE: f64 = 0.5;

/// Number of brightness ratios that are stored for each step from an exposure to the next.
const KEPT: usize = 8;

/// Largest spread of the stored ratios of a step, natural logarithm: flickering light and moving objects cause a larger
/// spread.
const SPREAD: f64 = 0.08;

/// Largest deviation of a step's measured ratio from the control's values, natural logarithm; a larger deviation is caused by a
/// wrong tone curve.
const LARGEST_DEVIATION: f64 = 1.0;

/// Least difference by which a newly measured exposure replaces the present value, natural logarithm.
const CHANGE: f64 = 0.03;

/// The exposures of a burst: the control's values and the measured ones.
#[derive(Clone, Debug)]
pub struct MeasuredRatios {
    /// Natural logarithms of the exposure times of the control's values, in seconds, ascending.
    told: Vec<f64>,
    /// Natural logarithms of the measured exposure times, in seconds; equal to `told` where they differ by less
    /// than 10 %.
    measured: Vec<f64>,
    /// The newest brightness ratios from each exposure to the next longer one, natural logarithms.
    steps: Vec<VecDeque<f64>>,
    /// Largest deviation of a brightness ratio that still distinguishes the exposures, natural logarithm.
    tolerance: f64,
    changes: u64,
}

impl MeasuredRatios {
    /// Creates the table of exposures from the exposure times of the control's values, `seconds`, ascending.
    #[must_use]
    pub fn new(seconds: &[f64]) -> Self {
        let told: Vec<f64> = seconds.iter().map(|s| s.ln()).collect();
        let steps = vec![VecDeque::with_capacity(KEPT); told.len().saturating_sub(1)];
        Self { tolerance: tolerance(&told), measured: told.clone(), told, steps, changes: 0 }
    }

    /// Returns the exposure time of `slot`, measured or else the control's, in seconds; `None` for a slot that
    /// does not exist.
    #[must_use]
    pub fn seconds(&self, slot: usize) -> Option<f64> {
        self.measured.get(slot).map(|log| log.exp())
    }

    /// Returns whether the measured time of exposure `slot` differs from the control's value by more than 10 %.
    #[must_use]
    pub fn deviates(&self, slot: usize) -> bool {
        self.measured.get(slot).zip(self.told.get(slot)).is_some_and(|(m, t)| (m - t).abs() > VERIFIED)
    }

    /// Returns the number of times that measured exposure times replaced earlier ones.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Drops the stored brightness ratios, when the control delay has changed.
    pub(super) fn forget(&mut self) {
        self.steps.iter_mut().for_each(VecDeque::clear);
    }

    /// Compares `log_ratio`, the logarithm of the brightness ratio of a frame with exposure `new` to one with
    /// exposure `old`, with the expected ratio.
    pub(super) fn judge(&self, old: usize, new: usize, log_ratio: f64) -> Verdict {
        let step = |of: &[f64]| of.get(new).zip(of.get(old)).map(|(new, old)| new - old);
        let (Some(told), Some(measured)) = (step(&self.told), step(&self.measured)) else {
            return Verdict::CannotTell;
        };
        let off = (log_ratio - measured).abs();
        let deviates = self.deviates(old) || self.deviates(new);
        match () {
            () if !deviates && (log_ratio - told).abs() <= VERIFIED => Verdict::Agrees,
            () if deviates && off <= VERIFIED => Verdict::Measured,
            () if off <= self.tolerance => Verdict::Near,
            () => Verdict::Differs,
        }
    }

    /// Stores the logarithm of a brightness ratio from exposure `old` to exposure `new`, and replaces the exposure times whose ratios
    /// deviate from the control's values by a constant factor.
    pub(super) fn note(&mut self, old: usize, new: usize, log_ratio: f64) {
        let (step, up) = match (old.checked_add(1) == Some(new), new.checked_add(1) == Some(old)) {
            (true, _) => (old, log_ratio),
            (_, true) => (new, -log_ratio),
            _ => return,
        };
        let Some(kept) = self.steps.get_mut(step) else { return };
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(up);
        self.take_over();
    }

    fn take_over(&mut self) {
        let mut deviation = vec![0.0];
        for (step, kept) in self.steps.iter().enumerate() {
            let told = self.told[step + 1] - self.told[step];
            let current = self.measured[step + 1] - self.measured[step];
            let found =
                settled(kept).filter(|log| (log - told).abs() <= LARGEST_DEVIATION && *log > VERIFIED);
            let found = found.unwrap_or(current) - told;
            deviation.push(deviation[step] + if found.abs() > VERIFIED { found } else { 0.0 });
        }
        let mut sorted = deviation.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted[sorted.len() / 2];
        let measured: Vec<f64> = self.told.iter().zip(&deviation).map(|(t, d)| t + d - middle).collect();
        if measured.iter().zip(&self.measured).any(|(new, old)| (new - old).abs() > CHANGE) {
            (self.tolerance, self.measured) = (tolerance(&measured), measured);
            self.changes += 1;
        }
    }
}

/// Returns the median of the stored ratios of a step, natural logarithm; `None` while they are few or their
/// spread is large.
fn settled(kept: &VecDeque<f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = kept.iter().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let (most, least) = (sorted.get(KEPT - 2)?, sorted.get(1)?);
    (most - least <= SPREAD).then(|| sorted[KEPT / 2])
}

fn tolerance(logs: &[f64]) -> f64 {
    let gaps = logs.windows(2).map(|w| (w[1] - w[0]).abs());
    (TOLERANCE * gaps.fold(f64::INFINITY, f64::min)).min(LARGEST_TOLERANCE)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noted(seconds: &[f64], ratios: &[(usize, usize, f64)]) -> MeasuredRatios {
        let mut measured = MeasuredRatios::new(seconds);
        for _ in 0..KEPT {
            ratios.iter().for_each(|(old, new, ratio)| measured.note(*old, *new, ratio.ln()));
        }
        measured
    }

    /// Computed by hand: the control's values are 10, 20 and 40 ms, and the longest exposure is shortened to 30 ms.
    #[test]
    fn a_cut_exposure_is_measured_and_the_others_stay() {
        let m = noted(&[0.01, 0.02, 0.04], &[(0, 1, 2.0), (1, 2, 1.5)]);
        let found: Vec<f64> = (0..3).map(|slot| (m.seconds(slot).expect("three") * 1e5).round()).collect();
        assert_eq!(found, [1000.0, 2000.0, 3000.0], "10, 20 and 30 ms");
        assert_eq!([0, 1, 2].map(|slot| m.deviates(slot)), [false, false, true], "the longest alone");
        assert_eq!(m.judge(0, 1, 2f64.ln()), Verdict::Agrees, "as the control says");
        assert_eq!(m.judge(2, 1, -(1.5f64.ln())), Verdict::Measured, "as measured");
    }

    #[test]
    fn a_ratio_within_10_percent_verifies_and_one_beyond_does_not() {
        let m = MeasuredRatios::new(&[0.01, 0.08]);
        let found = [7.3, 8.7, 9.0, 12.0, 14.0].map(|ratio: f64| m.judge(0, 1, ratio.ln()));
        let expected = [Verdict::Agrees, Verdict::Agrees, Verdict::Near, Verdict::Near, Verdict::Differs];
        assert_eq!(found, expected, "of a ratio of 8");
    }

    #[test]
    fn flicker_and_wrong_tone_curves_change_no_exposure() {
        let mut flicker = MeasuredRatios::new(&[0.01, 0.02]);
        (0..40).for_each(|n| flicker.note(0, 1, [1.5f64, 2.5, 1.9][n % 3].ln()));
        assert_eq!(flicker.changes(), 0, "ratios that spread");
        let curve = noted(&[0.001, 0.006], &[(0, 1, 50.0)]);
        assert_eq!(curve.changes(), 0, "8 times off");
    }
}
