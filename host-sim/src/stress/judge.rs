//! Figures of one run of a method over one scenario.

use crate::contender::MethodRun;
use crate::metrics::stability::{self as stability, ScoredFrame, Spread};
use crate::metrics::{LitSet, Reading, Reference, receiver};
use crate::scenario::Scenario;
use serde::Serialize;

/// One line of the report. Errors, flicker and energies are ratios (`host-sim/METRICS.md`); a figure is `None` if the scenario does not define it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StressRow {
    /// Name of the scenario.
    pub scenario: &'static str,
    /// Name of the method.
    pub sampler: &'static str,
    /// Largest number of lights of a set.
    pub lights: usize,
    /// Mean over the frames of the shadowed error.
    pub shadowed: Option<f64>,
    /// Mean over the frames of the flicker.
    pub flicker_mean: Option<f64>,
    /// Largest flicker of a frame of the scenario.
    pub flicker_max: Option<f64>,
    /// Mean over the frames of the shadowed error of the lights read as discs.
    pub soft_shadowed: Option<f64>,
    /// Mean over the frames of the flicker of the lights read as discs.
    pub soft_flicker_mean: Option<f64>,
    /// Largest flicker of a frame of the lights read as discs.
    pub soft_flicker_max: Option<f64>,
    /// Largest unwarranted change over the switches of the scenario.
    pub unwarranted: Option<f64>,
    /// Longest step response over the changes of the scenario, frames.
    pub step_frames: Option<usize>,
    /// Longest step response of the lights read as discs over the changes of the scenario, frames.
    pub soft_step_frames: Option<usize>,
    /// Transit energy of the switched source, a ratio.
    pub transit: Option<f64>,
    /// Mean over the path of the moving source of the tracking error, degrees.
    pub tracking_deg: Option<f64>,
    /// Tracking lag, camera frames.
    pub lag_frames: Option<f64>,
    /// Motion noise of the lights, degrees per frame.
    pub motion_noise_deg: Option<f64>,
    /// Largest relative change of a light's radius between successive frames.
    pub radius_change: Option<f64>,
    /// Mean number of lights that appear or disappear per frame.
    pub churn: Option<f64>,
}

/// Figures of lights that are read as discs.
struct Soft {
    shadowed: Option<f64>,
    flicker: Option<Spread>,
    step: Option<usize>,
}

/// Scenario with the reference irradiance of the receivers in every frame, which scores runs of methods.
pub struct StressJudge<'a> {
    scenario: &'a Scenario,
    references: Vec<Reference>,
    /// Indices of the shadowed receivers over which errors and flicker are computed; `None` for all receivers.
    counted: Option<Vec<usize>>,
}

impl<'a> StressJudge<'a> {
    /// Computes the irradiance of all receivers under the true map of every frame.
    #[must_use]
    pub fn new(scenario: &'a Scenario) -> Self {
        let mut references: Vec<Reference> = Vec::with_capacity(scenario.truth.len());
        for (t, map) in scenario.truth.iter().enumerate() {
            let next = match references.last() {
                // Equal maps share one reference.
                Some(last) if scenario.truth[t - 1] == *map => last.clone(),
                Some(last) => last.following(map),
                None => Reference::new(map, scenario.domain),
            };
            references.push(next);
        }
        let counted = scenario.in_shadow.then(|| in_shadow(scenario, &references[0]));
        Self { scenario, references, counted }
    }

    /// Returns all figures of a run of a method over the scenario.
    #[must_use]
    pub fn row(&self, run: &MethodRun) -> StressRow {
        let (scenario, sampler, lights) = (self.scenario.name, run.method.name, run.lights);
        let Some(sets) = &run.sets else {
            return StressRow {
                scenario,
                sampler,
                lights,
                shadowed: None,
                flicker_mean: None,
                flicker_max: None,
                soft_shadowed: None,
                soft_flicker_mean: None,
                soft_flicker_max: None,
                unwarranted: None,
                step_frames: None,
                soft_step_frames: None,
                transit: None,
                tracking_deg: None,
                lag_frames: None,
                motion_noise_deg: None,
                radius_change: None,
                churn: None,
            };
        };
        let errors = self.errors(sets, Reading::Points);
        let soft = run.method.is_soft().then(|| self.soft(sets));
        let flicker = Spread::of(&self.flicker(sets, Reading::Points));
        let noise = self.scenario.static_noise.then(|| stability::motion_noise_deg(sets));
        let pulsing = (self.scenario.static_noise && soft.is_some()).then(|| stability::radius_change(sets));
        StressRow {
            scenario,
            sampler,
            lights,
            shadowed: finite(Spread::of(&errors).map(|s| s.mean)),
            flicker_mean: finite(flicker.map(|s| s.mean)),
            flicker_max: finite(flicker.map(|s| s.max)),
            soft_shadowed: finite(soft.as_ref().and_then(|s| s.shadowed)),
            soft_flicker_mean: finite(soft.as_ref().and_then(|s| s.flicker).map(|s| s.mean)),
            soft_flicker_max: finite(soft.as_ref().and_then(|s| s.flicker).map(|s| s.max)),
            unwarranted: finite(self.unwarranted(sets)),
            step_frames: self.step(&errors),
            soft_step_frames: soft.as_ref().and_then(|s| s.step),
            transit: finite(self.transit(sets)),
            tracking_deg: finite(self.tracking(sets)),
            lag_frames: self.lag(sets),
            motion_noise_deg: finite(noise.flatten()),
            radius_change: finite(pulsing.flatten()),
            churn: finite(Spread::of(&stability::churn(sets)).map(|s| s.mean)),
        }
    }

