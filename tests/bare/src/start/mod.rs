//! What a board needs before `main`, and what only it knows: its clock, and how deep its stack went.
#![allow(unsafe_code, reason = "memory that the linker names, instructions that Rust does not have")]

#[cfg(target_abi = "eabihf")]
#[path = "cortex_m.rs"]
mod machine;
#[cfg(not(target_abi = "eabihf"))]
#[path = "cortex_a.rs"]
mod machine;

pub use machine::{NAME, clock, instructions};

use core::ops::Range;

/// What no program leaves on its stack by chance.
const PAINT: u32 = 0xc5a3_1e87;

/// Bytes that are left unpainted under the stack's present end: frames of the functions that paint.
const MARGIN: usize = 256;

/// Paints the stack below its present end.
pub fn paint() {
    let here = 0u32;
    let end = (&raw const here).addr() - MARGIN;
    for at in machine::stack().start..end {
        if at % 4 == 0 {
            // SAFETY: from the end of the statics up to well below the frame of this function nothing lives; the words are RAM.
            unsafe { core::ptr::with_exposed_provenance_mut::<u32>(at).write_volatile(PAINT) };
        }
    }
}

/// Bytes of the stack that were used since it was [painted](paint), and bytes there are.
pub fn depth() -> (usize, usize) {
    let Range { start, end } = machine::stack();
    // SAFETY: aligned words of RAM below the stack pointer or in frames that are only read.
    let painted =
        |at: &usize| unsafe { core::ptr::with_exposed_provenance::<u32>(*at).read_volatile() } == PAINT;
    let untouched = (start..end).step_by(4).take_while(painted).count();
    (end - start - 4 * untouched, end - start)
}
