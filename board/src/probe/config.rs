//! What a user may change while the probe runs.

use super::tiers;
use crate::pipeline::{PipelineError, Settings};
use crate::samplers::{self, SamplerError};
use crate::timing::Budgets;
use hemilux_core::Extrapolation;
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use hemilux_core::wire::STAGES;

/// Names that `--extrapolation` and `change?extrapolation=` accept.
pub const EXTRAPOLATIONS: [(&str, Extrapolation); 2] =
    [("none", Extrapolation::None), ("average", Extrapolation::Average)];

/// The name of `extrapolation`.
#[must_use]
pub fn extrapolation_name(extrapolation: Extrapolation) -> &'static str {
    EXTRAPOLATIONS.iter().find(|(_, e)| *e == extrapolation).map_or("", |(name, _)| name)
}

/// What is chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The pipeline's part.
    pub pipeline: Settings,
    /// Exposure times, seconds, rising; `None` for the source's own.
    pub exposures_s: Option<Vec<f64>>,
    /// How long it may take.
    pub budgets: Budgets,
    /// Whether `screenshot` may draw the debug picture; without effect on the frames.
    pub gui: bool,
    /// Largest number of tiers, of [`super::tiers::MOST`].
    pub tiers: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            pipeline: Settings::default(),
            exposures_s: None,
            budgets: Budgets::default(),
            gui: false,
            tiers: tiers::USUAL,
        }
    }
}

/// Why settings cannot be, and which is at fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct Refusal {
    /// Its name in [`super::settings::SETTINGS`].
    pub setting: &'static str,
    /// What was found and what was expected.
    pub why: String,
}

impl From<SamplerError> for Refusal {
    fn from(error: SamplerError) -> Self {
        let setting = match error {
            SamplerError::BadLights { .. } => "lights",
            SamplerError::BadTolerance(_) => "tolerance",
            _ => "sampler",
        };
        Self { setting, why: error.to_string() }
    }
}

impl From<PipelineError> for Refusal {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Sampler(error) => error.into(),
            PipelineError::PixelTable(_) => Self { setting: "order", why: error.to_string() },
            PipelineError::Merge(_) | PipelineError::Exposures(_) => {
                Self { setting: "exposures_s", why: error.to_string() }
            }
            _ => Self { setting: "sampler", why: error.to_string() },
        }
    }
}

impl Config {
    /// Whether there is such a sampler and it gives so many lights.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn check(&self) -> Result<(), Refusal> {
        Ok(samplers::check(self.pipeline.sampler, Domain::Hemisphere, &self.pipeline.request())?)
    }
}

/// A wish: what is `None` stays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// The sampler.
    pub sampler: Option<SamplerKind>,
    /// Most lights, 1 to [`crate::samplers::MAX_LIGHTS`].
    pub lights: Option<usize>,
    /// What stands for the unseen.
    pub extrapolation: Option<Extrapolation>,
    /// The shadowed error to reach; `Some(None)` is none to reach.
    pub tolerance: Option<Option<f32>>,
    /// Spherical harmonics for what has no direction.
    pub ambient: Option<bool>,
    /// `q2tree`'s threshold.
    pub threshold: Option<f32>,
    /// Frames that `hemigon-fir` filters over.
    pub taps: Option<usize>,
    /// Its cut-off frequency.
    pub cutoff_hz: Option<f32>,
    /// The map's order; `Some(None)` is what the lights need.
    pub order: Option<Option<u8>>,
    /// Exposure times; `Some(None)` is the source's own.
    pub exposures_s: Option<Option<Vec<f64>>>,
    /// Budgets by stage.
    pub budgets_ms: [Option<f32>; STAGES],
    /// The debug picture.
    pub gui: Option<bool>,
    /// Largest number of tiers.
    pub tiers: Option<usize>,
}

impl Change {
    /// Makes the wish come true in `config`.
    pub fn apply(&self, config: &mut Config) {
        let settings = &mut config.pipeline;
        settings.sampler = self.sampler.unwrap_or(settings.sampler);
        settings.lights = self.lights.unwrap_or(settings.lights);
        settings.extrapolation = self.extrapolation.unwrap_or(settings.extrapolation);
        settings.tolerance = self.tolerance.unwrap_or(settings.tolerance);
        settings.ambient = self.ambient.unwrap_or(settings.ambient);
        settings.order = self.order.unwrap_or(settings.order);
        let tuning = &mut settings.tuning;
        tuning.threshold = self.threshold.unwrap_or(tuning.threshold);
        tuning.taps = self.taps.unwrap_or(tuning.taps);
        tuning.cutoff_hz = self.cutoff_hz.unwrap_or(tuning.cutoff_hz);
        if let Some(exposures) = &self.exposures_s {
            config.exposures_s.clone_from(exposures);
        }
        for (i, ms) in self.budgets_ms.iter().enumerate() {
            if let Some(ms) = ms {
                config.budgets.set_ms(i, *ms);
            }
        }
        config.gui = self.gui.unwrap_or(config.gui);
        config.tiers = self.tiers.unwrap_or(config.tiers);
    }
}
