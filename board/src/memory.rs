//! The buffers that a probe allocates, with their sizes in bytes.

use crate::calibration::Calibration;
use crate::pipeline::Pipeline;
use crate::probe::{compare, tiers};
use crate::samplers::{self, Shape, Tuning};
use crate::timing::counters;
use hemilux_core::mains::{Cell, mains_len};
use hemilux_core::polar::{Share, shares_len};
use hemilux_core::{BufferSize, Light, Order, SamplerKind};
use std::fmt;

/// The buffers of a pipeline, and the image size, orders and exposures that determine them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryPlan {
    width: u32,
    height: u32,
    exposures: usize,
    lights: usize,
    /// HEALPix order of the probe's map.
    order: u8,
    /// HEALPix order at which pixels are summed before the map's order is computed.
    source_order: u8,
    buffers: Vec<BufferSize>,
    /// Largest number of bytes that a comparison uses in addition to `buffers` while a client requests one.
    comparison: usize,
    /// Largest number of bytes that each tier uses in addition to `buffers` while clients request the tier.
    tier: usize,
}

/// Number of lights that every sampler accepts; the size of a sampler's state is measured with it.
const SMALL: usize = 12;

impl MemoryPlan {
    /// Lists the buffers of `pipeline` and of its sampler.
    #[must_use]
    pub fn of(pipeline: &Pipeline) -> Self {
        let (c, s) = (pipeline.calibration(), pipeline.settings());
        let (front, exposures) = (pipeline.front(), pipeline.exposures());
        let order = front.order().get();
        let mut buffers = vec![frames(c, exposures)];
        buffers.extend(front.sizes().buffers());
        buffers.push(BufferSize::of::<Cell>("flicker cells", mains_len(front.order())));
        buffers.push(BufferSize::of::<Light>("published lights", 4 * s.lights));
        buffers.push(BufferSize::of::<u32>("durations", counters()));
        buffers.push(BufferSize {
            name: "sampler: state",
            count: 1,
            element_bytes: pipeline.sampler_bytes(),
        });
        buffers.push(BufferSize {
            name: "compared samples",
            count: 1,
            element_bytes: pipeline.inspector_bytes(),
        });
        if pipeline.window_bytes() > 0 {
            buffers.push(BufferSize::of::<u8>("sliding window", pipeline.window_bytes()));
        }
        buffers.extend(samplers::buffers(s.sampler, &pipeline.shape(), s.lights, &s.tuning));
        if pipeline.needs_polar() {
            buffers.push(BufferSize::of::<[f32; 3]>("polar map", s.grid.len()));
            buffers.push(BufferSize::of::<Share>(
                "polar shares",
                shares_len(&s.grid, Order::saturating(samplers::polar_order(order))),
            ));
        }
        let source_order = front.source_order().get();
        let comparison = comparison(&pipeline.shape(), &s.tuning, pipeline.needs_polar());
        let tier = tier(&pipeline.shape(), &s.tuning, s.lights);
        let (width, height) = (c.layout.width(), c.layout.height());
        Self { width, height, exposures, lights: s.lights, order, source_order, buffers, comparison, tier }
    }

    /// Returns the buffers of the pipeline; those of the frames come first.
    #[must_use]
    pub fn buffers(&self) -> &[BufferSize] {
        &self.buffers
    }

    /// Returns the sum of the sizes of all buffers, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.buffers.iter().map(BufferSize::bytes).sum()
    }
}

/// Returns the memory of a tier, bytes, for the sampler that needs most, and its light sets.
fn tier(shape: &Shape, tuning: &Tuning, lights: usize) -> usize {
    let lights = lights.clamp(1, tiers::MOST_LIGHTS);
    let of =
        |kind| samplers::buffers(kind, shape, lights, tuning).iter().map(BufferSize::bytes).sum::<usize>();
    let sampler = SamplerKind::ALL.into_iter().map(of).max().unwrap_or(0);
    sampler + BufferSize::of::<Light>("sets", 4 * lights).bytes()
}

/// Returns the memory of `/v1/compare`, bytes, for the sampler that needs most, its light sets, and the polar map if the pipeline has none.
fn comparison(shape: &Shape, tuning: &Tuning, has_polar: bool) -> usize {
    let Shape { order, grid, .. } = shape;
    let state =
        |kind: SamplerKind| samplers::make(kind, shape, SMALL).map_or(0, |sampler| size_of_val(&*sampler));
    let of = |kind: SamplerKind| {
        let buffers = samplers::buffers(kind, shape, compare::MOST_LIGHTS, tuning);
        state(kind) + buffers.iter().map(BufferSize::bytes).sum::<usize>()
    };
    let polar = grid.len() * size_of::<[f32; 3]>()
        + shares_len(grid, Order::saturating(samplers::polar_order(*order))) * size_of::<Share>();
    SamplerKind::ALL.into_iter().map(of).max().unwrap_or(0)
        + compare::bytes(*order)
        + if has_polar { 0 } else { polar }
}

fn frames(c: &Calibration, exposures: usize) -> BufferSize {
    BufferSize::of::<u8>("frames", c.layout.frame_bytes() * exposures)
}

impl fmt::Display for MemoryPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "image             {} x {}, {} exposures", self.width, self.height, self.exposures)?;
        writeln!(f, "map order         {} (pixels add up at order {})", self.order, self.source_order)?;
        writeln!(f, "lights            {}", self.lights)?;
        writeln!(f, "\n{:<17} {:>10} {:>6} {:>12}", "buffer", "elements", "bytes", "in all")?;
        for buffer in &self.buffers {
            writeln!(
                f,
                "{:<17} {:>10} {:>6} {:>12}",
                buffer.name,
                buffer.count,
                buffer.element_bytes,
                buffer.bytes()
            )?;
        }
        writeln!(f, "{:<17} {:>30}", "sum, bytes", self.bytes())?;
        writeln!(f, "{:<17} {:>30}", "comparison", format!("at most {}", self.comparison))?;
        writeln!(f, "{:<17} {:>30}", "each tier", format!("at most {}", self.tier))
    }
}
