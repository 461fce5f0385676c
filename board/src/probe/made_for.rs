//! The settings on which the memory of a sampler depends.

use crate::pipeline::Pipeline;
use crate::samplers::Tuning;
use hemilux_core::SamplerKind;

/// The order of the map and the tuning of the sampler for which a sampler's memory was allocated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MadeFor {
    order: u8,
    pub(super) tuning: Tuning,
}

impl MadeFor {
    /// Returns the order and the tuning in effect in `pipeline`; of the tuning, only the part that samplers of
    /// `kind` read.
    pub(super) fn now(pipeline: &Pipeline, kind: SamplerKind) -> Self {
        let settings = pipeline.settings();
        Self { order: settings.order(), tuning: settings.tuning.of(kind) }
    }
}
