//! Durations of the stages: histograms of fixed size, and counts of the frames that exceeded a budget.

mod recent;

pub use recent::Percentiles;

use hdrhistogram::Histogram;
use hemilux_core::wire::{Latency, Overrun, STAGES};
use recent::{Halves, Recent};
use std::fmt;
use std::time::Instant;

/// Longest duration of a stage that the histograms resolve, microseconds; longer ones are counted as this duration.
const LONGEST_US: u64 = 60_000_000;

/// Number of significant decimal digits of a percentile. With two digits, the histograms of all stages use 210 KiB.
const DIGITS: u8 = 2;

/// Weight of the newest frame interval in the smoothed frame rate: the last ten frames have 65 % of the weight.
const SMOOTHING: f32 = 0.1;

/// Range of the budgets of stages that the settings accept, milliseconds.
pub const BUDGETS_MS: std::ops::RangeInclusive<f32> = 0.01..=60_000.0;

/// Budgets of the durations of the stages, microseconds, in the order of [`Latency::NAMES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budgets(pub [u32; STAGES]);

impl Default for Budgets {
    /// Returns the budgets for ten frames per second on a small board: one frame period for the capture, half of it for all other stages.
    fn default() -> Self {
        Self([110_000, 30_000, 6_000, 12_000, 2_000, 10_000, 60_000])
    }
}

impl Budgets {
    /// Returns the budget of stage `i`, milliseconds; 0 for an index beyond the last stage.
    #[must_use]
    pub fn ms(&self, i: usize) -> f32 {
        self.0.get(i).map_or(0.0, |us| *us as f32 / 1e3)
    }

    /// Returns the budget from the end of a burst to the finished set, microseconds.
    #[must_use]
    pub fn total(&self) -> u32 {
        self.0[STAGES - 1]
    }

    /// Returns these budgets for a probe that processes one of `every` bursts: that of the total is `every` times as long.
    #[must_use]
    pub fn at_rate(mut self, every: u32) -> Self {
        self.0[STAGES - 1] = self.total().saturating_mul(every);
        self
    }

    /// Sets the budget of stage `i` to `ms` milliseconds, rounded to the nearest microsecond.
    pub fn set_ms(&mut self, i: usize, ms: f32) {
        if let Some(us) = self.0.get_mut(i) {
            *us = (ms * 1e3).round() as u32;
        }
    }
}

/// Parses budgets such as `front=30,total=60`: milliseconds by stage, returned in the order of [`Latency::NAMES`].
///
/// # Errors
/// A message with the value that was found and the form that was expected.
pub fn read_budgets(text: &str) -> Result<[Option<f32>; STAGES], String> {
    let mut budgets = [None; STAGES];
    for pair in text.split(',') {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        let stage = Latency::NAMES.iter().position(|stage| *stage == name.trim());
        let ms = value.trim().parse().ok().filter(|ms| BUDGETS_MS.contains(ms));
        let (Some(stage), Some(ms)) = (stage, ms) else {
            return Err(format!(
                "found '{pair}', expected STAGE=MILLISECONDS with {} and {} to {}, such as front=30,total=60",
                Latency::NAMES.join(", "),
                BUDGETS_MS.start(),
                BUDGETS_MS.end()
            ));
        };
        budgets[stage] = Some(ms);
    }
    Ok(budgets)
}

/// Statistics of the durations of one stage.
#[derive(Clone, Debug)]
struct Durations {
    /// The histogram of the durations; `None` only if the library refused `LONGEST_US` and `DIGITS`, which a test excludes.
    histogram: Option<Histogram<u32>>,
    most_us: u32,
    overruns: u64,
    recent: Recent,
}

impl Durations {
    fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_US, DIGITS).ok();
        Self { histogram, most_us: 0, overruns: 0, recent: Recent::new() }
    }

    fn add(&mut self, us: u32, budget_us: u32) {
        if let Some(histogram) = &mut self.histogram {
            histogram.saturating_record(us.into());
        }
        self.most_us = self.most_us.max(us);
        self.overruns += u64::from(us > budget_us);
        self.recent.add(us);
    }

    /// Returns the duration of the stage that the fraction `part` of all frames do not exceed, microseconds, at most the longest; 0 without
    /// frames.
    fn percentile(&self, part: f64) -> u32 {
        let value = self.histogram.as_ref().map_or(0, |h| h.value_at_quantile(part));
        u32::try_from(value).unwrap_or(u32::MAX).min(self.most_us)
    }
}

