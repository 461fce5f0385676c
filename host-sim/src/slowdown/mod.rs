//! `hemilux-sim slowdown`: the accuracy that a probe gives up on a slower board to keep its time budget.
//!
//! Time is simulated. A frame takes the instructions of its quality, divided by the speed of the board. The instructions at full quality are
//! those that `tests/instructions` counts on ARMv7; at a lower quality, each stage has the share that its work is of that at full quality.
//!
//! The error is that of the newest set at the time of each burst: at a lower rate the set is older than the light.

mod figure;

use crate::bench::bursts::{calibration, make_of};
use crate::bench::case::Case;
use crate::error::SimError;
use crate::metrics::receiver::{OPEN, Receiver, SHADOWED, open, shadowed};
use hemilux::calibration::{Burst, Calibration};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::{FrameTime, Ladder, Quality};
use hemilux::scene;
use hemilux_core::color::luminance;
use hemilux_core::{Exposure, Light};
use std::fmt::Write;
use std::time::Duration;

/// The bench case whose instructions the constants below state: three exposures, HEALPix order 6.
const CASE: &str = "rgb24:640x480:adaptive:64";

/// Instructions of merge and map for a frame at full quality, and for a frame in which all three exposures of each pixel are read.
const FRONT: [f64; 2] = [5_074_995.0, 7_516_881.0];

/// Instructions of the pyramid for a frame; a map of one order less has a fourth of the quads.
const PYRAMID: f64 = 2_081_029.0;

/// Instructions of the sampler for a frame with 16 and with 64 lights, linear between and beyond.
const SAMPLE: [f64; 2] = [486_147.0, 1_367_448.0];

/// Instructions of all other stages for a frame, at any quality.
const OTHER: f64 = 686_340.0;

/// Slowdowns of the chart: four for each doubling, 1 to 16.
const CHARTED: i32 = 16;

/// Number of first processed frames that the figures leave out; during them the probe adapts the quality to the budget.
const SETTLING: usize = 10;

/// Number of lights of the reference set, which replaces the map in the errors.
const REFERENCE_LIGHTS: usize = 2048;

/// Number of bursts at each quality, and the number of last ones over which the errors are averaged: at the lowest rate, one of the last is
/// processed.
const BURSTS: [usize; 2] = [32, 8];

/// Time from one burst to the next.
const PERIOD: Duration = Duration::from_millis(100);

/// Largest relative deviation of the time of a frame from the mean.
const NOISE: f64 = 0.03;

/// Board and load that are simulated.
#[derive(Clone, Debug)]
pub struct SlowdownJob {
    /// Factors by which the speed of the board is divided.
    pub factors: Vec<f32>,
    /// Time budget of a frame's total, milliseconds.
    pub budget_ms: f32,
    /// Time of a frame at full quality and factor 1, milliseconds.
    pub frame_ms: f32,
    /// Simulated time with each factor, minutes.
    pub minutes: u32,
}

impl Default for SlowdownJob {
    /// Returns the default budget, ten minutes each, and a board whose frames take two thirds of the budget.
    fn default() -> Self {
        Self { factors: vec![1.0, 2.0, 4.0, 8.0, 16.0], budget_ms: 60.0, frame_ms: 40.0, minutes: 10 }
    }
}

/// Figures of the frames at one quality.
struct QualityFigures {
    quality: Quality,
    instructions: f64,
    lights: usize,
    open: f64,
    shadowed: f64,
}

/// Figures of the frames on a board of one factor.
struct FactorRow {
    /// Number of processed frames after the first [`SETTLING`], and of those within their budget.
    frames: [usize; 2],
    /// Number of steps of quality after the first [`SETTLING`] frames.
    steps: usize,
    /// Time of the last processed frame, milliseconds.
    last_ms: f64,
    /// Quality at which the last frame was processed.
    quality: Quality,
}

