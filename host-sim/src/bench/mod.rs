//! `hemilux-sim bench`: measures the time of each stage on one thread, and of a copy of the burst's bytes for comparison.

pub mod bursts;
pub mod case;
pub mod pack;

use crate::error::SimError;
use bursts::{BURSTS, calibration};
pub use case::Case;
use hemilux::calibration::{Burst, Pixels};
use hemilux::pipeline::{Pipeline, Settings, WindowMode};
use hemilux::timing::Budgets;
use hemilux_core::mains::Lamps;
use hemilux_core::wire::{Latency, Overrun};
use serde::Serialize;
use std::time::{Duration, Instant};

/// Least number of timed frames of a benchmark case.
const LEAST_FRAMES: usize = 64;
/// Least duration of the measurement of a benchmark case.
const LEAST_TIME: Duration = Duration::from_millis(400);

/// Number of frames before the first timed frame, in which the flicker of a case with lamps is found.
const WARM_UP: usize = 8 * BURSTS;

/// Arguments of `bench`.
#[derive(Clone, Debug)]
pub struct BenchJob {
    /// Whether the report is JSON; otherwise a table.
    pub json: bool,
    /// Case to run; `None` for all cases.
    pub case: Option<Case>,
    /// Number of frames that are processed without time measurement; `None` for a report of times.
    pub frames: Option<usize>,
    /// Largest allowed median time of each stage.
    pub budgets: Budgets,
}

/// Median times of the stages of one case, milliseconds.
#[derive(Debug, Serialize)]
struct CaseTimes {
    format: &'static str,
    width: u32,
    height: u32,
    exposures: usize,
    sampler: &'static str,
    soft: bool,
    lights: usize,
    copy_ms: f64,
    front_ms: f64,
    pyramid_ms: f64,
    sample_ms: f64,
    total_ms: f64,
    memcpy_ratio: f64,
    /// Half the interquartile range of the time of each stage, divided by the median.
    spread: Spread,
    frames: usize,
    /// Names of the stages whose median time exceeds the budget.
    over: Vec<&'static str>,
}

#[derive(Debug, Serialize)]
struct Spread {
    copy: f64,
    front: f64,
    pyramid: f64,
    sample: f64,
    total: f64,
}

#[derive(Serialize)]
struct Report {
    cases: Vec<CaseTimes>,
}

/// Runs the benchmarks of `job` and prints the report to standard output.
///
/// # Errors
/// [`SimError`] if a pipeline cannot be created or a burst is refused.
pub fn run(job: &BenchJob) -> Result<(), SimError> {
    let cases = job.case.clone().map_or_else(case::standard, |case| vec![case]);
    if let Some(frames) = job.frames {
        return cases.iter().try_for_each(|case| repeat(case, frames));
    }
    let mut rows = Vec::new();
    if !job.json {
        println!(
            "times in milliseconds, medians; ratio: total / copy of the burst's bytes; spread: half the interquartile range of total\n\
             {:<34}{:>8}{:>8}{:>9}{:>8}{:>8}{:>8}{:>9}  over budget",
            "case", "copy", "front", "pyramid", "sample", "total", "ratio", "spread"
        );
    }
    for case in &cases {
        let row = measure(case, &job.budgets)?;
        if !job.json {
            let CaseTimes { copy_ms, front_ms, pyramid_ms, sample_ms, total_ms, memcpy_ratio, .. } = row;
            let spread = 100.0 * row.spread.total;
            let over = if row.over.is_empty() { "-".into() } else { row.over.join(",") };
            println!(
                "{case:<34}{copy_ms:>8.3}{front_ms:>8.3}{pyramid_ms:>9.3}{sample_ms:>8.3}{total_ms:>8.3}{memcpy_ratio:>8.2}{spread:>7.1} %  {over}"
            );
        }
        rows.push(row);
    }
    if job.json {
        let text = serde_json::to_string(&Report { cases: rows });
        println!(
            "{}",
            text.map_err(|e| SimError::Failed(format!(
                "bench: found {e}, expected a report that JSON can hold"
            )))?
        );
    }
    Ok(())
}

fn pipeline(case: &Case, bursts: &[Burst]) -> Result<Pipeline, SimError> {
    let exposures: Vec<_> = bursts[0].frames.iter().map(|f| f.exposure).collect();
    let Case { merge, window, sampler, soft, lights, .. } = *case;
    // The flicker of lamps is removed from bursts alone.
    let lamps = if window == WindowMode::Sliding { Lamps::Off } else { Lamps::Auto };
    let settings = Settings { merge, window, lamps, sampler, soft, lights, ..Settings::default() };
    Ok(Pipeline::try_new(calibration(case), &exposures, settings)?)
}

