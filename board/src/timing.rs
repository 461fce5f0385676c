//! How long the stages take: histograms of fixed size, and budgets that are counted when they are overrun.

use hemilux_core::wire::{Latency, Overrun, STAGES};
use std::fmt;

/// Buckets per doubling: percentiles are within 1/16 of their value.
const PER_OCTAVE: usize = 8;

/// Doublings from one microsecond: to a little over a minute.
const OCTAVES: usize = 26;

/// Budgets that may be set, milliseconds.
pub const BUDGETS_MS: std::ops::RangeInclusive<f32> = 0.01..=60_000.0;

/// Longest times that stages are meant to take, microseconds, in the order of [`Latency::NAMES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budgets(pub [u32; STAGES]);

impl Default for Budgets {
    /// Those of ten frames a second on a small board: capture may wait for the whole period, the rest shares half of it.
    fn default() -> Self {
        Self([110_000, 30_000, 6_000, 12_000, 2_000, 10_000, 60_000])
    }
}

impl Budgets {
    /// The budget of stage `i`, milliseconds; 0 beyond the last.
    #[must_use]
    pub fn ms(&self, i: usize) -> f32 {
        self.0.get(i).map_or(0.0, |us| *us as f32 / 1e3)
    }

    /// Sets the budget of stage `i`, milliseconds, to the nearest microsecond.
    pub fn set_ms(&mut self, i: usize, ms: f32) {
        if let Some(us) = self.0.get_mut(i) {
            *us = (ms * 1e3).round() as u32;
        }
    }
}

/// Reads `front=30,total=60`: milliseconds by stage, in the order of [`Latency::NAMES`].
///
/// # Errors
/// What was found and what was expected.
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

    fn add(&mut self, us: u32, budget_us: u32) {
        if let Some(n) = self.counts.get_mut(bucket(us)) {
            *n = n.saturating_add(1);
        }
        self.count += 1;
        self.most_us = self.most_us.max(us);
        self.overruns += u64::from(us > budget_us);
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

/// Durations of all stages.
#[derive(Clone, Debug)]
pub struct Timings {
    stages: [Histogram; STAGES],
    budgets: Budgets,
}

impl Timings {
    /// No frames yet.
    #[must_use]
    pub fn new(budgets: Budgets) -> Self {
        Self { stages: [const { Histogram::new() }; STAGES], budgets }
    }

    /// Adds a frame and tells what took too long.
    pub fn add(&mut self, latency: &Latency) -> Overrun {
        for ((stage, us), budget) in self.stages.iter_mut().zip(latency.all()).zip(self.budgets.0) {
            stage.add(us, budget);
        }
        Overrun::of(latency, &self.budgets.0)
    }

    /// Other budgets from the next frame on; overruns that were counted stay counted.
    pub fn set_budgets(&mut self, budgets: Budgets) {
        self.budgets = budgets;
    }

    /// Frames that were added.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.stages[0].count
    }

    /// What became of each stage, in the order of [`Latency::NAMES`].
    #[must_use]
    pub fn stages(&self) -> [Stage; STAGES] {
        std::array::from_fn(|i| {
            let h = &self.stages[i];
            let [p50, p95, p99] = [0.5, 0.95, 0.99].map(|part| h.percentile(part));
            Stage { p50, p95, p99, most: h.most_us, overruns: h.overruns, budget: self.budgets.0[i] }
        })
    }
}

/// A short table for people, milliseconds.
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
        let mut timings = Timings::new(Budgets([900; STAGES]));
        for us in 1..=1000 {
            let over = timings.add(&Latency { front: us, total: 7, ..Latency::default() });
            assert_eq!(over.names().eq(["front"]), us > 900, "frame of {us} µs");
        }
        let [_, front, _, _, _, _, total] = timings.stages();
        for (found, exact) in [(front.p50, 500.0), (front.p95, 950.0), (front.p99, 990.0)] {
            assert!((f64::from(found) / exact - 1.0).abs() < 0.126, "{front:?}");
        }
        assert_eq!((front.most, front.overruns, front.budget), (1000, 100, 900));
        assert_eq!((total.p50, total.p99, total.most, total.overruns), (7, 7, 7, 0));
        assert_eq!(Timings::new(Budgets::default()).stages()[0].p99, 0, "no frames");
    }

    #[test]
    fn the_table_has_a_line_for_each_stage_and_counts_the_frames() {
        let mut timings = Timings::new(Budgets::default());
        timings.add(&Latency { front: 31_000, ..Latency::default() });
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
