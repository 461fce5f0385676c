//! Prediction of each frame's exposure from the log of control writes.
//!
//! A control that is written after the sensor's frame `s` acts from frame `s + 1 + delay` on, so the exposure of a frame is that of the
//! latest write that could act on it, even if frames in between were lost. Writes are assigned to frames by sequence number, not by
//! counting delivered frames.

use std::collections::VecDeque;

/// Longest control delay that the schedule supports, frames after the next one.
pub const MAX_DELAY: u32 = 8;

/// Number of logged writes: more than the longest delay and the longest queue of frames together.
const KEPT: usize = 64;

/// How the exposure of a frame is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// The camera reported the exposure with the frame.
    Reported,
    /// The exposure was predicted from the control writes.
    Predicted,
    /// The exposure was predicted, and the brightness ratio to a neighbouring frame agrees within 10 %.
    Verified,
    /// The exposure was measured from brightness ratios, which differ from the control's value by more than 10 %.
    Measured,
    /// The brightness ratio contradicts the predicted exposure, or no exposure is predicted.
    Unknown,
}

impl Known {
    /// Returns the name of the origin of an exposure in `burst.toml`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Reported => "reported",
            Self::Predicted => "predicted",
            Self::Verified => "verified",
            Self::Measured => "measured",
            Self::Unknown => "unknown",
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Write {
    /// Sequence number of the newest frame that the sensor had finished before the write.
    after: u32,
    /// Index of the written exposure in the list of exposures.
    slot: usize,
    /// Number of frames, from the first on which the write can act, whose exposure is uncertain because of a late write.
    doubt: u32,
}

/// Log of control writes, from which the exposures of frames follow.
#[derive(Clone, Debug)]
pub struct Schedule {
    delay: u32,
    slots: usize,
    writes: VecDeque<Write>,
    /// Index of the exposure that acts before the first write.
    initial: usize,
    /// Whether the exposure `initial` is certain.
    initial_certain: bool,
}

/// Returns whether sequence number `a` comes after `b`; sequence numbers wrap.
#[must_use]
pub const fn is_after(a: u32, b: u32) -> bool {
    a != b && a.wrapping_sub(b) < 1 << 31
}

/// The exposure that acts on a frame.
struct Acting {
    /// Index of the frame's exposure in the list of exposures.
    slot: usize,
    /// False if the write of the exposure may have been too late for the frame.
    certain: bool,
}

impl Schedule {
    /// Creates a schedule of `slots` exposures, of which `initial` was set before the stream began.
    #[must_use]
    pub fn new(slots: usize, initial: usize, delay: u32) -> Self {
        Self {
            delay: delay.min(MAX_DELAY),
            slots: slots.max(1),
            writes: VecDeque::with_capacity(KEPT),
            initial,
            initial_certain: true,
        }
    }

    /// Marks the initial exposure as uncertain, for a camera that started with another one.
    pub fn doubt_initial(&mut self) {
        self.initial_certain = false;
    }

    /// Logs that a write after frame `sequence` failed: the exposure is uncertain until the next write acts.
    pub fn failed(&mut self, sequence: u32) {
        let target = sequence.wrapping_add(1).wrapping_add(self.delay);
        let stays = self.acting(target.wrapping_sub(1), self.delay).slot;
        self.wrote(sequence, stays, u32::MAX);
    }

    /// Returns the control delay of the schedule, frames after the next one.
    #[must_use]
    pub fn delay(&self) -> u32 {
        self.delay
    }

    /// Replaces the control delay, also for past writes.
    pub fn set_delay(&mut self, delay: u32) {
        self.delay = delay.min(MAX_DELAY);
    }

    /// Returns the index of the exposure to write after frame `sequence`. If the write acts on frame n, it is the exposure after that of
    /// frame n - 1 in the order of the burst.
    #[must_use]
    pub fn due(&self, sequence: u32) -> usize {
        let target = sequence.wrapping_add(1).wrapping_add(self.delay);
        (self.acting(target.wrapping_sub(1), self.delay).slot + 1) % self.slots
    }

    /// Logs that exposure `slot` was written after frame `after`; `doubt` is the number of frames that may have begun before the write was
    /// complete.
    pub fn wrote(&mut self, after: u32, slot: usize, doubt: u32) {
        if self.writes.len() == KEPT {
            self.writes.pop_front();
        }
        self.writes.push_back(Write { after, slot, doubt });
    }

    /// Returns the index of the exposure of frame `sequence`; `None` if a late write makes it uncertain.
    #[must_use]
    pub fn exposure_of(&self, sequence: u32) -> Option<usize> {
        self.exposure_with(sequence, self.delay)
    }

    /// Returns the index of the exposure that frame `sequence` has if the control delay is `delay`. The delay that matches the brightness
    /// ratios is found by comparison of the results.
    #[must_use]
    pub fn exposure_with(&self, sequence: u32, delay: u32) -> Option<usize> {
        let Acting { slot, certain } = self.acting(sequence, delay);
        certain.then_some(slot)
    }

    /// Returns the exposure of the newest write that acts on frame `sequence` if the control delay is `delay`.
    fn acting(&self, sequence: u32, delay: u32) -> Acting {
        let first = |w: &Write| w.after.wrapping_add(1).wrapping_add(delay);
        let acts = |w: &&Write| !is_after(first(w), sequence);
        match self.writes.iter().rev().find(acts) {
            Some(w) => Acting { slot: w.slot, certain: sequence.wrapping_sub(first(w)) >= w.doubt },
            None => Acting { slot: self.initial, certain: self.writes.len() < KEPT && self.initial_certain },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computed by hand: delay 2, slots 0 1 2, one write after each frame from frame 10.
    #[test]
    fn a_write_acts_after_its_delay() {
        let mut s = Schedule::new(3, 0, 2);
        for (after, slot) in [(10, 1), (11, 2), (12, 0)] {
            assert_eq!(s.due(after), slot, "after {after}");
            s.wrote(after, slot, 0);
        }
        let found: Vec<_> = (10..17).map(|f| s.exposure_of(f).expect("certain")).collect();
        assert_eq!(found, [0, 0, 0, 1, 2, 0, 0], "frames 10 to 16");
    }

    /// Computed by hand: frame 11 is lost, so no write follows it, and frame 13 keeps the exposure of frame 12.
    #[test]
    fn a_lost_frame_does_not_shift_exposures() {
        let mut s = Schedule::new(3, 0, 1);
        s.wrote(10, 1, 0);
        assert_eq!(s.due(12), 2, "12 and 13 have 1, so 14 gets 2");
        s.wrote(12, 2, 0);
        let found: Vec<_> = (11..16).map(|f| s.exposure_of(f).expect("certain")).collect();
        assert_eq!(found, [0, 1, 1, 2, 2], "frames 11 to 15");
    }

    #[test]
    fn a_late_write_makes_one_frame_uncertain_across_a_sequence_wrap() {
        let mut s = Schedule::new(2, 0, 0);
        s.wrote(u32::MAX, 1, 1);
        let found = [u32::MAX, 0, 1].map(|f| s.exposure_of(f));
        assert_eq!(found, [Some(0), None, Some(1)], "round the wrap");
    }

    #[test]
    fn frames_older_than_the_log_have_no_exposure() {
        let mut s = Schedule::new(2, 0, 0);
        (0..100).for_each(|f| s.wrote(f, f as usize % 2, 0));
        assert_eq!((s.exposure_of(20), s.exposure_of(99)), (None, Some(0)), "long past, and just now");
    }
}