/// Returns the SVG text of a chart of the errors against the slowdown from 1 to 16.
///
/// # Errors
/// [`SimError`] if a burst cannot be processed.
pub fn chart(job: &SlowdownJob) -> Result<String, SimError> {
    let mut room = Room::try_new()?;
    let mut points = vec![];
    for k in 0..=CHARTED {
        let factor = (k as f32 / 4.0).exp2();
        let quality = row(&mut room, job, factor)?.quality;
        let QualityFigures { lights, open, shadowed, .. } = *room.figures(&quality)?;
        points.push(figure::ChartPoint { factor, lights, every: quality.every, errors: [open, shadowed] });
    }
    Ok(figure::draw(&points))
}

/// Returns a table with one row for each factor: the share of frames within the budget, steps a minute, the quality at the end, and its error.
///
/// # Errors
/// [`SimError`] if a burst cannot be processed.
pub fn table(job: &SlowdownJob) -> Result<String, SimError> {
    let mut room = Room::try_new()?;
    let mut text = format!(
        "budget {} ms, {} ms a frame at slowdown 1, 10 bursts a second, {} minutes each; room, 64 lights, three exposures of 640 x 480\n",
        job.budget_ms, job.frame_ms, job.minutes
    );
    let _ = writeln!(
        text,
        "{:>8}{:>10}{:>11}{:>12}{:>14}{:>8}{:>9}{:>11}  steps in force",
        "slowdown", "frame ms", "budget ms", "in budget", "steps/minute", "lights", "open", "shadowed"
    );
    for factor in &job.factors {
        let row = row(&mut room, job, *factor)?;
        let QualityFigures { lights, open, shadowed, .. } = *room.figures(&row.quality)?;
        let names: Vec<_> = row.quality.steps.names().collect();
        let _ = writeln!(
            text,
            "{factor:>8}{:>10.1}{:>11}{:>10.1} %{:>14.2}{lights:>8}{:>7.1} %{:>9.1} %  {}",
            row.last_ms,
            job.budget_ms * row.quality.every as f32,
            100.0 * row.frames[1] as f64 / row.frames[0].max(1) as f64,
            row.steps as f64 / f64::from(job.minutes),
            100.0 * open,
            100.0 * shadowed,
            if names.is_empty() { "none".into() } else { names.join(" ") }
        );
    }
    Ok(text)
}

/// Simulates the probe on a board that is slower by `factor`.
fn row(room: &mut Room, job: &SlowdownJob, factor: f32) -> Result<FactorRow, SimError> {
    let full = Settings::default();
    let mut ladder = Ladder::new(&full, room.exposures.len());
    let full_instructions = room.figures(ladder.quality())?.instructions;
    let budget_us = (job.budget_ms * 1e3) as u32;
    let (mut frames, mut steps, mut processed, mut us) = ([0; 2], 0, 0, 0);
    let bursts = job.minutes * 60 * 10;
    for burst in 1..=bursts {
        let quality = *ladder.quality();
        if !quality.reads(burst) {
            continue;
        }
        let share = room.figures(&quality)?.instructions / full_instructions;
        us = (f64::from(job.frame_ms * factor) * 1e3 * share * noise(burst)) as u32;
        let has_stepped = ladder.add(FrameTime { us, budget_us, now: PERIOD * burst });
        processed += 1;
        if processed > SETTLING {
            frames[0] += 1;
            frames[1] += usize::from(us <= quality.budget_us(budget_us));
            steps += usize::from(has_stepped);
        }
    }
    Ok(FactorRow { frames, steps, last_ms: f64::from(us) / 1e3, quality: *ladder.quality() })
}

/// Returns the relative time of a frame, 1 - [`NOISE`] to 1 + [`NOISE`].
fn noise(burst: u32) -> f64 {
    let random = f64::from(burst.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24);
    1.0 + NOISE * (2.0 * random - 1.0)
}

