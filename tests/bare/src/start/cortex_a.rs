//! Cortex-A: QEMU enters the image in supervisor mode, with MMU and caches off.

use core::arch::{asm, global_asm};
use core::ops::Range;

/// The machine's name.
pub const NAME: &str = "Cortex-A7";

// Stack, zeroed statics, main.
global_asm!(
    ".section .text._start,\"ax\"",
    ".global _start",
    ".arm",
    "_start:",
    "ldr sp, =__stack_top",
    "ldr r0, =__bss_start",
    "ldr r1, =__bss_end",
    "mov r2, #0",
    "1: cmp r0, r1",
    "strlo r2, [r0], #4",
    "blo 1b",
    "bl main",
    "2: b 2b",
);

unsafe extern "C" {
    static __bss_end: u8;
    static __stack_top: u8;
}

/// From the end of the statics to the stack's beginning, whole words.
pub(super) fn stack() -> Range<usize> {
    (&raw const __bss_end).addr()..(&raw const __stack_top).addr()
}

/// Instructions between two readings of [`clock`] under `-icount shift=0`: 1 ns each, where the clock counts 16 ns.
pub fn instructions(from: u32, to: u32) -> u32 {
    to.wrapping_sub(from).saturating_mul(16)
}

/// Counts of the generic timer.
pub fn clock() -> u32 {
    let (low, _high): (u32, u32);
    // SAFETY: reads CNTVCT, which every core with the generic timer has.
    unsafe { asm!("isb", "mrrc p15, 1, {}, {}, c14", out(reg) low, out(reg) _high) };
    low
}

struct SingleCore;
critical_section::set_impl!(SingleCore);

// SAFETY: one core, no threads: what masks interrupts excludes everything else.
unsafe impl critical_section::Impl for SingleCore {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        let cpsr: u32;
        // SAFETY: allowed in supervisor mode, which nothing leaves.
        unsafe { asm!("mrs {}, cpsr", "cpsid i", out(reg) cpsr) };
        cpsr
    }

    unsafe fn release(cpsr: critical_section::RawRestoreState) {
        if cpsr & 0x80 == 0 {
            // SAFETY: interrupts were on before.
            unsafe { asm!("cpsie i") };
        }
    }
}
