//! What a user may change while the probe runs.

use crate::pipeline::Settings;
use crate::samplers::{self, SamplerError};
use hemilux_core::fill::Extrapolation;
use hemilux_core::healpix::Domain;

/// Names that `--extrapolation` and `change?extrapolation=` accept.
pub const EXTRAPOLATIONS: [(&str, Extrapolation); 2] =
    [("none", Extrapolation::None), ("average", Extrapolation::Average)];

/// The name of `extrapolation`.
#[must_use]
pub fn extrapolation_name(extrapolation: Extrapolation) -> &'static str {
    EXTRAPOLATIONS.iter().find(|(_, e)| *e == extrapolation).map_or("", |(name, _)| name)
}

/// What is chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// The pipeline's part.
    pub pipeline: Settings,
    /// Whether `screenshot` may draw the debug picture; without effect on the frames.
    pub gui: bool,
}

impl Config {
    /// Whether there is such a sampler and it gives so many lights.
    ///
    /// # Errors
    /// [`SamplerError`].
    pub fn check(&self) -> Result<(), SamplerError> {
        samplers::check(&self.pipeline.sampler, Domain::Hemisphere, &self.pipeline.request())
    }
}

/// A wish: what is `None` stays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// A name of [`crate::samplers::NAMES`].
    pub sampler: Option<String>,
    /// Most lights, 1 to [`crate::samplers::MAX_LIGHTS`].
    pub lights: Option<usize>,
    /// What stands for the unseen.
    pub extrapolation: Option<Extrapolation>,
    /// The shadowed error to reach; `Some(None)` is none to reach.
    pub tolerance: Option<Option<f32>>,
    /// Spherical harmonics for what has no direction.
    pub ambient: Option<bool>,
    /// The debug picture.
    pub gui: Option<bool>,
}

impl Change {
    /// Makes the wish come true in `config`.
    pub fn apply(&self, config: &mut Config) {
        let settings = &mut config.pipeline;
        if let Some(sampler) = &self.sampler {
            settings.sampler.clone_from(sampler);
        }
        settings.lights = self.lights.unwrap_or(settings.lights);
        settings.extrapolation = self.extrapolation.unwrap_or(settings.extrapolation);
        settings.tolerance = self.tolerance.unwrap_or(settings.tolerance);
        settings.ambient = self.ambient.unwrap_or(settings.ambient);
        config.gui = self.gui.unwrap_or(config.gui);
    }
}
