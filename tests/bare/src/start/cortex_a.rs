//! Start code of Cortex-A: QEMU enters the image in supervisor mode, with MMU and caches off.

use core::arch::{asm, global_asm};
use core::ops::Range;

/// Name of the processor in reports.
pub const NAME: &str = "Cortex-A7";

// Sets the stack pointer, clears the statics and calls main.
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

/// Returns the address range from the end of the statics to the start of the stack, whole words.
pub(super) fn stack() -> Range<usize> {
    (&raw const __bss_end).addr()..(&raw const __stack_top).addr()
}

/// Converts two readings of [`clock`] to the number of instructions between them: under `-icount shift=0` an instruction takes 1 ns, a count 16 ns.
pub fn instructions(from: u32, to: u32) -> u32 {
    to.wrapping_sub(from).saturating_mul(16)
}

/// Returns the count of the generic timer.
pub fn clock() -> u32 {
    let (low, _high): (u32, u32);
    // SAFETY: reads CNTVCT, which exists on every core with the generic timer.
    unsafe { asm!("isb", "mrrc p15, 1, {}, {}, c14", out(reg) low, out(reg) _high) };
    low
}

struct SingleCore;
critical_section::set_impl!(SingleCore);

// SAFETY: one core and no threads, so masked interrupts exclude all other code.
unsafe impl critical_section::Impl for SingleCore {
    unsafe fn acquire() -> critical_section::RawRestoreState {
        let cpsr: u32;
        // SAFETY: permitted in supervisor mode, in which the program always runs.
        unsafe { asm!("mrs {}, cpsr", "cpsid i", out(reg) cpsr) };
        cpsr
    }

    unsafe fn release(cpsr: critical_section::RawRestoreState) {
        if cpsr & 0x80 == 0 {
            // SAFETY: interrupts were enabled before `acquire`.
            unsafe { asm!("cpsie i") };
        }
    }
}
