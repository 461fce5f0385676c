//! How long the stages take: histograms of fixed size, and budgets that are counted when they are overrun.

use hemilux_core::wire::Latency;
use std::fmt;
use std::time::Duration;

/// Buckets per doubling: percentiles are within 1/16 of their value.
const PER_OCTAVE: usize = 8;

/// Doublings from one microsecond: to a little over a minute.
const OCTAVES: usize = 26;

/// Names of the stages, in the order of [`Timings::stages`].
pub const STAGES: [&str; 6] = ["capture", "front", "pyramid", "sample", "encode", "total"];

/// Longest times that stages are meant to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budgets([Duration; STAGES.len()]);

impl Default for Budgets {
    /// Those of ten frames a second on a small board: capture may wait for the whole period, the rest shares half of it.
    fn default() -> Self {
        Self([110, 30, 6, 12, 10, 60].map(Duration::from_millis))
    }
}

/// Durations of one stage.
#[derive(Clone, Debug)]
struct Histogram {
    counts: [u32; PER_OCTAVE * OCTAVES],
    count: u64,
    most_us: u32,
    overruns: u64,
}

impl Histogram {
    const fn new() -> Self {
        Self { counts: [0; PER_OCTAVE * OCTAVES], count: 0, most_us: 0, overruns: 0 }
    }

    fn add(&mut self, us: u32, budget: Duration) {
        if let Some(n) = self.counts.get_mut(bucket(us)) {
            *n = n.saturating_add(1);
        }
        self.count += 1;
        self.most_us = self.most_us.max(us);
        self.overruns += u64::from(u128::from(us) > budget.as_micros());
    }

    /// The upper edge of the bucket that holds the `part`th of all durations, at most the longest.
    fn percentile(&self, part: f64) -> u32 {
        let rank = (part * self.count as f64).ceil() as u64;
        let mut sum = 0;
        let found = self.counts.iter().position(|n| {
            sum += u64::from(*n);
            sum >= rank.max(1)
        });
        found.map_or(0, |i| edge(i + 1)).min(self.most_us)
    }
}

/// The bucket of a duration: linear up to [`PER_OCTAVE`], then [`PER_OCTAVE`] for each doubling.
fn bucket(us: u32) -> usize {
    let us = us as usize;
    if us < PER_OCTAVE {
        return us;
    }
    let octave = us.ilog2() as usize - PER_OCTAVE.ilog2() as usize;
    ((octave + 1) * PER_OCTAVE + (us >> octave) - PER_OCTAVE).min(PER_OCTAVE * OCTAVES - 1)
}

/// The least duration of bucket `i`, microseconds.
fn edge(i: usize) -> u32 {
    if i < PER_OCTAVE {
        return i as u32;
    }
    let octave = i / PER_OCTAVE - 1;
    u32::try_from((PER_OCTAVE + i % PER_OCTAVE) << octave).unwrap_or(u32::MAX)
}

/// What became of one stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stage {
    /// Microseconds that half of all frames stay within.
    pub p50: u32,
    /// As `p50`, 95 of 100.
    pub p95: u32,
    /// As `p50`, 99 of 100.
    pub p99: u32,
    /// The longest.
    pub most: u32,
    /// Frames over budget.
    pub overruns: u64,
    /// The budget.
    pub budget: u32,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { p50, p95, p99, most, overruns, budget } = self;
        write!(f, "{p50} {p95} {p99} {most} µs (p50 p95 p99 max), {overruns} over {budget} µs")
    }
}

/// Durations of all stages.
#[derive(Clone, Debug)]
pub struct Timings {
    stages: [Histogram; STAGES.len()],
    budgets: Budgets,
}

impl Timings {
    /// No frames yet.
    #[must_use]
    pub fn new(budgets: Budgets) -> Self {
        Self { stages: [const { Histogram::new() }; STAGES.len()], budgets }
    }

    /// Adds a frame.
    pub fn add(&mut self, l: &Latency) {
        let all = [l.capture, l.front, l.pyramid, l.sample, l.encode, l.total];
        for ((stage, us), budget) in self.stages.iter_mut().zip(all).zip(self.budgets.0) {
            stage.add(us, budget);
        }
    }

    /// What became of each stage, in the order of [`STAGES`].
    #[must_use]
    pub fn stages(&self) -> [Stage; STAGES.len()] {
        std::array::from_fn(|i| {
            let h = &self.stages[i];
            let [p50, p95, p99] = [0.5, 0.95, 0.99].map(|part| h.percentile(part));
            let budget = u32::try_from(self.budgets.0[i].as_micros()).unwrap_or(u32::MAX);
            Stage { p50, p95, p99, most: h.most_us, overruns: h.overruns, budget }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_meet_without_gaps_and_are_an_eighth_wide() {
        for i in 0..PER_OCTAVE * OCTAVES - 1 {
            assert_eq!(bucket(edge(i)), i, "least of bucket {i}");
            assert_eq!(bucket(edge(i + 1) - 1), i, "most of bucket {i}");
            let wide = f64::from(edge(i + 1) - edge(i)) / f64::from(edge(i).max(1));
            assert!(i <= PER_OCTAVE || wide <= 0.126, "bucket {i}: {wide}");
        }
        assert_eq!(bucket(u32::MAX), PER_OCTAVE * OCTAVES - 1, "what is longer goes to the last");
    }

    #[test]
    fn percentiles_maximum_and_overruns_are_those_of_the_durations() {
        let mut timings = Timings::new(Budgets([Duration::from_micros(900); STAGES.len()]));
        for us in 1..=1000 {
            timings.add(&Latency { front: us, total: 7, ..Latency::default() });
        }
        let [_, front, _, _, _, total] = timings.stages();
        for (found, exact) in [(front.p50, 500.0), (front.p95, 950.0), (front.p99, 990.0)] {
            assert!((f64::from(found) / exact - 1.0).abs() < 0.126, "{front}");
        }
        assert_eq!((front.most, front.overruns, front.budget), (1000, 100, 900));
        assert_eq!((total.p50, total.p99, total.most, total.overruns), (7, 7, 7, 0));
        assert_eq!(Timings::new(Budgets::default()).stages()[0].p99, 0, "no frames");
    }
}
