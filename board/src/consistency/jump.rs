//! Jumps of the light of rows: changes from burst to burst as false frames show them, against the usual changes.

use super::history::{Contradictions, DEVIATIONS, NEW};
use super::samples::{ROWS, RowSet, SATURATED, Sampled};
use hemilux_core::wire::FrameFault;

/// Fewest rows that a judgement rests on.
pub(super) const ENOUGH_ROWS: usize = 4;

/// Least factor of the change of a false frame: all faults change the light of the rows that they reach by more.
pub(super) const JUMP: f32 = 1.5;

/// Least factor of the change of one row where fewer rows than [`PART_ROWS`] jump: a tear may cross a row.
const FAR_JUMP: f32 = 2.5;

/// Fewest rows of a part of a frame that a moving object seldom fills.
const PART_ROWS: usize = 3;

/// Number of jumping rows that other exposures must confirm. A tear may cross one row.
const CONFIRMED: usize = 2;

/// Factor of the running variance up to which a burst counts: a false frame that is no jump does not hide the next one.
const OUTLIER: f32 = 8.0;

/// Returns the number of rows with a value.
pub(super) fn measured<T>(rows: &[Option<T>; ROWS]) -> usize {
    rows.iter().flatten().count()
}

/// What counts as an unusual jump.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// Whether enough earlier bursts are known.
    pub is_known: bool,
    /// Whether the frames are those of a sliding window: an object that moves changes some rows of the newest frame alone, so that a part of
    /// a frame has at least [`PART_ROWS`] rows.
    pub is_window: bool,
}

/// The usual change of rows from burst to burst.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Usual {
    bursts: u32,
    variance: f32,
    jumps: Contradictions,
}

impl Usual {
    /// Returns whether `changes` have an unusual jump, if enough bursts are known and enough rows are read; adds what is usual to the variance.
    /// `read` is the number of rows that are measured or too dark in both bursts. A burst of fewer rows counts as one without a change: in dark light,
    /// rows may be measured in false frames alone, which must not become usual.
    pub fn judge(
        &mut self,
        changes: &[Option<f32>; ROWS],
        read: usize,
        Rule { is_known, is_window }: Rule,
    ) -> Option<Option<Jump>> {
        if read < ENOUGH_ROWS {
            self.jumps.add(false);
            self.variance -= NEW * self.variance;
            return None;
        }
        let least = (JUMP.ln() / DEVIATIONS).powi(2);
        let threshold = DEVIATIONS * self.variance.max(least).sqrt();
        let jump = Jump::find(changes, threshold, is_window).filter(|_| is_known);
        let is_usual = self.jumps.add(jump.is_some());
        let unusual = jump.filter(|_| !is_usual);
        if unusual.is_none() {
            let squares = changes.iter().flatten().map(|change| change * change).sum::<f32>();
            let square = squares / measured(changes).max(1) as f32;
            let most = if is_known { OUTLIER * self.variance.max(least) } else { f32::MAX };
            self.bursts = self.bursts.saturating_add(1);
            let new = NEW.max(1.0 / self.bursts as f32);
            self.variance += new * (square.min(most) - self.variance);
        }
        is_known.then_some(unusual)
    }
}

/// Rows at the upper or at the lower edge, or all of them, that become darker, or brighter, at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jump {
    rows: RowSet,
    is_whole: bool,
}

impl Jump {
    fn find(changes: &[Option<f32>; ROWS], threshold: f32, is_window: bool) -> Option<Self> {
        let moved = |change: &f32| change.abs() > threshold;
        let rows = changes.map(|change| change.as_ref().is_some_and(moved));
        let count = rows.iter().filter(|moved| **moved).count();
        let jumps = || changes.iter().flatten().filter(|change| moved(change));
        let is_one_way = jumps().all(|change| *change > 0.0) || jumps().all(|change| *change < 0.0);
        let mut edges = 0;
        let mut last = None;
        for is_moved in changes.iter().flatten().map(moved) {
            edges += usize::from(last.is_some_and(|last| last != is_moved));
            last = Some(is_moved);
        }
        let is_whole = edges == 0;
        let is_far = || jumps().any(|change| change.abs() > FAR_JUMP.ln());
        let is_part = count >= PART_ROWS || (is_far() && (is_whole || !is_window));
        let is_jump = count > 0 && is_one_way && edges <= 1 && is_part;
        is_jump.then_some(Self { rows, is_whole })
    }

    /// Returns true if other exposures confirm the light of at least [`CONFIRMED`] of the rows that jump.
    pub fn is_confirmed(&self, confirmed: &RowSet) -> bool {
        self.rows.iter().zip(confirmed).filter(|(moved, confirmed)| **moved && **confirmed).count()
            >= CONFIRMED
    }

    /// Mean size of the changes of the rows that jump.
    pub fn size(&self, changes: &[Option<f32>; ROWS]) -> f32 {
        let sizes = || changes.iter().zip(self.rows).filter_map(|(change, moved)| change.filter(|_| moved));
        sizes().map(f32::abs).sum::<f32>() / sizes().count().max(1) as f32
    }

    pub fn fault(&self, frame: &Sampled) -> FrameFault {
        let all = |value: f32| frame.rows().flatten().all(|sample| *sample == value);
        if !self.is_whole {
            FrameFault::Torn
        } else if all(0.0) {
            FrameFault::Black
        } else if all(SATURATED) {
            FrameFault::Saturated
        } else {
            FrameFault::WrongExposure
        }
    }
}
