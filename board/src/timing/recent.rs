//! Durations of the stages over the last 30 to 60 seconds: the sum of two histograms, each filled for 30 seconds.

use super::{DIGITS, LONGEST_US};
use hdrhistogram::Histogram;
use std::time::{Duration, Instant};

/// Time for which one of the two histograms is filled.
const HALF: Duration = Duration::from_secs(30);

/// Percentiles of a stage's durations over the last 30 to 60 seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Percentiles {
    /// Median of the stage's durations over the last minute, microseconds.
    pub p50: u32,
    /// 95th percentile of the stage's durations, microseconds.
    pub p95: u32,
    /// 99th percentile of the stage's durations, microseconds.
    pub p99: u32,
}

/// Durations of one stage over the last 30 to 60 seconds.
#[derive(Clone, Debug)]
pub(super) struct Recent {
    /// The two histograms; `None` only if the library refused their range, which a test excludes.
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

    /// Clears the older of the two histograms and fills it from now on.
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

/// The time at which the filling of the present histogram began, for all stages.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Halves {
    began: Option<Instant>,
}

impl Halves {
    /// Returns the number of exchanges of the histograms, at most two, that are due before a frame at `now` is added.
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
    fn frames_count_for_at_least_half_a_minute_and_at_most_a_minute() {
        let (mut recent, mut halves, start) = (Recent::new(), Halves::default(), Instant::now());
        let mut slow = [0; 100];
        for (second, slow) in slow.iter_mut().enumerate() {
            let now = start + Duration::from_secs(second as u64);
            (0..halves.turns(now)).for_each(|_| recent.turn());
            // The frames of the first ten seconds are slow, the later ones fast.
            (0..10).for_each(|_| recent.add(if second < 10 { 50_000 } else { 1_000 }));
            *slow = recent.percentiles().p99;
        }
        assert!(slow[..40].iter().all(|us| *us > 45_000), "{slow:?}");
        assert!(slow[61..].iter().all(|us| *us < 1_100), "{slow:?}");
        assert_eq!(Recent::new().percentiles(), Percentiles::default(), "no frames");
    }

    #[test]
    fn frames_before_a_pause_of_a_minute_are_not_counted() {
        let (mut recent, mut halves, start) = (Recent::new(), Halves::default(), Instant::now());
        assert_eq!(halves.turns(start), 0);
        recent.add(50_000);
        (0..halves.turns(start + Duration::from_secs(61))).for_each(|_| recent.turn());
        recent.add(1_000);
        assert!(recent.percentiles().p99 < 1_100, "{:?}", recent.percentiles());
    }
}
