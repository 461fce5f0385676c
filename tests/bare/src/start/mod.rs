//! The board-specific code: start code, clock, and measurement of the stack depth.
#![allow(unsafe_code, reason = "memory that the linker names, instructions that Rust does not have")]

#[cfg(target_abi = "eabihf")]
#[path = "cortex_m.rs"]
mod machine;
#[cfg(not(target_abi = "eabihf"))]
#[path = "cortex_a.rs"]
mod machine;

pub use machine::{NAME, clock, instructions};

use core::ops::Range;

/// Bit pattern that marks unused words of the stack, unlikely in used ones.
const PAINT: u32 = 0xc5a3_1e87;

/// Number of bytes below the current stack pointer that are not painted: the stack frames of the painting functions.
const MARGIN: usize = 256;

/// Fills the unused stack with the pattern `PAINT`.
pub fn paint() {
    let here = 0u32;
    let end = (&raw const here).addr() - MARGIN;
    for at in machine::stack().start..end {
        if at % 4 == 0 {
            // SAFETY: the addresses lie between the statics and the frame of this function, which hold no live data; the words are RAM.
            unsafe { core::ptr::with_exposed_provenance_mut::<u32>(at).write_volatile(PAINT) };
        }
    }
}

/// Returns the number of stack bytes that were used since [`paint`], and the number of all stack bytes.
pub fn depth() -> (usize, usize) {
    let Range { start, end } = machine::stack();
    // SAFETY: aligned words of RAM below the stack pointer, or in stack frames, are only read.
    let painted =
        |at: &usize| unsafe { core::ptr::with_exposed_provenance::<u32>(*at).read_volatile() } == PAINT;
    let untouched = (start..end).step_by(4).take_while(painted).count();
    (end - start - 4 * untouched, end - start)
}
