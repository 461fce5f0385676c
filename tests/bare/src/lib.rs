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
use hemilux_core::wire::{self, LightSet};
use hemilux_core::{Calibration, Coverage, Format, FrontEnd, Lens, Levels, Light, Q2Tree};

/// Takes a burst of the scene, makes lights of it and writes them to `out` as JSON. `clock` counts whatever time is told in.
///
/// # Errors
/// [`Wrong`]: what was refused.
pub fn run<W: Write>(memory: &mut Memory, clock: fn() -> u32, out: &mut W) -> Result<Report, Wrong> {
    let taken = expose(memory)?;
    decompose(memory, clock, out).map(|report| Report { taken, ..report })
}

/// Fills the frames. The lens leaves the stack here.
#[inline(never)]
fn expose(memory: &mut Memory) -> Result<scene::Taken, Wrong> {
    Ok(scene::expose(&Lens::try_new(scene::LENS)?, &mut memory.frames))
}

/// From frames to bytes: what a product does.
fn decompose<W: Write>(memory: &mut Memory, clock: fn() -> u32, out: &mut W) -> Result<Report, Wrong> {
    let m = memory;
    let mut front = front_end(&mut m.map)?;
    let (heap, lights, past) = (&mut m.heap, &mut m.lights, &mut m.past);
    let mut sampler =
        Q2Tree::try_new(Default::default(), front.shape(), m.bits.each_mut(), heap, lights, past)?;

    let frames = m.frames.each_ref().map(|f| f.as_slice().into());
    let (began, mut added) = (clock(), 0);
    let seen = front.process_timed(&frames, || added = clock())?;
    let built = clock();
    let lights = front.decompose(&mut sampler, LIGHTS).lights;
    let ticks = [began, added, built, clock()];
    report(&front, lights, seen, ticks, clock, out)
}

/// Writes the lights. The light set leaves the stack here.
#[inline(never)]
fn report<W: Write>(
    front: &FrontEnd<&mut [u64]>,
    lights: &[Light],
    seen: Coverage,
    ticks: [u32; 4],
    clock: fn() -> u32,
    out: &mut W,
) -> Result<Report, Wrong> {
    let map = front.map();
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
    let [began, added, built, sampled] = ticks;
    Ok(Report::of(&set, front.sizes(), [began, added, built, sampled, clock()]))
}

/// The front end of the scene's camera. What it is made from leaves the stack here.
#[inline(never)]
fn front_end(memory: &mut [u64]) -> Result<FrontEnd<&mut [u64]>, Wrong> {
    let lens = Lens::try_new(scene::LENS)?;
    let mut calibration = Calibration::try_new(lens, Format::Rgb24, SIDE, SIDE)?;
    calibration.levels = Levels { black: scene::BLACK, white: scene::WHITE };
    calibration.scale = scene::SCALE;
    Ok(FrontEnd::try_new(calibration, &scene::EXPOSURES, ORDER.try_into()?, memory)?)
}