/// Processes `frames` bursts without timing or report.
fn repeat(case: &Case, frames: usize) -> Result<(), SimError> {
    let mut bursts = bursts::make(case);
    let mut pipeline = pipeline(case, &bursts)?;
    // The first set of a sliding window follows the last frame of the first burst.
    let first = if case.window == WindowMode::Sliding { bursts[0].frames.len() - 1 } else { 0 };
    for frame in first..frames {
        let burst = next(case, &mut bursts, frame);
        std::hint::black_box(pipeline.process(burst)?.decomposition.lights.len());
    }
    Ok(())
}

/// Returns the burst for frame `frame`. In a sliding window, one of its frames is new.
fn next<'b>(case: &Case, bursts: &'b mut [Burst], frame: usize) -> &'b Burst {
    if case.window == WindowMode::Burst {
        return bursts::timed(bursts, frame);
    }
    let burst = &mut bursts[frame / bursts[0].frames.len() % BURSTS];
    burst.stale = !(1 << (frame % burst.frames.len()));
    burst
}

fn measure(case: &Case, budgets: &Budgets) -> Result<CaseTimes, SimError> {
    let mut bursts = bursts::make(case);
    let mut pipeline = pipeline(case, &bursts)?;
    let mut copy = BurstCopy::new(&bursts[0]);
    let mut times: [Vec<f64>; 5] = Default::default();
    let began = Instant::now();
    let mut frame = 0;
    while frame < WARM_UP + LEAST_FRAMES || began.elapsed() < LEAST_TIME {
        // The copied burst is not the next processed burst, whose bytes must not be in the cache.
        let copied = copy.time(&bursts[(frame + BURSTS / 2) % BURSTS]);
        let whole = Instant::now();
        let stages = std::hint::black_box(pipeline.process(next(case, &mut bursts, frame))?).times;
        let total = whole.elapsed();
        if frame >= WARM_UP {
            let all = [copied, stages.front, stages.pyramid, stages.sample, total];
            times.iter_mut().zip(all).for_each(|(list, t)| list.push(1e3 * t.as_secs_f64()));
        }
        frame += 1;
    }
    let [copy, front, pyramid, sample, total] = times.map(|mut list| {
        list.sort_by(f64::total_cmp);
        let at = |part: f64| list[((list.len() - 1) as f64 * part) as usize];
        (at(0.5), 0.5 * (at(0.75) - at(0.25)) / at(0.5))
    });
    let spread =
        Spread { copy: copy.1, front: front.1, pyramid: pyramid.1, sample: sample.1, total: total.1 };
    let us = |ms: f64| (1e3 * ms) as u32;
    let latency = Latency {
        front: us(front.0),
        pyramid: us(pyramid.0),
        sample: us(sample.0),
        total: us(total.0),
        ..Latency::default()
    };
    Ok(CaseTimes {
        format: case.format_name(),
        width: case.size.0,
        height: case.size.1,
        exposures: bursts[0].frames.len(),
        sampler: case.sampler.name(),
        soft: case.soft,
        lights: case.lights,
        copy_ms: copy.0,
        front_ms: front.0,
        pyramid_ms: pyramid.0,
        sample_ms: sample.0,
        total_ms: total.0,
        memcpy_ratio: total.0 / copy.0,
        spread,
        frames: frame - WARM_UP,
        over: Overrun::of(&latency, &budgets.0).names().collect(),
    })
}

/// Buffers for a copy of the bytes of a burst, one per frame.
struct BurstCopy {
    buffers: Vec<Vec<u8>>,
}

impl BurstCopy {
    fn new(burst: &Burst) -> Self {
        Self { buffers: bytes(burst).map(<[u8]>::to_vec).collect() }
    }

    /// Copies the bytes of `burst` and returns the duration.
    fn time(&mut self, burst: &Burst) -> Duration {
        let began = Instant::now();
        for (to, from) in self.buffers.iter_mut().zip(bytes(burst)) {
            to.copy_from_slice(from);
            std::hint::black_box(&to);
        }
        began.elapsed()
    }
}

fn bytes(burst: &Burst) -> impl Iterator<Item = &[u8]> {
    burst
        .frames
        .iter()
        .filter_map(|f| if let Pixels::U8(bytes) = &f.pixels { Some(&bytes[..]) } else { None })
}
