//! The settings that determine a sampler's memory.

use crate::pipeline::Pipeline;
use crate::samplers::Tuning;
use hemilux_core::SamplerKind;

/// The order of the map and the tuning for which a sampler was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MadeFor {
    order: u8,
    pub(super) tuning: Tuning,
}

impl MadeFor {
    /// Returns the settings in effect of `pipeline`, reduced to those that `kind` reads.
    pub(super) fn now(pipeline: &Pipeline, kind: SamplerKind) -> Self {
        let settings = pipeline.settings();
        Self { order: settings.order(), tuning: settings.tuning.of(kind) }
    }
}