/// Returns the instructions of a frame of which `read` exposures are read; `full_read` are read at full quality.
fn instructions(quality: &Quality, read: f64, full_read: f64) -> f64 {
    let front = FRONT[0] + (FRONT[1] - FRONT[0]) * (read - full_read) / (3.0 - full_read);
    let pyramid = PYRAMID * 4f64.powi(i32::from(quality.order) - 6);
    let sample = SAMPLE[0] + (SAMPLE[1] - SAMPLE[0]) * (quality.lights as f64 - 16.0) / 48.0;
    front + pyramid + sample + OTHER
}

/// Bursts of the scene `room`, and the figures of the qualities that were used so far.
struct Room {
    calibration: Calibration,
    bursts: Vec<Burst>,
    exposures: Vec<Exposure>,
    /// Irradiances of the receivers under the reference set of each of the last bursts.
    references: Vec<Irradiances>,
    full_read: f64,
    known: Vec<QualityFigures>,
}

/// Irradiances of the open and of the shadowed receivers.
type Irradiances = [Vec<f64>; 2];

impl Room {
    fn try_new() -> Result<Self, SimError> {
        let failed = |e: String| SimError::Failed(format!("slowdown: {e}"));
        let case: Case = CASE.parse().map_err(failed)?;
        let scene = scene::by_name("room").ok_or_else(|| failed("found no scene 'room'".into()))?;
        let (calibration, bursts) = (calibration(&case), make_of(&case, scene, BURSTS[0]));
        let exposures = bursts.iter().take(1).flat_map(|b| b.frames.iter().map(|f| f.exposure)).collect();
        let mut room =
            Self { calibration, bursts, exposures, references: vec![], full_read: 0.0, known: vec![] };
        let settings = Settings { lights: REFERENCE_LIGHTS, ..Settings::default() };
        (room.references, _, room.full_read) = room.irradiances(settings, usize::MAX, 1)?;
        Ok(room)
    }

    /// Returns the irradiances under the newest set at each of the last bursts, where one of `every` bursts is processed, the number of lights of
    /// the last set, and the mean number of exposures that were read of a pixel.
    fn irradiances(
        &self,
        settings: Settings,
        exposures: usize,
        every: usize,
    ) -> Result<(Vec<Irradiances>, usize, f64), SimError> {
        let mut pipeline = Pipeline::try_new(self.calibration, &self.exposures, settings)?;
        pipeline.limit_exposures(exposures);
        let (mut found, mut lights, mut read) = (vec![], vec![], 0.0);
        for (k, burst) in self.bursts.iter().enumerate() {
            if k.is_multiple_of(every) {
                let processed = pipeline.process(burst)?;
                lights = processed.decomposition.lights.to_vec();
                read = processed.seen.exposures_read;
            }
            if k + BURSTS[1] >= BURSTS[0] {
                found.push([
                    received(&lights, (0..OPEN).map(open)),
                    received(&lights, (0..SHADOWED).map(shadowed)),
                ]);
            }
        }
        Ok((found, lights.len(), read))
    }

    fn figures(&mut self, quality: &Quality) -> Result<&QualityFigures, SimError> {
        if let Some(index) = self.known.iter().position(|known| known.quality == *quality) {
            return Ok(&self.known[index]);
        }
        let settings = quality.settings(&Settings::default());
        let (sets, lights, read) = self.irradiances(settings, quality.exposures, quality.every as usize)?;
        let mean = |of: usize| {
            let errors =
                sets.iter().zip(&self.references).map(|(set, reference)| error(&set[of], &reference[of]));
            errors.sum::<f64>() / self.references.len() as f64
        };
        let [open, shadowed] = [0, 1].map(mean);
        self.known.push(QualityFigures {
            quality: *quality,
            instructions: instructions(quality, read, self.full_read),
            lights,
            open,
            shadowed,
        });
        Ok(&self.known[self.known.len() - 1])
    }
}

/// Returns the irradiances of `receivers` under `lights`.
fn received(lights: &[Light], receivers: impl Iterator<Item = Receiver>) -> Vec<f64> {
    let lights: Vec<_> = lights
        .iter()
        .map(|light| (light.direction.to_array().map(f64::from), f64::from(luminance(light.irradiance))))
        .collect();
    receivers.map(|r| lights.iter().map(|(direction, light)| light * r.weight(*direction)).sum()).collect()
}

