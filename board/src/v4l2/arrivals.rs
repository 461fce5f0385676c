//! The grid on which frames arrive: how much time is left before the next one begins.
//!
//! A frame that comes late, because the driver or the board was busy, is followed by one in time: the grid is that of the times at which frames
//! were due. Drivers' timestamps refine it only while they advance with the arrivals on CLOCK_MONOTONIC; stamps of another clock, constant
//! or jumping ones are replaced by the arrival.

/// Part of a period by which frames are allowed to drift against the grid from one to the next, so that it follows a clock that goes
/// otherwise than ours. Less would call a slower camera late, more would forget a late frame too soon.
const DRIFT: f64 = 0.02;

/// Largest age of a timestamp on arrival, periods: the exposure, the transfer and a full queue.
const OLDEST: f64 = 8.0;

/// Frames after which the least age is that of the newest ones alone, so that a jump of the stamps is forgotten.
const WINDOW: u32 = 16;

/// Weight of the newest interval in the measured period: about the last sixteen count.
const SMOOTHING: f64 = 1.0 / 16.0;

/// The grid on which a camera's frames arrive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrivals {
    period_ns: f64,
    /// Least time from a frame's timestamp to its arrival, in this window of frames and the one before.
    age_ns: u64,
    window_age_ns: u64,
    window: u32,
    /// The newest timestamp of the driver, and whether it is used.
    stamped_ns: u64,
    /// Time of the newest frame on CLOCK_MONOTONIC.
    time_ns: u64,
    /// Number of the newest frame and when it came.
    newest: Option<u32>,
    arrived_ns: u64,
    /// When it should have come.
    due_ns: f64,
}

impl Arrivals {
    /// Before the first frame; `period_s` is what the driver promises.
    pub fn new(period_s: f64, now_ns: u64) -> Self {
        Self {
            period_ns: period_s * 1e9,
            age_ns: u64::MAX,
            window_age_ns: u64::MAX,
            window: 0,
            stamped_ns: 0,
            time_ns: now_ns,
            newest: None,
            arrived_ns: now_ns,
            due_ns: now_ns as f64,
        }
    }

    /// Notes frame `sequence`, fetched at `now_ns`, with the driver's timestamp; true if that timestamp is used.
    pub fn note(&mut self, sequence: u32, stamped_ns: u64, now_ns: u64) -> bool {
        let good = self.is_good(stamped_ns, now_ns);
        self.stamped_ns = stamped_ns;
        self.time_ns = if good { stamped_ns } else { now_ns };
        let arrived_ns = if good { self.arrival(stamped_ns, now_ns) } else { now_ns };
        self.advance(sequence, arrived_ns);
        good
    }

    fn advance(&mut self, sequence: u32, arrived_ns: u64) {
        let steps = self.newest.replace(sequence).map(|before| f64::from(sequence.wrapping_sub(before)));
        let Some(steps) = steps.filter(|s| *s >= 1.0) else {
            (self.arrived_ns, self.due_ns) = (arrived_ns, arrived_ns as f64);
            return;
        };
        let measured = arrived_ns.saturating_sub(self.arrived_ns) as f64 / steps;
        if measured > 0.5 * self.period_ns && measured < 2.0 * self.period_ns {
            // One late frame hardly counts; a period that is another is learnt all the same.
            let most = self.period_ns / 8.0;
            self.period_ns += SMOOTHING * (measured - self.period_ns).clamp(-most, most);
        }
        let due = self.due_ns + steps * self.period_ns * (1.0 + DRIFT);
        let arrived = arrived_ns as f64;
        // After more than a period the camera itself has paused.
        self.due_ns = if arrived > due + self.period_ns { arrived } else { arrived.min(due) };
        self.arrived_ns = arrived_ns;
    }

    /// Whether a timestamp is of CLOCK_MONOTONIC: not constant, not of the future, and no older than a full queue.
    fn is_good(&self, stamped_ns: u64, now_ns: u64) -> bool {
        let age = now_ns.saturating_sub(stamped_ns) as f64;
        stamped_ns > self.stamped_ns && stamped_ns <= now_ns && age <= OLDEST * self.period_ns
    }

