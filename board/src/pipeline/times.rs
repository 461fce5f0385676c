//! Durations of the stages of one burst.

use hemilux_core::wire::Latency;
use std::time::Duration;

/// Duration of each stage of the pipeline for one burst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// Duration of the front stage: merge and map.
    pub front: Duration,
    /// Duration of the pyramid stage: pyramid and polar map.
    pub pyramid: Duration,
    /// Duration of the sampler without its temporal filters.
    pub sample: Duration,
    /// Duration of the sampler's temporal filters.
    pub filter: Duration,
}

impl Times {
    /// Returns the durations of all stages multiplied by `factor`.
    #[must_use]
    pub fn slowed(&self, factor: f32) -> Self {
        let slowed = |d: Duration| Duration::try_from_secs_f32(d.as_secs_f32() * factor).unwrap_or(d);
        let Self { front, pyramid, sample, filter } = *self;
        Self {
            front: slowed(front),
            pyramid: slowed(pyramid),
            sample: slowed(sample),
            filter: slowed(filter),
        }
    }

    /// Returns the sum of the durations of all stages.
    #[must_use]
    pub fn sum(&self) -> Duration {
        self.front + self.pyramid + self.sample + self.filter
    }

    /// Returns the latencies of a light set with `front`, `pyramid`, `sample`, `filter` and their sum as `total`, microseconds; the other
    /// latencies are 0.
    #[must_use]
    pub fn latency(&self) -> Latency {
        let us = |d: Duration| u32::try_from(d.as_micros()).unwrap_or(u32::MAX);
        Latency {
            front: us(self.front),
            pyramid: us(self.pyramid),
            sample: us(self.sample),
            filter: us(self.filter),
            total: us(self.front + self.pyramid + self.sample + self.filter),
            ..Latency::default()
        }
    }
}
