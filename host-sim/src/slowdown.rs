//! `hemilux-sim slowdown`: durations and error of the light sets of the probe's processing thread when its stages are slowed down by a factor
//! and it degrades their quality to keep the time budget.

use crate::error::SimError;
use crate::metrics::receiver::{Receiver, shadowed};
use hemilux::calibration::Burst;
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::{Config, Worker};
use hemilux::scene;
use hemilux::source::{Pace, ReplaySource, SceneSource, Source};
use hemilux_core::Light;
use hemilux_core::color::luminance;
use hemilux_core::wire::STAGES;
use std::fmt::Write;

/// Number of first frames that the figures leave out; during them the probe adapts the quality to the budget.
const SETTLING: usize = 10;

/// Number of lights of the reference set, which replaces the map in the error.
const REFERENCE_LIGHTS: usize = 2048;

/// Number of occluded receivers of the shadowed error.
const RECEIVERS: usize = 512;

/// Number of recorded bursts; each has its own noise.
const BURSTS: usize = 8;

/// Figures of the frames with one slowdown factor.
struct FactorRow {
    factor: f32,
    /// Durations of the frames after the first [`SETTLING`], microseconds, ascending.
    settled_us: Vec<u32>,
    /// Number of these frames within the budget.
    within: usize,
    /// Number of changes of the degradation steps between these frames.
    changes: usize,
    /// Names of the degradation steps in force at the last frame.
    steps: Vec<&'static str>,
    /// Number of lights of the last set.
    lights: usize,
    /// Shadowed error of the last set.
    error: f64,
}

/// Returns a table with one row for each slowdown factor: durations of `frames` frames, the share of frames within the budget of `budget_ms`
/// milliseconds, degradation steps in force, and the shadowed error.
///
/// # Errors
/// [`SimError`] if the probe cannot be started or a frame fails.
pub fn table(factors: &[f32], budget_ms: f32, frames: usize) -> Result<String, SimError> {
    let mut text =
        format!("budget of the total {budget_ms} ms, {frames} frames for each factor, room, 64 lights\n");
    let _ = writeln!(
        text,
        "{:>8}{:>10}{:>10}{:>12}{:>9}{:>8}{:>12}  steps",
        "slowdown", "p50 ms", "p99 ms", "in budget", "changes", "lights", "shadowed"
    );
    for factor in factors {
        let row = row(*factor, budget_ms, frames)?;
        let at = |part: f64| {
            let index = (part * (row.settled_us.len() - 1) as f64) as usize;
            f64::from(row.settled_us[index]) / 1e3
        };
        let steps = if row.steps.is_empty() { "none".into() } else { row.steps.join(" ") };
        let _ = writeln!(
            text,
            "{:>8}{:>10.2}{:>10.2}{:>10.1} %{:>9}{:>8}{:>10.2} %  {steps}",
            row.factor,
            at(0.5),
            at(0.99),
            100.0 * row.within as f64 / row.settled_us.len() as f64,
            row.changes,
            row.lights,
            100.0 * row.error
        );
    }
    Ok(text)
}

fn row(factor: f32, budget_ms: f32, frames: usize) -> Result<FactorRow, SimError> {
    let failed = |e: &dyn std::fmt::Display| SimError::Failed(format!("slowdown: {e}"));
    let (source, reference) = recording()?;
    let mut config = Config { slowdown: factor, ..Config::default() };
    config.budgets.set_ms(STAGES - 1, budget_ms);
    let budget_us = config.budgets.total();
    let mut worker = Worker::try_new(Box::new(source), "slowdown".into(), config)?;
    let link = worker.link();
    let (mut settled_us, mut changes, mut last) = (Vec::new(), 0, None);
    for frame in 0..frames {
        worker.step().map_err(|e| failed(&e))?;
        let Some(set) = link.sets().latest() else { continue };
        if frame >= SETTLING {
            settled_us.push(set.latency.total);
            changes += usize::from(last.is_some_and(|steps| steps != set.degraded));
            last = Some(set.degraded);
        }
    }
    settled_us.sort_unstable();
    let within = settled_us.iter().filter(|us| **us <= budget_us).count();
    let set =
        link.sets().latest().ok_or_else(|| failed(&"found no light set, expected one from the probe"))?;
    let error = shadowed_error(&set.lights, &reference);
    let steps = set.degraded.names().collect();
    Ok(FactorRow { factor, settled_us, within, changes, steps, lights: set.lights.len(), error })
}

/// Returns a source of recorded bursts of the scene `room`, and the reference set of [`REFERENCE_LIGHTS`] lights of its last burst.
fn recording() -> Result<(ReplaySource, Vec<Light>), SimError> {
    let failed = |e: &dyn std::fmt::Display| SimError::Failed(format!("slowdown: {e}"));
    let room = scene::by_name("room").ok_or_else(|| failed(&"found no scene 'room'"))?;
    let mut camera = SceneSource::new(room, Pace::Free);
    let mut bursts = vec![Burst::default(); BURSTS];
    bursts.iter_mut().try_for_each(|burst| camera.next(burst)).map_err(|e| failed(&e))?;
    let settings = Settings { lights: REFERENCE_LIGHTS, ..Settings::default() };
    let mut pipeline = Pipeline::try_new(*camera.calibration(), &camera.exposures(), settings)?;
    let lights = pipeline.process(&bursts[BURSTS - 1])?.decomposition.lights.to_vec();
    let source = ReplaySource::of_bursts(*camera.calibration(), bursts, Pace::Free);
    Ok((source.ok_or_else(|| failed(&"found no bursts to replay"))?, lights))
}

/// Returns the RMS difference between the irradiances of occluded receivers under `lights` and under `reference`, divided by the mean
/// irradiance under `reference` (METRICS.md).
fn shadowed_error(lights: &[Light], reference: &[Light]) -> f64 {
    let receive = |receiver: &Receiver, lights: &[Light]| -> f64 {
        let part = |light: &Light| {
            let direction = light.direction.to_array().map(f64::from);
            f64::from(luminance(light.irradiance)) * receiver.weight(direction)
        };
        lights.iter().map(part).sum()
    };
    let (mut square, mut mean) = (0.0, 0.0);
    for receiver in (0..RECEIVERS).map(shadowed) {
        let expected = receive(&receiver, reference);
        square += (receive(&receiver, lights) - expected).powi(2);
        mean += expected;
    }
    let count = RECEIVERS as f64;
    (square / count).sqrt() / (mean / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_lights_have_a_larger_error_and_the_reference_has_none() {
        let (_, reference) = recording().expect("a recording");
        assert!(shadowed_error(&reference, &reference) < 1e-12, "the reference against itself");
        let half: Vec<_> = reference.iter().step_by(2).copied().collect();
        assert!(shadowed_error(&half, &reference) > 0.3, "half of the energy is missing");
    }
}