    /// Returns the figures of light sets whose lights are read as discs.
    fn soft(&self, sets: &[LitSet]) -> Soft {
        let errors = self.errors(sets, Reading::Discs);
        Soft {
            shadowed: Spread::of(&errors).map(|s| s.mean),
            flicker: Spread::of(&self.flicker(sets, Reading::Discs)),
            step: self.step(&errors),
        }
    }

    /// Returns the shadowed error of the light set of each frame.
    fn errors(&self, sets: &[LitSet], reading: Reading) -> Vec<f64> {
        let pairs = self.references.iter().zip(sets);
        match &self.counted {
            Some(probes) => {
                pairs.map(|(r, set)| stability::shadowed_error_among(r, set, reading, probes)).collect()
            }
            None => pairs.map(|(r, set)| r.shadowed_error(set, reading)).collect(),
        }
    }

    /// Returns the flicker of the light sets in each frame but the first.
    fn flicker(&self, sets: &[LitSet], reading: Reading) -> Vec<f64> {
        match &self.counted {
            Some(probes) => stability::flicker_among(&self.references, sets, reading, probes),
            None => stability::flicker(&self.references, sets, reading),
        }
    }

    /// Returns the largest unwarranted change over the changes of the scenario.
    fn unwarranted(&self, sets: &[LitSet]) -> Option<f64> {
        let at = |t: usize| ScoredFrame { reference: &self.references[t], set: &sets[t] };
        let changes = self.scenario.changes.iter();
        changes.filter_map(|&t| stability::unwarranted_change(at(t - 1), at(t))).reduce(f64::max)
    }

    /// Returns the longest step response over the changes of the scenario; each response ends at the next change.
    fn step(&self, errors: &[f64]) -> Option<usize> {
        let ends = self.scenario.changes.iter().copied().skip(1).chain([errors.len()]);
        let changes = self.scenario.changes.iter().zip(ends);
        changes.filter_map(|(&t, end)| stability::step_response(&errors[..end], t)).max()
    }

    /// Returns the transit energy from the first change on, if the scenario switches a source.
    fn transit(&self, sets: &[LitSet]) -> Option<f64> {
        let energy = self.scenario.switched_energy?;
        let from = *self.scenario.changes.first()?;
        let stray = (from..sets.len()).map(|t| {
            let (grid, map) = (self.references[t].grid(), &self.scenario.truth[t]);
            stability::stray_energy(grid, map, &sets[t], &self.scenario.sources[t])
        });
        Some(stability::transit_energy(&stray.collect::<Vec<_>>(), energy))
    }

    /// Returns the tracking lag in a scenario of camera frames.
    fn lag(&self, sets: &[LitSet]) -> Option<f64> {
        self.scenario.has_lag.then(|| stability::tracking_lag(&self.references, sets)).flatten()
    }

    /// Returns the mean tracking error over the frames with a tracked source, degrees.
    fn tracking(&self, sets: &[LitSet]) -> Option<f64> {
        let error = |t: usize| {
            let (grid, map) = (self.references[t].grid(), &self.scenario.truth[t]);
            let source = self.scenario.tracked(t)?;
            stability::tracking_error_deg(grid, map, &sets[t], source.direction)
        };
        Spread::of(&(0..sets.len()).filter_map(error).collect::<Vec<_>>()).map(|s| s.mean)
    }
}

fn finite(value: Option<f64>) -> Option<f64> {
    value.filter(|v| v.is_finite())
}

/// Returns the indices of the shadowed receivers that receive no light from the texels of the first source of any frame.
fn in_shadow(scenario: &Scenario, reference: &Reference) -> Vec<usize> {
    let texel_deg = 180.0 / scenario.truth[0].height() as f64;
    let sources: Vec<_> = scenario.sources.iter().filter_map(|s| s.first()).collect();
    let near = |d: &[f64; 3]| sources.iter().any(|source| source.distance_deg(*d) <= texel_deg);
    let lit: Vec<[f64; 3]> = reference.grid().directions().filter(near).collect();
    let blind = |k: &usize| lit.iter().all(|&d| receiver::shadowed(*k).weight(d) == 0.0);
    (0..receiver::SHADOWED).filter(blind).collect()
}
