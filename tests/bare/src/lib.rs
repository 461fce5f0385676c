//! Converts a burst to lights in 256 KB of RAM with all memory in one static, as the microcontroller of a small camera would.
//!
//! `board` runs the code on an emulated Cortex-M4F and ARMv7-A and checks the results, `host` runs it on the build machine, and `alone` is
//! an image that does not link if it contains a reachable panic.
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

/// Renders a burst of the scene, decomposes it and writes the lights to `out` as JSON. `clock` returns a count in any unit of time.
///
/// # Errors
/// [`Wrong`] with the error of the stage that failed.
pub fn run<W: Write>(memory: &mut Memory, clock: fn() -> u32, out: &mut W) -> Result<Report, Wrong> {
    let taken = expose(memory)?;
    decompose(memory, clock, out).map(|report| Report { taken, ..report })
}

/// Renders the scene into the frames. A separate function, so that the lens takes no stack later.
#[inline(never)]
fn expose(memory: &mut Memory) -> Result<scene::Taken, Wrong> {
    Ok(scene::expose(&Lens::try_new(scene::LENS)?, &mut memory.frames))
}

/// Runs the stages of a product, from frames to encoded bytes.
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

/// Writes the lights. A separate function, so that the light set takes no stack later.
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

/// Creates the front end of the scene's camera. A separate function, so that its arguments take no stack later.
#[inline(never)]
fn front_end(memory: &mut [u64]) -> Result<FrontEnd<&mut [u64]>, Wrong> {
    let lens = Lens::try_new(scene::LENS)?;
    let mut calibration = Calibration::try_new(lens, Format::Rgb24, SIDE, SIDE)?;
    calibration.levels = Levels { black: scene::BLACK, white: scene::WHITE };
    calibration.scale = scene::SCALE;
    Ok(FrontEnd::try_new(calibration, &scene::EXPOSURES, ORDER.try_into()?, memory)?)
}
