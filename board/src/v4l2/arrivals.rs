//! Model of the times at which frames arrive: a grid of one frame per period, by which the arrival of the next frame is predicted.
//!
//! The grid is fitted to the times at which frames were due, so that one late frame (a busy driver or board) does not shift the prediction
//! of the next one. Driver timestamps are used while they advance with the arrivals on CLOCK_MONOTONIC; timestamps of another clock,
//! constant timestamps and timestamps that jump are replaced by the arrival time.

/// Largest shift of the grid from one frame to the next, in frame periods. The shift lets the grid follow a camera clock that differs from
/// CLOCK_MONOTONIC: with a smaller limit, a slow camera counts as late, with a larger one, a single late frame shifts the grid.
const DRIFT: f64 = 0.02;

/// Largest age of a driver's timestamp when the frame arrives, in frame periods: exposure, transfer and a full
/// queue.
const OLDEST: f64 = 8.0;

/// Number of frames after which the least age of a timestamp is computed from newer frames alone, so that a jump of the timestamps has no
/// lasting effect.
const WINDOW: u32 = 16;

/// Weight of the newest frame interval in the measured frame period: an average over about 16 frames.
const SMOOTHING: f64 = 1.0 / 16.0;

/// Model of a camera's frame arrivals.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrivals {
    period_ns: f64,
    /// Least time from a frame's timestamp to its arrival, nanoseconds, over the present window of frames and the
    /// window before.
    age_ns: u64,
    window_age_ns: u64,
    window: u32,
    /// Newest timestamp of the driver, and whether timestamps of the driver are used.
    stamped_ns: u64,
    /// Time of the newest frame on CLOCK_MONOTONIC.
    time_ns: u64,
    /// Sequence number of the newest frame, and its arrival time in nanoseconds of CLOCK_MONOTONIC.
    newest: Option<u32>,
    arrived_ns: u64,
    /// Time at which the newest frame was due, nanoseconds of CLOCK_MONOTONIC.
    due_ns: f64,
}

impl Arrivals {
    /// Creates the model before the first frame; `period_s` is the frame interval that the driver reports,
    /// seconds.
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

    /// Stores the arrival of frame `sequence`, fetched at `now_ns`, with the driver's timestamp `stamped_ns`; returns
    /// true if the timestamp is used.
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
            // A single late frame hardly changes the measured period; a lasting change is followed.
            let most = self.period_ns / 8.0;
            self.period_ns += SMOOTHING * (measured - self.period_ns).clamp(-most, most);
        }
        let due = self.due_ns + steps * self.period_ns * (1.0 + DRIFT);
        let arrived = arrived_ns as f64;
        // A gap of more than one period is a pause of the camera.
        self.due_ns = if arrived > due + self.period_ns { arrived } else { arrived.min(due) };
        self.arrived_ns = arrived_ns;
    }

    /// Returns whether a timestamp can be of CLOCK_MONOTONIC: later than the timestamp before, not in the future, and no older than
    /// a full queue allows.
    fn is_good(&self, stamped_ns: u64, now_ns: u64) -> bool {
        let age = now_ns.saturating_sub(stamped_ns) as f64;
        stamped_ns > self.stamped_ns && stamped_ns <= now_ns && age <= OLDEST * self.period_ns
    }

    /// Returns the arrival time of a frame that may have waited in the driver's queue: its timestamp plus the least
    /// recent age of a timestamp.
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

    /// Returns the CLOCK_MONOTONIC time of the newest frame: the driver's timestamp, or the arrival time.
    pub fn time_ns(&self) -> u64 {
        self.time_ns
    }

    /// Returns the arrival time of the newest frame, nanoseconds of CLOCK_MONOTONIC.
    pub fn arrived_ns(&self) -> u64 {
        self.arrived_ns
    }

    /// Returns the number of frame periods from the time at which the newest frame was due to `now_ns`.
    pub fn lateness(&self, now_ns: u64) -> f64 {
        (now_ns as f64 - self.due_ns).max(0.0) / self.period_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Computed by hand: a period of 40 ms, frame 2 is 30 ms late, frame 3 is on time.
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
    fn a_slower_period_is_adopted_and_no_longer_counts_as_late() {
        let mut a = Arrivals::new(0.033, 0);
        let late = (1..200u64).filter(|n| {
            a.note(*n as u32, n * 50 * MS, n * 50 * MS);
            a.lateness(n * 50 * MS + MS) > 0.7
        });
        assert!(late.count() < 60, "its own period is learnt");
        assert!(a.lateness(199 * 50 * MS + MS) < 0.1, "{}", a.lateness(199 * 50 * MS + MS));
    }

    #[test]
    fn queued_frames_are_dated_by_their_arrival() {
        let mut a = Arrivals::new(0.04, 0);
        for n in 1..10u64 {
            a.note(n as u32, n * 40 * MS, n * 40 * MS + 5 * MS);
        }
        a.note(10, 400 * MS, 435 * MS);
        assert!(a.lateness(435 * MS) > 0.7, "{}", a.lateness(435 * MS));
    }

    /// The driver's timestamps are of the wall clock, constant, at half speed, or jump by seconds: the time of each frame is within one queue
    /// length of the present.
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
