//! The bursts whose maps the removal of flicker compares: those that are merged from the same exposures.

use super::Pipeline;
use crate::calibration::Burst;
use hemilux_core::mains::Flicker;
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{Exposure, MAX_EXPOSURES};

/// Largest number of successive bursts that are not compared with the bursts before because they lack frames. Further bursts without the same
/// frames are compared with each other.
const MOST_APART: u32 = 4;

/// Whether the light of a merged burst can be compared with that of the bursts before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Comparability {
    /// The burst is merged from the same exposures.
    Same,
    /// The burst and the next ones have other exposures.
    Changed,
    /// The burst has the same exposures, others of which are merged from now on.
    Reselected,
    /// The burst lacks frames that the next bursts are expected to have.
    Apart,
}

/// The exposures from which the compared bursts are merged.
#[derive(Debug)]
pub(super) struct Compared {
    merged: Vec<Exposure>,
    /// Exposures of the last compared burst, including those that were not merged.
    taken: Vec<Exposure>,
    /// Exposures of a whole burst; empty while they are unknown.
    nominal: Vec<Exposure>,
    /// Number of successive bursts that are not compared.
    apart: u32,
}

impl Compared {
    pub fn new() -> Self {
        let empty = || Vec::with_capacity(MAX_EXPOSURES);
        Self { merged: empty(), taken: empty(), nominal: empty(), apart: 0 }
    }

    /// Sets the exposures of the next whole bursts.
    pub fn expect(&mut self, exposures: &[Exposure]) {
        self.nominal.clear();
        self.nominal.extend(exposures.iter().take(MAX_EXPOSURES));
    }

    /// Returns whether `burst` has all its frames.
    pub fn is_whole(&self, burst: &Burst, left_out: &FramesLeftOut) -> bool {
        let exposures = burst.frames.iter().map(|frame| &frame.exposure);
        left_out.is_empty() && (self.nominal.is_empty() || exposures.eq(&self.nominal))
    }

    /// Compares the exposures `merged` of `burst` with those of the bursts before.
    pub fn compare(&mut self, burst: &Burst, merged: &[Exposure], is_whole: bool) -> Comparability {
        if self.merged == merged {
            self.apart = 0;
            return Comparability::Same;
        }
        if !is_whole && !self.merged.is_empty() && self.apart < MOST_APART {
            self.apart += 1;
            return Comparability::Apart;
        }
        self.apart = 0;
        self.merged.clear();
        self.merged.extend(merged.iter().take(MAX_EXPOSURES));
        let exposures = burst.frames.iter().map(|frame| frame.exposure).take(MAX_EXPOSURES);
        if is_whole && exposures.clone().eq(self.taken.iter().copied()) {
            return Comparability::Reselected;
        }
        self.taken.clear();
        self.taken.extend(exposures);
        Comparability::Changed
    }
}

impl Pipeline {
    /// Returns, for each frame of `burst`, whether it may be merged under the detected flicker: always true for the shortest and the
    /// longest exposure.
    pub(super) fn steady(&self, burst: &Burst) -> [bool; MAX_EXPOSURES] {
        let last = burst.frames.len().saturating_sub(1);
        core::array::from_fn(|index| {
            let seconds = burst.frames.get(index).map_or(0.0, |frame| frame.exposure.seconds);
            index == 0 || index >= last || self.mains.keeps(seconds)
        })
    }

    /// Removes the flicker of lamps from the map of `burst`, which was merged without the frames `left_out`.
    pub(super) fn remove_flicker(&mut self, burst: &Burst, left_out: &FramesLeftOut) -> Flicker {
        let is_whole = self.compared.is_whole(burst, left_out);
        let (map, at) = (&mut self.front.map_mut(), burst.phase_s());
        match self.compared.compare(burst, &self.exposures, is_whole) {
            Comparability::Apart => return self.mains.update_apart(map),
            Comparability::Changed => self.mains.refit(),
            Comparability::Reselected => self.mains.reselect(),
            Comparability::Same => {}
        }
        self.mains.update(map, at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Frame, Pixels};
    use Comparability::{Apart, Changed, Reselected, Same};

    fn exposures(seconds: &[f64]) -> Vec<Exposure> {
        seconds.iter().map(|&seconds| Exposure { seconds, gain: 1.0 }).collect()
    }

    fn burst(seconds: &[f64]) -> Burst {
        let frame = |exposure| Frame { exposure, pixels: Pixels::U8(Vec::new()) };
        Burst { frames: exposures(seconds).into_iter().map(frame).collect(), ..Burst::default() }
    }

    const WHOLE: [f64; 3] = [0.001, 0.01, 0.03];

    /// Compares a burst of the exposures `taken`, seconds, that is merged from the exposures `merged`.
    fn compare(compared: &mut Compared, taken: &[f64], merged: &[f64]) -> Comparability {
        compared.compare(&burst(taken), &exposures(merged), taken == WHOLE)
    }

    #[test]
    fn partial_bursts_are_compared_from_the_fifth_in_succession_on() {
        let mut compared = Compared::new();
        let partial = [0.001, 0.01];
        assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Changed);
        assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Same);
        for _ in 0..2 {
            assert_eq!([(); 4].map(|()| compare(&mut compared, &partial, &partial)), [Apart; 4]);
            assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Same);
        }
        let found = [(); 6].map(|()| compare(&mut compared, &partial, &partial));
        assert_eq!(found, [Apart, Apart, Apart, Apart, Changed, Same]);
        assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Changed);
    }

    #[test]
    fn exposures_that_are_no_longer_merged_are_no_change_of_the_exposures() {
        let mut compared = Compared::new();
        assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Changed);
        assert_eq!(compare(&mut compared, &WHOLE, &[0.001, 0.03]), Reselected);
        assert_eq!(compare(&mut compared, &[0.001, 0.03], &[0.001, 0.03]), Same);
        assert_eq!(compare(&mut compared, &WHOLE, &WHOLE), Reselected);
    }

    #[test]
    fn whole_bursts_have_the_expected_exposures_and_no_frame_left_out() {
        let mut compared = Compared::new();
        assert!(compared.is_whole(&burst(&[0.001, 0.03]), &FramesLeftOut::NONE), "unknown exposures");
        compared.expect(&exposures(&[0.001, 0.01, 0.03]));
        assert!(!compared.is_whole(&burst(&[0.001, 0.03]), &FramesLeftOut::NONE));
        assert!(compared.is_whole(&burst(&[0.001, 0.01, 0.03]), &FramesLeftOut::NONE));
        let mut left_out = FramesLeftOut::NONE;
        left_out.insert(2, hemilux_core::wire::FrameFault::Black);
        assert!(!compared.is_whole(&burst(&[0.001, 0.01, 0.03]), &left_out));
    }
}
