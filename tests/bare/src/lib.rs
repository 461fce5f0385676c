//! A burst in, lights out, in 256 KB: the core as a small camera's controller runs it, with all its memory in one static.
//!
//! `board` runs it on an emulated Cortex-M4F and ARMv7-A and judges the results, `host` on the machine that builds it, and `alone` is
//! an image that does not link while a panic can be reached.
#![no_std]

mod memory;
mod report;
pub mod scene;

#[cfg(target_os = "none")]
pub mod start;

pub use memory::{LIGHTS, MEMORY, Memory, ORDER, SIDE};
pub use report::{Report, Wrong};

use embedded_io::Write;
use hemilux_core::format::{Format, Layout};
use hemilux_core::internals::front;
use hemilux_core::Order;
use hemilux_core::healpix::Domain;
use hemilux_core::lens::Lens;
use hemilux_core::{Samples};
use hemilux_core::internals::merge::{Merge};
use hemilux_core::internals::plan::Plan;
use hemilux_core::polar::LatLongView;
use hemilux_core::pyramid::Pyramid;
use hemilux_core::{Depth, Response};
use hemilux_core::internals::response::{Curve};
use hemilux_core::sampler::q2tree::{Parameters, Q2Tree};
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::wire::{self, LightSet};

/// Takes a burst of the scene, makes lights of it and writes them to `out` as JSON. `clock` counts whatever time is told in.
///
/// # Errors
/// [`Wrong`]: what was refused.
pub fn run<W: Write>(memory: &mut Memory, clock: fn() -> u32, out: &mut W) -> Result<Report, Wrong> {
    let lens = Lens::try_new(scene::LENS)?;
    let taken = scene::expose(&lens, &mut memory.frames);
    decompose(memory, &lens, clock, out).map(|report| Report { taken, ..report })
}

/// From frames to bytes: what a product does.
fn decompose<W: Write>(
    memory: &mut Memory,
    lens: &Lens,
    clock: fn() -> u32,
    out: &mut W,
) -> Result<Report, Wrong> {
    let m = memory;
    let curve = Curve::try_new(&Response::Linear, Depth::U8, scene::BLACK, scene::WHITE, &mut m.curve)?;
    let merge = Merge::try_new(curve, &scene::EXPOSURES, scene::SCALE, (&mut m.tables, &mut m.reciprocals))?;
    let memory = (&mut m.spans, &mut m.weights, &mut m.runs, &mut m.texels);
    let plan = Plan::try_new(lens, SIDE, SIDE, ORDER, memory)?;
    let layout = Layout::tight(Format::Rgb24, SIDE, SIDE)?;
    let mut map = Pyramid::try_new(&mut m.quads, Domain::Hemisphere, Order::saturating(ORDER))?;
    let over = (Domain::Hemisphere, Order::saturating(ORDER));
    let mut sampler = Q2Tree::try_new(
        Parameters::CENTROID,
        over,
        m.bits.each_mut(),
        &mut m.heap,
        (&mut m.lights, &mut m.past),
    )?;

    let (merge, view) = (merge.view(), plan.view());
    let frames = m.frames.each_ref().map(|f| Samples::U8(f));
    let began = clock();
    let sums = front::accumulate(&frames, &layout, &merge, &view, &mut map)?;
    let added = clock();
    let seen = front::finish(&sums, &layout, &merge, &view, [1.0; 3], &mut map);
    let built = clock();
    let map = map.view();
    let request = Request::of_lights(LIGHTS);
    let lights = sampler.update(&Map { pyramid: map, polar: LatLongView::NONE }, &request).lights;
    let sampled = clock();
    let set = LightSet {
        run: "bare",
        valid: true,
        sampler: "q2tree",
        requested: LIGHTS as u32,
        lights,
        scalar_flux: map.total().rgb(),
        horizontal_irradiance: map.horizontal_irradiance(),
        clipped: seen.clipped as f32,
        unseen: seen.unseen as f32,
        ..LightSet::EMPTY
    };
    wire::json(&set, out).map_err(|_| Wrong::Output)?;
    let ticks = [began, added, built, sampled, clock()];
    Ok(Report::of(&set, plan.size(), ticks))
}
