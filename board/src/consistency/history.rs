//! Running statistics of the comparisons of two exposures over the earlier bursts.

use super::by_phase::{DEVIATIONS, LevelFaults, NEW, PhaseContradictions, PhaseRunning};
use super::compare::Comparison;
use hemilux_core::wire::FrameFault;

/// Number of compared bursts from which the usual ratio of two exposures counts as known.
pub(super) const KNOWN: u32 = 4;

/// Least factor between a wrong ratio of radiances and the usual ratio of the pair of exposures.
const WRONG: f32 = 1.2;

/// Factor between a measured and the stated ratio of exposures from which the measured ratio is doubtful until the usual ratio is known.
const DOUBTFUL: f32 = 1.5;

/// Excess of the share of different samples over the running mean of this share from which two frames show different scenes.
const MOVED: f32 = 0.2;

/// Contradiction of two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Contradiction {
    None,
    /// The frames contradict each other as in many earlier bursts, for example because lamps flicker.
    Usual,
    Unusual(FrameFault),
}

/// Running means of the comparisons of one pair of exposures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct History {
    /// Natural logarithm of the ratio of radiances.
    ratio: PhaseRunning,
    /// [`Comparison::away`].
    away: PhaseRunning,
    /// Running mean of the squares of [`Comparison::parts`].
    parts: f32,
    contradictions: PhaseContradictions,
    /// Bursts in which the shorter, or the longer, frame is black or saturated as a whole.
    levels: [LevelFaults; 2],
    /// Number of bursts without an unusual contradiction since the last one in which the pair could not be compared.
    compared: u32,
    /// Number of bursts that were added to the running means since [`History::widen`].
    since_wide: u32,
    /// True if the pair could be compared in the last burst.
    is_comparable: bool,
}

