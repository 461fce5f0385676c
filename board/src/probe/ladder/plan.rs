//! The quality levels that the settings allow.

use crate::pipeline::{Settings, WindowMode};
use crate::samplers::ORDERS;
use hemilux_core::healpix::Domain;
use hemilux_core::wire::{Degraded, Step};

/// Least number of exposures of a burst that are merged at a lowered quality.
const LEAST_EXPOSURES: usize = 2;

/// Least number of lights of a degraded set, unless the sampler requires more.
const LEAST_LIGHTS: usize = 8;

/// Number of steps by which the rate can be lowered: to every second, fourth and eighth burst.
const RATES: usize = 3;

/// The order of the steps, each with the largest number of times that it is taken in this place. Half of the bursts save half of the time; half of
/// the lights save at most a tenth of it and cost more accuracy. The number of lights is halved once before the rate, since a lower rate delays
/// moving light, and again only at the lowest rate.
const PLAN: [(Step, usize); 5] =
    [(Step::Exposures, 4), (Step::Order, 4), (Step::Lights, 1), (Step::Rate, RATES), (Step::Lights, 13)];

/// Quality at which frames are processed at a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// The kinds of steps taken from the full quality.
    pub steps: Degraded,
    /// Number of exposures of a burst to merge, among them the shortest and the longest.
    pub exposures: usize,
    /// HEALPix order of the map.
    pub order: u8,
    /// Largest number of lights of a set.
    pub lights: usize,
    /// Interval of the processed bursts: 1 for every burst, 2 for every second.
    pub every: u32,
}

impl Quality {
    /// Returns the full quality that `settings` permit.
    pub(super) fn full(settings: &Settings, exposures: usize) -> Self {
        let (order, lights) = (settings.order(), settings.lights);
        Self { steps: Degraded::NONE, exposures, order, lights, every: 1 }
    }

    /// Returns the quality that is one `step` lower; `None` if the settings do not permit the step.
    fn lower(self, step: Step, settings: &Settings) -> Option<Self> {
        let mut lower = self;
        lower.steps.add(step);
        match step {
            // A sliding window reads one frame per set.
            Step::Exposures if settings.window == WindowMode::Sliding => {}
            Step::Exposures => lower.exposures = self.exposures.div_ceil(2).max(LEAST_EXPOSURES),
            Step::Order => lower.order = self.order.saturating_sub(1).max(*ORDERS.start()),
            Step::Lights => {
                let least = settings.sampler.least_lights(Domain::Hemisphere).max(LEAST_LIGHTS);
                lower.lights = (self.lights / 2).max(least);
            }
            _ => lower.every = (self.every * 2).min(1 << RATES),
        }
        let is_less = lower.exposures < self.exposures
            || lower.order < self.order
            || lower.lights < self.lights
            || lower.every > self.every;
        is_less.then_some(lower)
    }

    /// Returns the time budget of a processed burst, microseconds: `budget_us` for each of the bursts from one processed burst to the next.
    #[must_use]
    pub fn budget_us(&self, budget_us: u32) -> u32 {
        budget_us.saturating_mul(self.every)
    }

    /// Returns true if the burst of number `burst`, counted from the start, is processed at this quality.
    #[must_use]
    pub fn reads(&self, burst: u32) -> bool {
        burst.is_multiple_of(self.every)
    }

    /// Returns the settings of the pipeline at this quality; `full` is the settings of the full quality.
    #[must_use]
    pub fn settings(&self, full: &Settings) -> Settings {
        if self.steps.is_none() {
            return full.clone();
        }
        Settings { lights: self.lights, order: Some(self.order), ..full.clone() }
    }
}

/// Returns all levels, from the full quality to the poorest: each is one step below the level before, in the order of [`PLAN`].
pub(super) fn levels(settings: &Settings, exposures: usize) -> Vec<Quality> {
    let mut levels = vec![Quality::full(settings, exposures)];
    for (step, most) in PLAN {
        for _ in 0..most {
            let lower = levels.last().and_then(|last| last.lower(step, settings));
            levels.extend(lower);
        }
    }
    levels
}
