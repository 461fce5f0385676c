//! Assigns frame numbers that increase by one per frame interval, for drivers that number their frames otherwise.
//!
//! Exposures are assigned to frames by number. Some drivers number all frames 0, restart at 0 while they stream, or jump ahead; where the
//! elapsed time contradicts a driver's number, the elapsed number of frame intervals replaces the step.

use super::schedule::is_after;

/// Number of successive frames with the first frame's number after which frames are numbered by time.
const STILL: u32 = 3;

/// Largest step between the driver's numbers of two frames that is accepted without comparison with the elapsed
/// time.
const PLAIN_STEP: u32 = 8;

/// Largest accepted ratio of the step between two of the driver's numbers to the number of frame intervals that
/// have elapsed.
const MOST_AHEAD: u32 = 4;

/// Number of successive frames after which a constant step of more than 1 per frame interval is taken as the unit
/// of the driver's numbers.
const STEADY: u32 = 4;

/// The newest frame that has a number.
#[derive(Clone, Copy, Debug)]
struct Newest {
    /// Number of the frame from the driver.
    told: u32,
    /// Number that was assigned to the frame.
    number: u32,
    time_ns: u64,
}

/// Assigns numbers to the frames of a stream.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Numbers {
    newest: Option<Newest>,
    /// True if the driver's numbers have increased.
    has_risen: bool,
    /// Number of successive frames that have the number of the first frame.
    still: u32,
    /// The observed step of the driver's numbers per frame interval, and the number of successive frames that
    /// had this step.
    stride: u32,
    steady: u32,
    /// The driver's number of the frame before, if that frame was dropped.
    dropped: Option<u32>,
}

/// The timestamp of a frame and the time at which it was taken from the driver, nanoseconds of CLOCK_MONOTONIC.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameTimes {
    /// Timestamp that the driver gives the frame, nanoseconds.
    pub stamped_ns: u64,
    pub now_ns: u64,
    /// Frame interval, seconds.
    pub period_s: f64,
}

impl Numbers {
    /// Returns the assigned number of the frame whose number from the driver is `told`; `None` if the driver repeats
    /// an earlier frame's number.
    pub fn number(&mut self, told: u32, times: FrameTimes) -> Option<u32> {
        let Some(last) = self.newest else {
            self.newest = Some(Newest { told, number: told, time_ns: times.newest_ns(0) });
            return Some(told);
        };
        let time_ns = times.newest_ns(last.time_ns);
        let elapsed = times.intervals(last.time_ns, time_ns);
        let dropped = self.dropped.take();
        let step = if is_after(told, last.told) {
            self.has_risen = true;
            let step = told.wrapping_sub(last.told);
            if step <= PLAIN_STEP.max(MOST_AHEAD.saturating_mul(elapsed)) {
                self.in_intervals(step, elapsed)
            } else {
                elapsed
            }
        } else if told == last.told && !self.has_risen {
            self.still += 1;
            if self.still < STILL {
                return None;
            }
            elapsed
        } else if dropped.is_some_and(|before| told == before.wrapping_add(1)) {
            elapsed
        } else {
            self.dropped = Some(told);
            return None;
        };
        let number = last.number.wrapping_add(step);
        self.newest = Some(Newest { told, number, time_ns });
        Some(number)
    }
}

impl Numbers {
    /// Converts a step of the driver's numbers to frame intervals: some drivers count fields, or the frames of a faster
    /// sensor.
    fn in_intervals(&mut self, step: u32, elapsed: u32) -> u32 {
        if elapsed == 1 {
            self.steady = if step == self.stride { self.steady.saturating_add(1) } else { 1 };
            self.stride = step;
        }
        let is_unit = self.stride > 1 && self.steady >= STEADY && step.is_multiple_of(self.stride);
        if is_unit { step / self.stride } else { step }
    }
}

impl FrameTimes {
    /// Returns the frame's timestamp if it lies between `last_ns` and the present, else the present time.
    fn newest_ns(&self, last_ns: u64) -> u64 {
        let is_good = self.stamped_ns > last_ns && self.stamped_ns <= self.now_ns;
        if is_good { self.stamped_ns } else { self.now_ns }
    }

    /// Returns the number of frame intervals between two times, at least 1.
    fn intervals(&self, from_ns: u64, to_ns: u64) -> u32 {
        let seconds = to_ns.saturating_sub(from_ns) as f64 * 1e-9;
        (seconds / self.period_s).round().clamp(1.0, 1e9) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Assigns numbers to frames at an interval of 40 ms; each frame is given by the driver's number and by its
    /// time in frame intervals.
    fn numbered(frames: &[(u32, u64)]) -> Vec<Option<u32>> {
        let mut numbers = Numbers::default();
        let times =
            |at: u64| FrameTimes { stamped_ns: at * 40_000_000, now_ns: at * 40_000_000 + 5, period_s: 0.04 };
        frames.iter().map(|(told, at)| numbers.number(*told, times(100 + at))).collect()
    }

    #[test]
    fn numbers_of_the_driver_are_kept_with_gaps_and_across_the_wrap() {
        let found = numbered(&[(u32::MAX - 1, 0), (u32::MAX, 1), (2, 4), (50, 52)]);
        assert_eq!(found, [Some(u32::MAX - 1), Some(u32::MAX), Some(2), Some(50)], "as told");
    }

    #[test]
    fn repeated_numbers_are_dropped() {
        assert_eq!(numbered(&[(5, 0), (6, 1), (6, 2), (8, 3)]), [Some(5), Some(6), None, Some(8)], "once");
        assert_eq!(
            numbered(&[(5, 0), (6, 1), (5, 2), (8, 3)]),
            [Some(5), Some(6), None, Some(8)],
            "an old one"
        );
    }

    #[test]
    fn frames_that_all_have_number_0_are_numbered_by_time() {
        let found = numbered(&[(0, 0), (0, 1), (0, 2), (0, 3), (0, 4), (0, 7)]);
        assert_eq!(found, [Some(0), None, None, Some(3), Some(4), Some(7)], "two lost before the last");
    }

    #[test]
    fn numbers_that_rise_by_two_per_frame_are_halved() {
        let found = numbered(&[(0, 0), (2, 1), (4, 2), (6, 3), (8, 4), (10, 5), (14, 7), (16, 8)]);
        let expected = [0, 2, 4, 6, 7, 8, 10, 11].map(Some);
        assert_eq!(found, expected, "after four frames, with one lost");
    }

    #[test]
    fn numbers_that_restart_or_jump_follow_the_time() {
        let found = numbered(&[(500, 0), (501, 1), (0, 2), (1, 3), (2, 4)]);
        assert_eq!(found, [Some(500), Some(501), None, Some(503), Some(504)], "restarted");
        let found = numbered(&[(500, 0), (501, 1), (1502, 2), (1503, 3)]);
        assert_eq!(found, [Some(500), Some(501), Some(502), Some(503)], "ahead by a thousand");
    }
}