/// Returns the RMS difference between irradiances and those under the reference, divided by the mean of the latter (METRICS.md).
fn error(found: &[f64], reference: &[f64]) -> f64 {
    let square: f64 = found.iter().zip(reference).map(|(found, expected)| (found - expected).powi(2)).sum();
    let (mean, count) = (reference.iter().sum::<f64>(), reference.len() as f64);
    f64::sqrt(square / count) / (mean / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_irradiance_has_an_error_of_a_half_and_the_reference_has_none() {
        let room = Room::try_new().expect("bursts");
        let [open, _] = &room.references[0];
        assert_eq!(error(open, open), 0.0, "the reference against itself");
        let half: Vec<_> = open.iter().map(|irradiance| irradiance / 2.0).collect();
        let (count, mean) = (open.len() as f64, open.iter().sum::<f64>() / open.len() as f64);
        let variance = open.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
        let expected = 0.5 * (1.0 + variance / mean.powi(2)).sqrt();
        assert!((error(&half, open) / expected - 1.0).abs() < 1e-9, "{} of {expected}", error(&half, open));
    }

    #[test]
    fn a_lower_rate_and_fewer_lights_have_larger_errors() {
        let mut room = Room::try_new().expect("bursts");
        let full = *Ladder::new(&Settings::default(), 3).quality();
        let mut of = |every, lights| {
            let mut quality = Quality { every, lights, ..full };
            quality.steps.add(hemilux_core::wire::Step::Lights);
            let QualityFigures { open, shadowed, .. } = *room.figures(&quality).expect("figures");
            [open, shadowed]
        };
        let (best, late, few) = (of(1, 64), of(8, 64), of(1, 8));
        for k in 0..2 {
            assert!(late[k] > 1.5 * best[k] && few[k] > 1.5 * best[k], "{best:?}, {late:?}, {few:?}");
        }
    }

    #[test]
    fn the_instructions_of_the_full_quality_are_those_that_were_counted_on_armv7() {
        let counts = include_str!("../../../tests/instructions/baseline.txt");
        let of = |case: &str| -> Vec<f64> {
            let line = counts.lines().find(|line| line.split(' ').next() == Some(case)).expect("a case");
            line.split_whitespace().skip(1).map(|count| count.parse().expect("a count")).collect()
        };
        let (found, all) = (of(CASE), of("rgb24+all:640x480:q2tree:64"));
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < 0.03;
        for (stated, counted) in [FRONT[0], PYRAMID, SAMPLE[1], OTHER].into_iter().zip(&found) {
            assert!(near(stated, *counted), "{stated} stated, {counted} counted");
        }
        assert!(near(FRONT[1], all[0]), "{} stated, {} counted", FRONT[1], all[0]);
    }

    #[test]
    fn the_table_of_the_readme_is_what_the_command_prints() {
        let printed = table(&SlowdownJob::default()).expect("a table");
        let readme = include_str!("../../../README.md");
        let head = printed.lines().next().expect("a line");
        let shown: Vec<_> =
            readme.lines().skip_while(|line| *line != head).take_while(|l| *l != "```").collect();
        let agrees = |(a, b): (&str, &str)| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(a), Ok(b)) => (a - b).abs() <= 0.1 * b + 0.1,
            _ => a == b,
        };
        let words = |line: &'static str| line.split_whitespace();
        assert_eq!(shown.len(), printed.lines().count(), "the README lacks:\n{printed}");
        for (shown, line) in shown.into_iter().zip(printed.lines()) {
            let same = words(shown).count() == line.split_whitespace().count();
            assert!(
                same && words(shown).zip(line.split_whitespace()).all(agrees),
                "the README has:\n{shown}\n{line}"
            );
        }
        for line in printed.lines().skip(2) {
            let share: f64 = line.split_whitespace().nth(3).expect("a share").parse().expect("a number");
            assert!(share >= 99.0, "{line}");
        }
    }
}