impl History {
    /// Returns the statistics of the first and the last of three frames, from those of the first two, `self`, and of the last two, `other`.
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            ratio: self.ratio.joined(&other.ratio, |a, b| a + b),
            away: self.away.joined(&other.away, f32::max),
            parts: self.parts.max(other.parts),
            contradictions: self.contradictions.larger(other.contradictions),
            levels: [self.levels[0], other.levels[1]],
            compared: 0,
            since_wide: 0,
            is_comparable: false,
        }
    }

    /// Returns the contradiction of the comparison `seen`; adds the comparison to the running means unless the contradiction is an unusual one.
    /// `phase` is the phase of the lamps in the burst, as in [`PhaseContradictions::add`].
    pub fn judge(&mut self, seen: &Comparison, phase: Option<f32>) -> Contradiction {
        let Some(log_ratio) = seen.log_ratio else {
            // A pair may be comparable for hours only in bursts with a fault, sometimes in two successive ones.
            self.contradictions.add(phase, false);
            (self.compared, self.is_comparable) = (0, false);
            return Contradiction::None;
        };
        let fault = self.fault(seen, log_ratio, phase);
        // A burst after one in which the pair could not be compared may be comparable because of a fault: no evidence of usual contradictions.
        let is_evidence = std::mem::replace(&mut self.is_comparable, true);
        let contradictions = &mut self.contradictions;
        let is_usual = if is_evidence {
            contradictions.add(phase, fault.is_some())
        } else {
            contradictions.are_usual(phase)
        };
        let found = match fault {
            // Parts that differ as in many earlier bursts confirm neither frame.
            None if seen.is_torn => Contradiction::Usual,
            None => Contradiction::None,
            Some(_) if is_usual => Contradiction::Usual,
            Some(fault) => Contradiction::Unusual(fault),
        };
        if !matches!(found, Contradiction::Unusual(_)) && seen.level_faults() == [None; 2] {
            self.compared = self.compared.saturating_add(1);
            if self.is_plausible(log_ratio) || self.compared >= KNOWN {
                self.add(seen, log_ratio, phase);
            }
        } else if let Contradiction::Unusual(fault) = found {
            self.widen(fault, seen, log_ratio);
        }
        found
    }

    /// Returns the faults of the frames of `seen` that are black or saturated as a whole, without those that are so whenever the lamps have this phase:
    /// a short exposure in the dark part of their period is no fault. Adds the burst to the counts.
    pub fn level_faults(&mut self, seen: &Comparison, phase: Option<f32>) -> [Option<FrameFault>; 2] {
        let mut faults = seen.level_faults();
        for (fault, counts) in faults.iter_mut().zip(&mut self.levels) {
            let is_of_lamps = counts.add(phase, fault.is_some());
            *fault = fault.filter(|_| !is_of_lamps);
        }
        faults
    }

    /// Returns true if `log_ratio`, which is no contradiction, is near the usual ratio or near the stated one. In dark light, a pair may be
    /// comparable only in bursts with a fault; these bursts are not successive, so that their ratio must not become the usual ratio.
    pub fn is_plausible(&self, log_ratio: f32) -> bool {
        self.ratio.bursts() >= KNOWN || (log_ratio - self.ratio.mean()).abs() < DOUBTFUL.ln()
    }

    fn fault(&self, seen: &Comparison, log_ratio: f32, phase: Option<f32>) -> Option<FrameFault> {
        let is_wrong = self.ratio.is_unusual(log_ratio, WRONG.ln(), phase);
        if seen.is_copy {
            Some(FrameFault::Repeated)
        } else if seen.is_torn && seen.parts > DEVIATIONS * self.parts.sqrt() {
            Some(FrameFault::Torn)
        } else if seen.away.is_some_and(|away| self.is_other_scene(away, phase)) {
            Some(FrameFault::OtherScene)
        } else {
            (self.ratio.bursts() >= KNOWN && is_wrong).then_some(FrameFault::WrongExposure)
        }
    }

    /// Returns true if `away`, [`Comparison::away`], is larger than usual.
    fn is_other_scene(&self, away: f32, phase: Option<f32>) -> bool {
        away > self.away.mean() && self.away.is_unusual(away, MOVED, phase)
    }

    /// Adds the unusual value that is `fault` to its running variance. In dark light, a pair may be comparable only in bursts with a fault: the
    /// values of at least [`KNOWN`] bursts without a fault come before each unusual one.
    fn widen(&mut self, fault: FrameFault, seen: &Comparison, log_ratio: f32) {
        if self.since_wide < KNOWN {
            return;
        }
        match fault {
            FrameFault::WrongExposure => self.ratio.widen(log_ratio, WRONG.ln()),
            FrameFault::OtherScene => seen.away.into_iter().for_each(|away| self.away.widen(away, MOVED)),
            _ => return,
        }
        self.since_wide = 0;
    }

    fn add(&mut self, seen: &Comparison, log_ratio: f32, phase: Option<f32>) {
        self.since_wide = self.since_wide.saturating_add(1);
        self.ratio.add(log_ratio, phase);
        let new = NEW.max(1.0 / self.ratio.bursts() as f32);
        seen.away.into_iter().for_each(|away| self.away.add(away, phase));
        self.parts += new * (seen.parts * seen.parts - self.parts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn of_ratio(log_ratio: Option<f32>) -> Comparison {
        let mut comparison = Comparison::default();
        comparison.log_ratio = log_ratio;
        comparison
    }

    /// Mean light in an exposure of `seconds` that ends after `end` periods of a lamp of 100 Hz, relative to the mean over a period.
    fn light(depth: f64, end: f64, seconds: f64) -> f64 {
        let half = TAU / 2.0 * 100.0 * seconds;
        1.0 + depth * half.sin() / half * (TAU * end - half).cos()
    }

    /// Returns the comparison of exposures of 0.926 and 5.555 ms in burst `burst` of a room under a lamp at 28.2 frames per second: eight phases
    /// follow each other, and in three of them too few samples can be compared.
    fn compared(depth: f64, burst: usize) -> Comparison {
        let (end, frame) = (10.625 * (burst + 1) as f64, 10.625 / 3.0);
        let ratio = light(depth, end, 0.926e-3) / light(depth, end + frame, 5.555e-3);
        let log_ratio = (!matches!(burst % 8, 0 | 2 | 5)).then_some(ratio.ln() as f32);
        of_ratio(log_ratio)
    }

    #[test]
    fn the_phases_of_a_lamp_become_usual_and_other_ratios_do_not() {
        for depth in [0.1, 0.2, 0.3, 0.4, 0.6, 0.8] {
            let mut history = History::default();
            let last = (0..400).filter(|burst| {
                matches!(history.judge(&compared(depth, *burst), None), Contradiction::Unusual(_))
            });
            let last = last.last().unwrap_or(0);
            assert!(last < 120, "depth {depth}: the phase of burst {last} is called wrong");
            if depth <= 0.4 {
                let wrong = of_ratio(Some(6f32.ln()));
                assert_eq!(
                    history.judge(&wrong, None),
                    Contradiction::Unusual(FrameFault::WrongExposure),
                    "{depth}"
                );
            }
        }
    }

    #[test]
    fn a_tenth_of_wrong_ratios_does_not_become_usual() {
        let mut history = History::default();
        for burst in 0..4000_u32 {
            let is_wrong = burst > 10 && burst.wrapping_mul(2_654_435_761) >> 16 < 6554;
            let log_ratio = if is_wrong { 1.5f32.ln() } else { 0.01 * (burst % 5) as f32 };
            let found = history.judge(&of_ratio(Some(log_ratio)), None);
            assert_eq!(matches!(found, Contradiction::Unusual(_)), is_wrong, "burst {burst}");
        }
    }
}
