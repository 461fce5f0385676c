//! The values of all settings; clients may change them while the probe runs.

use super::tiers;
use crate::pipeline::{PipelineError, Settings};
use crate::samplers::SamplerError;
use crate::timing::Budgets;
use hemilux_core::{Extrapolation, MergeMode};

/// Names of the kinds of extrapolation that `--extrapolation` and `change?extrapolation=` accept.
pub const EXTRAPOLATIONS: [(&str, Extrapolation); 2] =
    [("none", Extrapolation::None), ("average", Extrapolation::Average)];

/// Returns the name of `extrapolation` on the command line and in `/change`.
#[must_use]
pub fn extrapolation_name(extrapolation: Extrapolation) -> &'static str {
    EXTRAPOLATIONS.iter().find(|(_, e)| *e == extrapolation).map_or("", |(name, _)| name)
}

/// Names of the merge modes that `--merge` and `change?merge=` accept.
pub const MERGES: [(&str, MergeMode); 2] = [("needed", MergeMode::Needed), ("all", MergeMode::All)];

/// Returns the name of the merge mode `mode` on the command line and in `/change`.
#[must_use]
pub fn merge_name(mode: MergeMode) -> &'static str {
    MERGES.iter().find(|(_, m)| *m == mode).map_or("", |(name, _)| name)
}

/// The values of all settings of the probe.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Settings of the sampler and of the map.
    pub pipeline: Settings,
    /// Exposure times of a burst, seconds, ascending; `None` for the exposure times of the source.
    pub exposures_s: Option<Vec<f64>>,
    /// True if the exposure times follow the light of the scene; sources of fixed exposures ignore this
    /// setting.
    pub auto_exposures: bool,
    /// Budgets of the durations of the stages of a frame, microseconds.
    pub budgets: Budgets,
    /// True if `/screenshot` may draw the debug picture. The lights do not depend on this setting.
    pub gui: bool,
    /// Largest number of tiers of light sets, in [`super::tiers::MOST`].
    pub tiers: usize,
    /// True if the quality is lowered where frames exceed the budget of `total`.
    pub degrade: bool,
    /// Factor by which the measured duration of every stage is multiplied, for tests; clients cannot set it.
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
    /// Returns the default settings without degradation under load, for tests that compare sets on a busy machine.
    #[must_use]
    pub fn steady() -> Self {
        Self { degrade: false, ..Self::default() }
    }
}

/// A setting whose new value was refused, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct Refusal {
    /// Name of the refused setting in [`super::settings::SETTINGS`].
    pub setting: &'static str,
    /// Reason of the refusal: the value that was found and the value that was expected.
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
            PipelineError::Window(_) => Self { setting: "window", why: error.to_string() },
            _ => Self { setting: "sampler", why: error.to_string() },
        }
    }
}

impl Config {
    /// Checks that the sampler can give the requested number of lights, and that the settings do not exclude each other.
    ///
    /// # Errors
    /// [`Refusal`] of the first setting whose value the sampler does not support.
    pub fn check(&self) -> Result<(), Refusal> {
        Ok(self.pipeline.check()?)
    }
}
