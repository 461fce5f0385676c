//! The figures of one run over one scenario.

use crate::contender::Run;
use crate::metrics::stability::{self as stability, ScoredFrame, Spread};
use crate::metrics::{LitSet, Reading, Reference, receiver};
use crate::scenario::Scenario;
use serde::Serialize;

/// One line of the report; `None` where a figure has no meaning.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the scenario.
    pub scenario: &'static str,
    /// Name of the method.
    pub sampler: &'static str,
    /// Largest number of lights.
    pub lights: usize,
    /// Shadowed error, mean over the frames.
    pub shadowed: Option<f64>,
    /// Flicker, mean over the frames.
    pub flicker_mean: Option<f64>,
    /// Flicker, largest.
    pub flicker_max: Option<f64>,
    /// Shadowed error of the lights read as discs, mean over the frames.
    pub soft_shadowed: Option<f64>,
    /// Flicker of the lights read as discs, mean over the frames.
    pub soft_flicker_mean: Option<f64>,
    /// Flicker of the lights read as discs, largest.
    pub soft_flicker_max: Option<f64>,
    /// Unwarranted change, the largest of the switches.
    pub unwarranted: Option<f64>,
    /// Step response, the longest of the changes, frames.
    pub step_frames: Option<usize>,
    /// Step response of the lights read as discs, the longest of the changes, frames.
    pub soft_step_frames: Option<usize>,
    /// Transit energy.
    pub transit: Option<f64>,
    /// Tracking error, mean over the path, degrees.
    pub tracking_deg: Option<f64>,
    /// Motion noise, degrees a frame.
    pub motion_noise_deg: Option<f64>,
    /// Largest change of a light's radius from frame to frame, a ratio.
    pub radius_change: Option<f64>,
    /// Lights born and died, mean a frame.
    pub churn: Option<f64>,
}

/// Scores for lights that are read as discs.
struct Soft {
    shadowed: Option<f64>,
    flicker: Option<Spread>,
    step: Option<usize>,
}

/// The irradiance of the probes in every frame of a scenario.
pub struct Judge<'a> {
    scenario: &'a Scenario,
    references: Vec<Reference>,
    /// The shadowed receivers that are scored, if only a part is.
    counted: Option<Vec<usize>>,
}

impl<'a> Judge<'a> {
    /// Integrates the truth over all probes.
    #[must_use]
    pub fn new(scenario: &'a Scenario) -> Self {
        let mut references: Vec<Reference> = Vec::with_capacity(scenario.truth.len());
        for (t, map) in scenario.truth.iter().enumerate() {
            let next = match references.last() {
                // A static scene is integrated once.
                Some(last) if scenario.truth[t - 1] == *map => last.clone(),
                Some(last) => last.following(map),
                None => Reference::new(map, scenario.domain),
            };
            references.push(next);
        }
        let counted = scenario.in_shadow.then(|| in_shadow(scenario, &references[0]));
        Self { scenario, references, counted }
    }

    /// All figures of a run.
    #[must_use]
    pub fn row(&self, run: &Run) -> Row {
        let (scenario, sampler, lights) = (self.scenario.name, run.method.name, run.lights);
        let Some(sets) = &run.sets else {
            return Row {
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
        Row {
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
            motion_noise_deg: finite(noise.flatten()),
            radius_change: finite(pulsing.flatten()),
            churn: finite(Spread::of(&stability::churn(sets)).map(|s| s.mean)),
        }
    }

    /// The figures of a run whose lights are read as discs.
    fn soft(&self, sets: &[LitSet]) -> Soft {
        let errors = self.errors(sets, Reading::Discs);
        Soft {
            shadowed: Spread::of(&errors).map(|s| s.mean),
            flicker: Spread::of(&self.flicker(sets, Reading::Discs)),
            step: self.step(&errors),
        }
    }

    fn errors(&self, sets: &[LitSet], reading: Reading) -> Vec<f64> {
        let pairs = self.references.iter().zip(sets);
        match &self.counted {
            Some(probes) => {
                pairs.map(|(r, set)| stability::shadowed_error_among(r, set, reading, probes)).collect()
            }
            None => pairs.map(|(r, set)| r.shadowed_error(set, reading)).collect(),
        }
    }

    fn flicker(&self, sets: &[LitSet], reading: Reading) -> Vec<f64> {
        match &self.counted {
            Some(probes) => stability::flicker_among(&self.references, sets, reading, probes),
            None => stability::flicker(&self.references, sets, reading),
        }
    }

    fn unwarranted(&self, sets: &[LitSet]) -> Option<f64> {
        let at = |t: usize| ScoredFrame { reference: &self.references[t], set: &sets[t] };
        let changes = self.scenario.changes.iter();
        changes.filter_map(|&t| stability::unwarranted_change(at(t - 1), at(t))).reduce(f64::max)
    }

    /// Every change by itself, until the next.
    fn step(&self, errors: &[f64]) -> Option<usize> {
        let ends = self.scenario.changes.iter().copied().skip(1).chain([errors.len()]);
        let changes = self.scenario.changes.iter().zip(ends);
        changes.filter_map(|(&t, end)| stability::step_response(&errors[..end], t)).max()
    }

    fn transit(&self, sets: &[LitSet]) -> Option<f64> {
        let energy = self.scenario.switched_energy?;
        let from = *self.scenario.changes.first()?;
        let stray = (from..sets.len()).map(|t| {
            let (grid, map) = (self.references[t].grid(), &self.scenario.truth[t]);
            stability::stray_energy(grid, map, &sets[t], &self.scenario.sources[t])
        });
        Some(stability::transit_energy(&stray.collect::<Vec<_>>(), energy))
    }

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

/// Returns the shadowed receivers that see no texel of the first source in any frame.
fn in_shadow(scenario: &Scenario, reference: &Reference) -> Vec<usize> {
    let texel_deg = 180.0 / scenario.truth[0].height() as f64;
    let sources: Vec<_> = scenario.sources.iter().filter_map(|s| s.first()).collect();
    let near = |d: &[f64; 3]| sources.iter().any(|source| source.distance_deg(*d) <= texel_deg);
    let lit: Vec<[f64; 3]> = reference.grid().directions().filter(near).collect();
    let blind = |k: &usize| lit.iter().all(|&d| receiver::shadowed(*k).weight(d) == 0.0);
    (0..receiver::SHADOWED).filter(blind).collect()
}
