//! Durations over the last minute: a histogram that is being filled and the one before it.

use super::{DIGITS, LONGEST_US};
use hdrhistogram::Histogram;
use std::time::{Duration, Instant};

/// Time after which the next histogram is filled.
const HALF: Duration = Duration::from_secs(30);

/// Percentiles over the last 30 to 60 seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Percentiles {
    /// Microseconds that half of the frames stay within.
    pub p50: u32,
    /// Microseconds that 95 of 100 frames stay within.
    pub p95: u32,
    /// Microseconds that 99 of 100 frames stay within.
    pub p99: u32,
}

/// Durations of one stage over the last 30 to 60 seconds.
#[derive(Clone, Debug)]
pub(super) struct Recent {
    /// None only if the library refused the range; a test of the whole histogram excludes it.
    halves: Option<[Histogram<u32>; 2]>,
}

impl Recent {
    pub fn new() -> Self {
        let histogram = || Histogram::new_with_bounds(1, LONGEST_US, DIGITS).ok();
        Self { halves: histogram().zip(histogram()).map(|(one, two)| [one, two]) }
    }

    pub fn add(&mut self, us: u32) {
        if let Some([now, _]) = &mut self.halves {
            now.saturating_record(us.into());
        }
    }

    /// Forgets the older histogram and fills it from now on.
    pub fn turn(&mut self) {
        if let Some(halves) = &mut self.halves {
            halves.swap(0, 1);
            halves[0].clear();
        }
    }

    pub fn percentiles(&self) -> Percentiles {
        let Some([now, before]) = &self.halves else { return Percentiles::default() };
        let mut both = now.clone();
        if both.add(before).is_err() || both.is_empty() {
            return Percentiles::default();
        }
        let at = |part| u32::try_from(both.value_at_quantile(part)).unwrap_or(u32::MAX);
        Percentiles { p50: at(0.5), p95: at(0.95), p99: at(0.99) }
    }
}

/// The times at which the histograms change places.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Halves {
    began: Option<Instant>,
}

impl Halves {
    /// Number of times, at most two, that the histograms change places before a frame at `now` is added.
    pub fn turns(&mut self, now: Instant) -> usize {
        let since = now.saturating_duration_since(*self.began.get_or_insert(now));
        if since < HALF {
            return 0;
        }
        self.began = Some(now);
        if since < 2 * HALF { 1 } else { 2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_forgotten_after_a_minute_and_not_before_half_a_minute() {
        let (mut recent, mut halves, start) = (Recent::new(), Halves::default(), Instant::now());
        let mut slow = [0; 100];
        for (second, slow) in slow.iter_mut().enumerate() {
            let now = start + Duration::from_secs(second as u64);
            (0..halves.turns(now)).for_each(|_| recent.turn());
            // Slow for the first ten seconds, fast after them.
            (0..10).for_each(|_| recent.add(if second < 10 { 50_000 } else { 1_000 }));
            *slow = recent.percentiles().p99;
        }
        assert!(slow[..40].iter().all(|us| *us > 45_000), "{slow:?}");
        assert!(slow[61..].iter().all(|us| *us < 1_100), "{slow:?}");
        assert_eq!(Recent::new().percentiles(), Percentiles::default(), "no frames");
    }

    #[test]
    fn after_a_pause_nothing_of_the_time_before_is_left() {
        let (mut recent, mut halves, start) = (Recent::new(), Halves::default(), Instant::now());
        assert_eq!(halves.turns(start), 0);
        recent.add(50_000);
        (0..halves.turns(start + Duration::from_secs(61))).for_each(|_| recent.turn());
        recent.add(1_000);
        assert!(recent.percentiles().p99 < 1_100, "{:?}", recent.percentiles());
    }
}
