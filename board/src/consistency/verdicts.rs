//! Verdicts on the frames of a burst from their comparisons in pairs.

use super::compare::Comparison;
use super::history::{Contradiction, History};
use super::samples::{ROWS, RowSet, unite};
use hemilux_core::MAX_EXPOSURES;
use hemilux_core::wire::FrameFault;

/// Largest number of pairs of frames of a burst that are compared: each frame with the frames of the next and of the second next longer
/// exposure.
const PAIRS: usize = 2 * MAX_EXPOSURES;

/// Indices of a frame and of the frame with which it is compared, in ascending order of exposure.
#[derive(Clone, Copy)]
pub(super) struct Pair {
    pub of: usize,
    pub by: usize,
}

impl Pair {
    /// Returns the index of the pair in [`Verdicts`]; `None` for frames that are not compared.
    fn index(self) -> Option<usize> {
        let (low, high) = (self.of.min(self.by), self.of.max(self.by));
        (1..=2).contains(&(high - low)).then(|| 2 * low + high - low - 1).filter(|i| *i < PAIRS)
    }
}

/// Returns the verdicts of the comparison `seen` on its shorter and on its longer exposure; `phase` is the phase of the lamps in the burst, periods.
pub(super) fn verdict(seen: &Comparison, history: &mut History, phase: Option<f32>) -> [Verdict; 2] {
    // The history, to which this burst is added, does not confirm the burst itself.
    let is_plausible = seen.log_ratio.map(|log_ratio| history.is_plausible(log_ratio));
    let shared = match (history.judge(seen, phase), is_plausible) {
        (Contradiction::Unusual(fault), _) => Verdict::Differs(fault),
        (Contradiction::Usual, _) => Verdict::DiffersAsUsual,
        (Contradiction::None, Some(true)) => Verdict::Agrees,
        (Contradiction::None, Some(false)) => Verdict::Doubtful,
        (Contradiction::None, None) => Verdict::Unknown,
    };
    history.level_faults(seen, phase).map(|fault| fault.map_or(shared, Verdict::Is))
}

/// Verdict on a frame from the comparison with another frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Too few samples of the two frames can be compared.
    Unknown,
    /// Too few earlier bursts are known to decide whether the ratio of the two frames is a fault.
    Doubtful,
    /// The two compared frames show the same light.
    Agrees,
    /// The two frames differ as in many earlier bursts. Neither is called wrong, but neither confirms an unexpected exposure of the other.
    DiffersAsUsual,
    /// One of the two frames is wrong; the comparison does not show which.
    Differs(FrameFault),
    /// The compared frame itself is wrong.
    Is(FrameFault),
    /// The frame with which it is compared is wrong.
    OtherIs,
}

impl Verdict {
    /// Returns true if neither frame is called wrong or doubtful: they agree, or differ as in many earlier bursts.
    fn is_usual(self) -> bool {
        matches!(self, Self::Agrees | Self::DiffersAsUsual)
    }
}

/// Verdicts on the frames of a burst.
pub(super) struct Verdicts {
    /// Two verdicts for each pair: of the shorter exposure compared with the longer one, and of the longer compared with the shorter one.
    pairs: [[Verdict; 2]; PAIRS],
    /// The rows in which the frames of each pair have the same light.
    rows: [RowSet; PAIRS],
}

impl Default for Verdicts {
    fn default() -> Self {
        Self { pairs: [[Verdict::Unknown; 2]; PAIRS], rows: [[false; ROWS]; PAIRS] }
    }
}

impl Verdicts {
    /// Stores the verdicts on the shorter and on the longer frame of `pair`, in which `of` is the shorter one, and the rows in which the
    /// frames have the same light.
    pub fn set(&mut self, pair: Pair, verdicts: [Verdict; 2], rows: RowSet) {
        if let Some(index) = pair.index() {
            (self.pairs[index], self.rows[index]) = (verdicts, rows);
        }
    }

