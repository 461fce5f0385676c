//! Settings of a pipeline, and the errors of settings that do not fit a camera.

use super::window_mode::WindowMode;
use crate::samplers::{self, SamplerError, Tuning};
use hemilux_core::mains::Lamps;
use hemilux_core::polar::Grid;
use hemilux_core::{
    BurstError, Domain, Extrapolation, FrontError, MergeError, MergeMode, PixelTableError, Request,
    ResponseError, SamplerKind,
};

/// Settings of a pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Kind of the sampler.
    pub sampler: SamplerKind,
    /// Largest number of lights of a set.
    pub lights: usize,
    /// Shadowed error, a ratio, that the light set must reach with the least number of lights; only the sampler `adaptive` reads it.
    pub tolerance: Option<f32>,
    /// True if diffuse light is returned as spherical harmonics; only the sampler `adaptive` reads it.
    pub ambient: bool,
    /// True if the lights are fitted as discs of their radius.
    pub soft: bool,
    /// Whether all exposures of a burst are merged at each pixel, or only the needed ones.
    pub merge: MergeMode,
    /// The frames that a set is computed from.
    pub window: WindowMode,
    /// Radiance of the part of the hemisphere outside of the lens's field.
    pub extrapolation: Extrapolation,
    /// Frequency of the mains lamps whose flicker is removed.
    pub lamps: Lamps,
    /// Parameters of individual samplers, such as the threshold of `q2tree`.
    pub tuning: Tuning,
    /// HEALPix order of the map; `None` for the order that the number of lights needs.
    pub order: Option<u8>,
    /// Numbers of rows and columns of the polar map.
    pub grid: Grid,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            sampler: SamplerKind::Adaptive,
            lights: 64,
            tolerance: None,
            ambient: false,
            soft: false,
            merge: MergeMode::Needed,
            window: WindowMode::Burst,
            extrapolation: Extrapolation::None,
            lamps: Lamps::Auto,
            tuning: Tuning::default(),
            order: None,
            grid: Grid::POLAR,
        }
    }
}

impl Settings {
    /// Returns the request of these settings to the sampler.
    #[must_use]
    pub fn request(&self) -> Request {
        Request { lights: self.lights, tolerance: self.tolerance, ambient: self.ambient, soft: self.soft }
    }

    /// Checks that the sampler can give the requested number of lights, and that the settings do not exclude each other.
    ///
    /// # Errors
    /// [`PipelineError::Sampler`] and [`PipelineError::Window`].
    pub fn check(&self) -> Result<(), PipelineError> {
        samplers::check(self.sampler, Domain::Hemisphere, &self.request())?;
        // The fit of the flicker needs bursts of equal exposures.
        let excludes = self.window == WindowMode::Sliding && self.lamps != Lamps::Off;
        if excludes { Err(PipelineError::Window(self.lamps.name())) } else { Ok(()) }
    }

    /// Returns the HEALPix order of the map.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.order.unwrap_or_else(|| samplers::order_for(self.lights))
    }

    /// Returns true if the settings `other` have the same sampler with the same memory; the map may differ.
    pub(super) fn same_sampler(&self, other: &Self) -> bool {
        let tuning = |s: &Self| s.tuning.of(s.sampler);
        self.sampler == other.sampler && self.lights == other.lights && tuning(self) == tuning(other)
    }
}

/// Reasons why a pipeline cannot be made or a burst cannot be processed.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PipelineError {
    /// The response of the camera is invalid.
    #[error("response: found {0}, expected an ascending curve and a white level above black")]
    Response(ResponseError),
    /// The exposures of the burst cannot be merged.
    #[error("exposures: found {0}, expected up to twelve positive times at most 2^24 apart")]
    Merge(MergeError),
    /// The lens does not fit the image.
    #[error("lens: found {0}, expected an image circle on the sensor whose pixels fill the map")]
    PixelTable(PixelTableError),
    /// The source does not support the exposure times.
    #[error("exposures_s: {0}")]
    Exposures(String),
    /// The sampler does not support the request of the settings.
    #[error(transparent)]
    Sampler(#[from] SamplerError),
    /// A sliding window with the removal of flicker.
    #[error(
        "window = sliding with mains = {0}, expected mains = off, since flicker is removed from bursts alone"
    )]
    Window(&'static str),
    /// The frames do not fit the calibration.
    #[error("burst: found {0}, expected frames that fit the calibration")]
    Burst(BurstError),
    /// All frames of the first burst of a new map are left out.
    #[error(
        "burst: found frames that contradict each other, expected the first burst of a new map to be sound"
    )]
    NoFrame,
    /// Any other error of the front end.
    #[error("calibration: found {0}, expected one that the core can process")]
    Front(FrontError),
}

impl From<FrontError> for PipelineError {
    fn from(error: FrontError) -> Self {
        match error {
            FrontError::Response(e) => Self::Response(e),
            FrontError::Exposures(e) => Self::Merge(e),
            FrontError::PixelTable(e) => Self::PixelTable(e),
            FrontError::Burst(e) => Self::Burst(e),
            other => Self::Front(other),
        }
    }
}
