//! The configuration, which users may change while the probe runs.

use super::tiers;
use crate::pipeline::{PipelineError, Settings};
use crate::samplers::{self, SamplerError};
use crate::timing::Budgets;
use hemilux_core::healpix::Domain;
use hemilux_core::{Extrapolation, MergeMode};

/// Names that `--extrapolation` and `change?extrapolation=` accept.
pub const EXTRAPOLATIONS: [(&str, Extrapolation); 2] =
    [("none", Extrapolation::None), ("average", Extrapolation::Average)];

/// The name of `extrapolation`.
#[must_use]
pub fn extrapolation_name(extrapolation: Extrapolation) -> &'static str {
    EXTRAPOLATIONS.iter().find(|(_, e)| *e == extrapolation).map_or("", |(name, _)| name)
}

/// Names that `--merge` and `change?merge=` accept.
pub const MERGES: [(&str, MergeMode); 2] = [("needed", MergeMode::Needed), ("all", MergeMode::All)];

/// The name of `mode`.
#[must_use]
pub fn merge_name(mode: MergeMode) -> &'static str {
    MERGES.iter().find(|(_, m)| *m == mode).map_or("", |(name, _)| name)
}

/// The values of all settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Settings of the pipeline.
    pub pipeline: Settings,
    /// Exposure times, seconds, ascending; `None` for those of the source.
    pub exposures_s: Option<Vec<f64>>,
    /// Whether the exposures follow the light, if the source can change them.
    pub auto_exposures: bool,
    /// The budget of each stage.
    pub budgets: Budgets,
    /// Whether `/screenshot` may draw the debug picture. The frames do not depend on it.
    pub gui: bool,
    /// Largest number of tiers, of [`super::tiers::MOST`].
    pub tiers: usize,
    /// Whether the quality is lowered where frames take longer than the budget of `total`.
    pub degrade: bool,
    /// Factor by which every stage is slower than this machine; no setting, but a test aid.
    pub slowdown: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            pipeline: Settings::default(),
            exposures_s: None,
            auto_exposures: false,
            budgets: Budgets::default(),
            gui: false,
            tiers: tiers::USUAL,
            degrade: true,
            slowdown: 1.0,
        }
    }
}

impl Config {
    /// The default settings, but with the same quality at any load: for tests that compare sets on a busy machine.
    #[must_use]
    pub fn steady() -> Self {
        Self { degrade: false, ..Self::default() }
    }
}

/// A refused setting and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct Refusal {
    /// Name of the setting in [`super::settings::SETTINGS`].
    pub setting: &'static str,
    /// The found and the expected value, in words.
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
    /// Checks that the sampler exists and can give the requested number of lights.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn check(&self) -> Result<(), Refusal> {
        Ok(samplers::check(self.pipeline.sampler, Domain::Hemisphere, &self.pipeline.request())?)
    }
}
