//! Jumps of the light of rows: changes from burst to burst as false frames show them, against the usual changes.

use super::by_phase::{Contradictions, DEVIATIONS, NEW, OUTLIER};
use super::compare::median;
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
    /// Running variance of the change of each row: a lamp that flickers in one row does not hide a false frame in the others.
    variances: [f32; ROWS],
    jumps: Contradictions,
}

impl Usual {
    /// Returns whether `changes` have an unusual jump, if enough bursts are known and enough rows are read; adds what is usual to the variances.
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
            self.variances.iter_mut().for_each(|variance| *variance -= NEW * *variance);
            return None;
        }
        // A row has at least the variance of most rows.
        let most_rows = median(&mut self.variances.clone()).unwrap_or(0.0);
        let least = most_rows.max((JUMP.ln() / DEVIATIONS).powi(2));
        let usual = self.variances.map(|variance| variance.max(least));
        let threshold = |variance: f32| DEVIATIONS * variance.sqrt();
        let jump = Jump::find(changes, threshold(least), &usual.map(threshold), is_window);
        let jump = jump.filter(|_| is_known);
        let is_usual = self.jumps.add(jump.is_some());
        let unusual = jump.filter(|_| !is_usual);
        if unusual.is_none() {
            self.bursts = self.bursts.saturating_add(1);
            let new = NEW.max(1.0 / self.bursts as f32);
            for ((variance, change), usual) in self.variances.iter_mut().zip(changes).zip(usual) {
                let Some(change) = change else { continue };
                let most = if is_known { OUTLIER * usual } else { f32::MAX };
                *variance += new * ((change * change).min(most) - *variance);
            }
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
    /// Finds the jump of `changes`. A row whose change is beyond its threshold in `own` jumps; a row whose change is up to `threshold` does not.
    /// Rows between the two show neither.
    fn find(
        changes: &[Option<f32>; ROWS],
        threshold: f32,
        own: &[f32; ROWS],
        is_window: bool,
    ) -> Option<Self> {
        let moved: [Option<bool>; ROWS] = core::array::from_fn(|row| {
            let (size, own) = (changes[row]?.abs(), own[row]);
            (size > own || size <= threshold).then_some(size > own)
        });
        let rows = moved.map(|moved| moved == Some(true));
        let count = rows.iter().filter(|moved| **moved).count();
        let jumps = || changes.iter().zip(rows).filter_map(|(change, moved)| change.filter(|_| moved));
        let is_one_way = jumps().all(|change| change > 0.0) || jumps().all(|change| change < 0.0);
        let mut edges = 0;
        let mut last = None;
        for is_moved in moved.into_iter().flatten() {
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

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: Rule = Rule { is_known: true, is_window: false };

    /// Returns changes of 0.01, and `size` from row `from` on.
    fn torn(from: usize, size: f32) -> [Option<f32>; ROWS] {
        core::array::from_fn(|row| Some(if row >= from { size } else { 0.01 }))
    }

    /// A lamp in row 6 flickers by factors up to 7, and most other rows are too dark for a measurement.
    fn flickering() -> Usual {
        let mut usual = Usual::default();
        for burst in 0..64 {
            let mut changes = [None; ROWS];
            (changes[4], changes[15]) = (Some(0.01), Some(-0.01));
            changes[6] = Some([-1.9, 1.7, 0.2, -0.1, 0.5, -0.4][burst % 6]);
            usual.judge(&changes, ROWS, RULE);
        }
        usual
    }

    #[test]
    fn a_lamp_that_flickers_in_one_row_does_not_hide_a_tear_of_the_others() {
        // The row of the lamp is torn as well, or not; its own change may be that of its flicker.
        for (from, lamp) in [(7, 0.3), (7, 1.8), (4, 1.8), (4, 3.4)] {
            let mut changes = torn(from, 1.5);
            changes[6] = Some(lamp);
            let jump = flickering().judge(&changes, ROWS, RULE).flatten();
            let rows = jump.map(|jump| jump.rows.map(u8::from).iter().sum::<u8>());
            assert!(rows.is_some_and(|rows| rows >= 9), "from row {from}, lamp {lamp}: {rows:?} rows");
        }
    }

    #[test]
    fn flicker_that_is_usual_for_its_row_is_no_jump() {
        for change in [-1.9, -0.5, 0.5, 1.9] {
            let mut changes = torn(ROWS, 0.0);
            changes[6] = Some(change);
            assert!(flickering().judge(&changes, ROWS, RULE).flatten().is_none(), "{change}");
        }
    }
}
