//! Settings of a pipeline, and the errors of their combination.

use crate::samplers::{self, SamplerError, Tuning};
use hemilux_core::mains::Lamps;
use hemilux_core::polar::Grid;
use hemilux_core::{
    BurstError, Extrapolation, FrontError, MergeError, MergeMode, PixelTableError, Request, ResponseError,
    SamplerKind,
};

/// Settings of the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Kind of the sampler.
    pub sampler: SamplerKind,
    /// Largest number of lights.
    pub lights: usize,
    /// Shadowed error that the light set must reach with as few lights as possible; only the sampler `adaptive` reads it.
    pub tolerance: Option<f32>,
    /// Whether light without a direction is returned as spherical harmonics; only the sampler `adaptive` reads it.
    pub ambient: bool,
    /// Whether the lights are fitted as discs of their radius.
    pub soft: bool,
    /// The exposures that the merge reads.
    pub merge: MergeMode,
    /// The content of the unseen part of the hemisphere.
    pub extrapolation: Extrapolation,
    /// Lamps whose flicker is removed.
    pub lamps: Lamps,
    /// Parameters of individual samplers, such as the threshold of `q2tree`.
    pub tuning: Tuning,
    /// Order of the map; `None` for what the lights need.
    pub order: Option<u8>,
    /// Shape of the polar map.
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
            extrapolation: Extrapolation::None,
            lamps: Lamps::Auto,
            tuning: Tuning::default(),
            order: None,
            grid: Grid::POLAR,
        }
    }
}

impl Settings {
    /// The request to the sampler.
    #[must_use]
    pub fn request(&self) -> Request {
        Request { lights: self.lights, tolerance: self.tolerance, ambient: self.ambient, soft: self.soft }
    }

    /// Order of the map.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.order.unwrap_or_else(|| samplers::order_for(self.lights))
    }

    /// Whether `other` needs the same sampler, map apart.
    pub(super) fn same_sampler(&self, other: &Self) -> bool {
        let tuning = |s: &Self| s.tuning.of(s.sampler);
        self.sampler == other.sampler && self.lights == other.lights && tuning(self) == tuning(other)
    }
}

/// Reasons for which a pipeline cannot be made or a burst not be processed.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PipelineError {
    /// The response cannot be tabulated.
    #[error("response: found {0}, expected a rising curve and a white level above black")]
    Response(ResponseError),
    /// The exposures do not merge.
    #[error("exposures: found {0}, expected up to twelve positive times at most 2^24 apart")]
    Merge(MergeError),
    /// The lens does not fit the image.
    #[error("lens: found {0}, expected an image circle on the sensor whose pixels fill the map")]
    PixelTable(PixelTableError),
    /// The source does not take such exposure times.
    #[error("exposures_s: {0}")]
    Exposures(String),
    /// No such sampler.
    #[error(transparent)]
    Sampler(#[from] SamplerError),
    /// Frames that do not fit.
    #[error("burst: found {0}, expected frames as calibrated")]
    Burst(BurstError),
    /// Another error of the front end.
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