    /// When a frame that may have waited in the queue arrived: its timestamp and the least age seen lately.
    fn arrival(&mut self, stamped_ns: u64, now_ns: u64) -> u64 {
        let age = now_ns.saturating_sub(stamped_ns);
        self.window += 1;
        self.window_age_ns = self.window_age_ns.min(age);
        self.age_ns = self.age_ns.min(age);
        if self.window >= WINDOW {
            (self.age_ns, self.window_age_ns, self.window) = (self.window_age_ns, u64::MAX, 0);
        }
        stamped_ns.saturating_add(self.age_ns).min(now_ns)
    }

    /// CLOCK_MONOTONIC of the newest frame: the driver's timestamp, or its arrival.
    pub fn time_ns(&self) -> u64 {
        self.time_ns
    }

    /// When the newest frame came.
    pub fn arrived_ns(&self) -> u64 {
        self.arrived_ns
    }

    /// Periods that have passed since the newest frame should have come.
    pub fn lateness(&self, now_ns: u64) -> f64 {
        (now_ns as f64 - self.due_ns).max(0.0) / self.period_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// On paper: every 40 ms, frame 2 comes 30 ms late, frame 3 in time.
    #[test]
    fn a_late_frame_leaves_less_time_for_the_next() {
        let mut a = Arrivals::new(0.04, 0);
        a.note(0, 1000 * MS, 1005 * MS);
        a.note(1, 1040 * MS, 1045 * MS);
        assert!(a.lateness(1050 * MS) < 0.2, "in time: {}", a.lateness(1050 * MS));
        a.note(2, 1110 * MS, 1115 * MS);
        assert!(a.lateness(1116 * MS) > 0.7, "the next is near: {}", a.lateness(1116 * MS));
        a.note(3, 1120 * MS, 1125 * MS);
        assert!(a.lateness(1126 * MS) < 0.1, "in time again: {}", a.lateness(1126 * MS));
    }

    #[test]
    fn a_slower_camera_is_not_called_late_for_ever() {
        let mut a = Arrivals::new(0.033, 0);
        let late = (1..200u64).filter(|n| {
            a.note(*n as u32, n * 50 * MS, n * 50 * MS);
            a.lateness(n * 50 * MS + MS) > 0.7
        });
        assert!(late.count() < 60, "its own period is learnt");
        assert!(a.lateness(199 * 50 * MS + MS) < 0.1, "{}", a.lateness(199 * 50 * MS + MS));
    }

    #[test]
    fn frames_that_waited_count_from_when_they_came() {
        let mut a = Arrivals::new(0.04, 0);
        for n in 1..10u64 {
            a.note(n as u32, n * 40 * MS, n * 40 * MS + 5 * MS);
        }
        a.note(10, 400 * MS, 435 * MS);
        assert!(a.lateness(435 * MS) > 0.7, "{}", a.lateness(435 * MS));
    }

    /// Stamps of the wall clock, of a constant, of half the speed and jumping by seconds: each frame's time is within its queue of now.
    #[test]
    fn timestamps_of_another_clock_are_replaced_by_arrivals() {
        let stamps: [fn(u64) -> u64; 5] = [
            |n| 1_700_000_000_000 * MS + n * 40 * MS,
            |_| 1000 * MS,
            |n| n * 20 * MS,
            |n| (n * 40 + 3000 * (n / 7 % 2)) * MS,
            |n| (n * 40).saturating_sub(3000 * (n / 7 % 2)) * MS,
        ];
        for (which, stamp) in stamps.into_iter().enumerate() {
            let mut a = Arrivals::new(0.04, 1000 * MS);
            for n in 25..500u64 {
                let now = n * 40 * MS + 5 * MS;
                a.note(n as u32, stamp(n), now);
                let age_ms = now.abs_diff(a.time_ns()) / MS;
                assert!(a.time_ns() <= now && age_ms <= 320, "clock {which}, frame {n}: {age_ms} ms");
                assert!(n < 40 || a.lateness(now) < 0.9, "clock {which}, frame {n}: {}", a.lateness(now));
            }
        }
    }
}