    /// Returns true if the comparisons of all neighbouring exposures of `frames` frames are usual ones.
    pub fn are_all_usual(&self, frames: usize) -> bool {
        self.pairs
            .iter()
            .step_by(2)
            .take(frames.saturating_sub(1))
            .flatten()
            .all(|verdict| verdict.is_usual())
    }

    /// Returns true if the frames `short` and `long` contradict each other or their comparison is doubtful.
    pub fn differ(&self, short: usize, long: usize) -> bool {
        matches!(self.of(Pair { of: short, by: long }), Verdict::Differs(_) | Verdict::Doubtful)
    }

    /// Returns the rows in which the frame `index` has the light of a neighbour in `kept` that agrees with it; `None` if no neighbour does.
    pub fn agreeing_rows(&self, index: usize, kept: &[usize]) -> Option<RowSet> {
        let pairs = kept.windows(2).filter(|pair| pair.contains(&index)).map(|p| Pair { of: p[0], by: p[1] });
        let agreeing = pairs.filter(|pair| self.of(*pair) == Verdict::Agrees);
        let rows = agreeing.filter_map(|pair| self.rows.get(pair.index()?));
        rows.copied().reduce(|mut all, rows| {
            unite(&mut all, &rows);
            all
        })
    }

    /// Returns true if the comparison of the frame `index` with one of its neighbours in `kept` is a usual one.
    pub fn are_usual(&self, index: usize, kept: &[usize]) -> bool {
        let is_usual = |pair: &[usize]| self.of(Pair { of: pair[0], by: pair[1] }).is_usual();
        kept.windows(2).any(|pair| pair.contains(&index) && is_usual(pair))
    }

    fn of(&self, pair: Pair) -> Verdict {
        let Some(index) = pair.index() else { return Verdict::Unknown };
        let [low, high] = self.pairs[index];
        let (this, other) = if pair.of < pair.by { (low, high) } else { (high, low) };
        match (this, other) {
            (Verdict::Is(fault), _) => Verdict::Is(fault),
            (_, Verdict::Is(_)) => Verdict::OtherIs,
            (this, _) => this,
        }
    }
}

/// A frame that contradicts the other remaining frames of its burst.
pub(super) struct Wrong {
    /// Index of the frame in the list of the frames that remained before.
    pub at: usize,
    pub fault: FrameFault,
    /// True if the other remaining frames agree with each other, so far as they can be compared.
    pub is_certain: bool,
}

/// Returns a wrong frame of `kept`: its neighbours in exposure contradict it, and the other frames do not contradict each other.
pub(super) fn worst(kept: &[usize], verdicts: &Verdicts) -> Option<Wrong> {
    let between = |of: usize, by: usize| verdicts.of(Pair { of: kept[of], by: kept[by] });
    let last = kept.len().checked_sub(1)?;
    let fault_at = |at: usize| {
        let neighbours = || [at.checked_sub(1), Some(at + 1).filter(|i| *i <= last)].into_iter().flatten();
        let seen = || neighbours().map(|by| between(at, by));
        if seen().any(|verdict| verdict.is_usual() || verdict == Verdict::OtherIs) {
            return None;
        }
        if let Some(fault) = seen().find_map(|v| if let Verdict::Is(fault) = v { Some(fault) } else { None })
        {
            return Some(Wrong { at, fault, is_certain: true });
        }
        let fault = seen().find_map(|v| if let Verdict::Differs(fault) = v { Some(fault) } else { None })?;
        // The comparison of the next frames on either side determines which of two frames is wrong.
        let others = match (at.checked_sub(1), at < last) {
            (Some(before), true) => Some((at + 1, before)),
            (Some(before), false) => before.checked_sub(1).map(|other| (before, other)),
            (None, true) => Some((at + 1, at + 2)).filter(|(_, other)| *other <= last),
            (None, false) => None,
        };
        match others.map(|(of, by)| between(of, by)) {
            Some(Verdict::Agrees | Verdict::DiffersAsUsual) => Some(Wrong { at, fault, is_certain: true }),
            Some(Verdict::Unknown | Verdict::Doubtful) => Some(Wrong { at, fault, is_certain: false }),
            _ => None,
        }
    };
    (0..=last).find_map(fault_at)
}
