//! Cortex-M: `cortex-m-rt` starts it.

use core::ops::Range;
// Its critical section.
use cortex_m as _;
use cortex_m_rt as _;

/// The machine's name.
pub const NAME: &str = "Cortex-M4F";

unsafe extern "C" {
    static __sheap: u8;
    static _stack_start: u8;
}

/// From the end of the statics to the stack's beginning, whole words.
pub(super) fn stack() -> Range<usize> {
    ((&raw const __sheap).addr() + 3) / 4 * 4..(&raw const _stack_start).addr()
}

/// Instructions between two readings of [`clock`] under `-icount shift=6`: 64 ns each, where the clock counts 40 ns.
pub fn instructions(from: u32, to: u32) -> u32 {
    (to.wrapping_sub(from) & 0x00ff_ffff) * 5 / 8
}

/// Counts of the system's timer, which is started by the first call; wraps at 2^24.
pub fn clock() -> u32 {
    const CSR: *mut u32 = core::ptr::without_provenance_mut(0xe000_e010);
    // SAFETY: the registers of SysTick exist on every Cortex-M and nothing else uses them.
    unsafe {
        if CSR.read_volatile() & 1 == 0 {
            CSR.add(1).write_volatile(0x00ff_ffff);
            CSR.add(2).write_volatile(0);
            CSR.write_volatile(5);
        }
        // Counts down.
        0x00ff_ffff - CSR.add(2).read_volatile()
    }
}
