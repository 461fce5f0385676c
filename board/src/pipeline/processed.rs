//! Results of the pipeline for one burst: statistics of the map, and the lights of a sampler.

use super::Times;
use hemilux_core::mains::Flicker;
use hemilux_core::wire::{FramesLeftOut, Latency, LightSet};
use hemilux_core::{Coverage, Decomposition};
use std::time::Duration;

/// Results of one processed burst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Processed<'a> {
    /// Lights that the pipeline's sampler computed from the burst.
    pub decomposition: Decomposition<'a>,
    /// Clipped and unseen shares of the hemisphere in the burst.
    pub seen: Coverage,
    /// Scalar flux of the map: the sum of radiance times solid angle, in red, green and blue.
    pub scalar_flux: [f32; 3],
    /// Horizontal irradiance under the map: the sum of radiance times cos(theta) times solid angle, in red, green and blue.
    pub horizontal_irradiance: [f32; 3],
    /// Frames of the burst that contradict its other frames and were not merged.
    pub frames_left_out: FramesLeftOut,
    /// The modulation by mains lamps that was removed from the map.
    pub flicker: Flicker,
    /// Durations of the stages for the burst.
    pub times: Times,
}

/// Lights of one sampler for one burst, and the sampler's durations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled<'a> {
    /// Lights that the sampler computed.
    pub decomposition: Decomposition<'a>,
    /// Duration of the sampler for the burst, without its temporal filters.
    pub sample: Duration,
    /// Duration of the sampler's temporal filters for the burst.
    pub filter: Duration,
}

impl Sampled<'_> {
    /// Returns the latencies `other` of a set that another sampler made of the same burst, with the durations `sample` and `filter` of this
    /// sampler.
    #[must_use]
    pub fn latency(&self, other: &Latency) -> Latency {
        let us = |d: Duration| u32::try_from(d.as_micros()).unwrap_or(u32::MAX);
        let (sample, filter) = (us(self.sample), us(self.filter));
        let total = other.total.saturating_sub(other.sample).saturating_sub(other.filter);
        Latency { sample, filter, total: total.saturating_add(sample).saturating_add(filter), ..*other }
    }
}

impl Processed<'_> {
    /// Returns a light set with the results of the burst; the fields that identify the frame are those of [`LightSet::EMPTY`].
    #[must_use]
    pub fn light_set(&self) -> LightSet<'_> {
        LightSet {
            lights: self.decomposition.lights,
            ambient_sh: self.decomposition.ambient.as_ref(),
            estimated_error: self.decomposition.estimated_error,
            scalar_flux: self.scalar_flux,
            horizontal_irradiance: self.horizontal_irradiance,
            clipped: self.seen.clipped as f32,
            clipped_irradiance_at_least: self.seen.clipped_irradiance,
            unseen: self.seen.unseen as f32,
            latency: self.times.latency(),
            frames_left_out: self.frames_left_out,
            flicker: self.flicker,
            ..LightSet::EMPTY
        }
    }
}