/// Returns the number of counters of the histograms of all stages, four bytes each.
#[must_use]
pub fn counters() -> usize {
    // Each stage has one histogram since the start and two for the last minute.
    3 * STAGES * Durations::new().histogram.map_or(0, |h| h.distinct_values())
}

/// Statistics of the durations of one stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stage {
    /// Median of the stage's durations since the start, microseconds.
    pub p50: u32,
    /// 95th percentile of the stage's durations since the start, microseconds.
    pub p95: u32,
    /// 99th percentile of the stage's durations since the start, microseconds.
    pub p99: u32,
    /// Longest duration of the stage since the start, microseconds.
    pub most: u32,
    /// Number of frames in which the stage exceeded its budget.
    pub overruns: u64,
    /// The budget of the stage's duration, microseconds.
    pub budget: u32,
    /// Percentiles of the stage's durations over the last 30 to 60 seconds.
    pub recent: Percentiles,
}

/// Statistics of the durations of all stages.
#[derive(Clone, Debug)]
pub struct Timings {
    stages: [Durations; STAGES],
    frames: u64,
    budgets: Budgets,
    /// Start of the newest frame; `None` before the first one.
    started: Option<Instant>,
    /// Smoothed interval between the starts of frames, seconds; 0 before the second frame.
    interval_s: f32,
    halves: Halves,
}

impl Timings {
    /// Creates statistics of the stages without frames.
    #[must_use]
    pub fn new(budgets: Budgets) -> Self {
        Self {
            stages: std::array::from_fn(|_| Durations::new()),
            frames: 0,
            budgets,
            started: None,
            interval_s: 0.0,
            halves: Halves::default(),
        }
    }

    /// Updates the frame rate with `now`, the start of a frame.
    pub fn start_frame(&mut self, now: Instant) {
        for _ in 0..self.halves.turns(now) {
            self.stages.iter_mut().for_each(|stage| stage.recent.turn());
        }
        let Some(before) = self.started.replace(now) else { return };
        let newest = now.saturating_duration_since(before).as_secs_f32();
        let kept = self.interval_s;
        self.interval_s = if kept > 0.0 { kept + SMOOTHING * (newest - kept) } else { newest };
    }

    /// Returns the smoothed frame rate, Hz; 0 before the second frame.
    #[must_use]
    pub fn rate_hz(&self) -> f32 {
        if self.interval_s > 0.0 { 1.0 / self.interval_s } else { 0.0 }
    }

    /// Adds the durations of a frame; one of `every` bursts is processed. Returns the stages that exceeded their budgets.
    pub fn add(&mut self, latency: &Latency, every: u32) -> Overrun {
        let budgets = self.budgets.at_rate(every);
        for ((stage, us), budget) in self.stages.iter_mut().zip(latency.all()).zip(budgets.0) {
            stage.add(us, budget);
        }
        self.frames += 1;
        Overrun::of(latency, &budgets.0)
    }

    /// Sets the budgets for later frames; the counts of earlier overruns stay.
    pub fn set_budgets(&mut self, budgets: Budgets) {
        self.budgets = budgets;
    }

    /// Returns the number of frames whose durations were added.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Returns the statistics of each stage, in the order of [`Latency::NAMES`].
    #[must_use]
    pub fn stages(&self) -> [Stage; STAGES] {
        std::array::from_fn(|i| {
            let h = &self.stages[i];
            let [p50, p95, p99] = [0.5, 0.95, 0.99].map(|part| h.percentile(part));
            let (budget, recent) = (self.budgets.0[i], h.recent.percentiles());
            Stage { p50, p95, p99, most: h.most_us, overruns: h.overruns, budget, recent }
        })
    }
}

/// Formats a short table for people, milliseconds.
impl fmt::Display for Timings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames = self.frames();
        writeln!(
            f,
            "{:<9}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}",
            "ms", "p50", "p95", "p99", "max", "budget", "over"
        )?;
        for (name, s) in Latency::NAMES.iter().zip(self.stages()) {
            write!(f, "{name:<9}")?;
            for us in [s.p50, s.p95, s.p99, s.most, s.budget] {
                write!(f, "{:>10.3}", f64::from(us) / 1e3)?;
            }
            writeln!(f, "{:>10}", s.overruns)?;
        }
        write!(f, "{frames} frames")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn percentiles_are_within_one_per_cent_over_the_whole_range() {
        for us in [1, 9, 100, 12_345, 999_999, 59_999_999] {
            let mut stage = Durations::new();
            stage.add(us, u32::MAX);
            stage.add(u32::MAX, u32::MAX);
            let found = f64::from(stage.percentile(0.5));
            assert!((found / f64::from(us) - 1.0).abs() < 0.01, "{us}: {found}");
            assert!(stage.percentile(1.0) >= 60_000_000, "longer durations count as the longest");
        }
        let bytes = counters() * size_of::<u32>();
        assert!((1..=216 << 10).contains(&bytes), "{bytes}");
    }

    #[test]
    fn percentiles_maximum_and_overruns_match_the_added_durations() {
        let mut timings = Timings::new(Budgets([900; STAGES]));
        for us in 1..=1000 {
            let over = timings.add(&Latency { front: us, total: 7, ..Latency::default() }, 1);
            assert_eq!(over.names().eq(["front"]), us > 900, "frame of {us} µs");
        }
        let [_, front, _, _, _, _, total] = timings.stages();
        for (found, exact) in [(front.p50, 500.0), (front.p95, 950.0), (front.p99, 990.0)] {
            assert!((f64::from(found) / exact - 1.0).abs() < 0.01, "{front:?}");
        }
        assert_eq!((front.most, front.overruns, front.budget), (1000, 100, 900));
        assert_eq!((total.p50, total.p99, total.most, total.overruns), (7, 7, 7, 0));
        assert_eq!(Timings::new(Budgets::default()).stages()[0].p99, 0, "no frames");
    }

    #[test]
    fn a_frame_of_every_second_burst_has_twice_the_budget_of_the_total_and_no_more_of_a_stage() {
        let mut timings = Timings::new(Budgets([900; STAGES]));
        let late = Latency { front: 1000, total: 1700, ..Latency::default() };
        assert!(timings.add(&late, 2).names().eq(["front"]));
        assert!(timings.add(&late, 1).names().eq(["front", "total"]));
    }

    #[test]
    fn the_frame_rate_follows_a_change_of_the_interval_within_forty_frames() {
        let mut timings = Timings::new(Budgets::default());
        let mut now = Instant::now();
        timings.start_frame(now);
        assert!(timings.rate_hz().abs() < f32::EPSILON, "no interval yet");
        for (ms, frames, hz) in [(100, 1, 10.0), (100, 5, 10.0), (50, 40, 20.0)] {
            for _ in 0..frames {
                now += Duration::from_millis(ms);
                timings.start_frame(now);
            }
            assert!((timings.rate_hz() / hz - 1.0).abs() < 0.02, "{ms} ms: {} Hz", timings.rate_hz());
        }
    }

    #[test]
    fn table_has_a_line_per_stage_and_the_number_of_frames() {
        let mut timings = Timings::new(Budgets::default());
        timings.add(&Latency { front: 31_000, ..Latency::default() }, 1);
        let text = timings.to_string();
        let front: Vec<_> =
            text.lines().find(|l| l.starts_with("front")).expect("front").split_whitespace().collect();
        assert_eq!(front, ["front", "31.000", "31.000", "31.000", "31.000", "30.000", "1"], "{text}");
        assert_eq!((text.lines().count(), text.lines().last()), (STAGES + 2, Some("1 frames")), "{text}");
    }

    #[test]
    fn budgets_are_read_by_stage_and_others_stay() {
        let budgets = read_budgets("front=25,total=0.5");
        let expected = [None, Some(25.0), None, None, None, None, Some(0.5)];
        assert_eq!(budgets, Ok(expected), "two are set");
        for wrong in
            ["", "front", "front=", "front=-1", "front=nan", "front=0", "speed=3", "front=1e9", "front=1,"]
        {
            let line = read_budgets(wrong).expect_err(wrong);
            assert!(line.contains("expected STAGE=MILLISECONDS with capture, front,"), "{wrong}: {line}");
        }
    }
}
