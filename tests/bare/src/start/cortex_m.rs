//! Start code of Cortex-M, provided by `cortex-m-rt`.

use core::ops::Range;
// Links the critical section of the crate `cortex_m`.
use cortex_m as _;
use cortex_m_rt as _;

/// Name of the processor in reports.
pub const NAME: &str = "Cortex-M4F";

unsafe extern "C" {
    static __sheap: u8;
    static _stack_start: u8;
}

/// Returns the address range from the end of the statics to the start of the stack, whole words.
pub(super) fn stack() -> Range<usize> {
    ((&raw const __sheap).addr() + 3) / 4 * 4..(&raw const _stack_start).addr()
}

/// Converts two readings of [`clock`] to the number of instructions between them: under `-icount shift=6` an instruction takes 64 ns, a count 40 ns.
pub fn instructions(from: u32, to: u32) -> u32 {
    (to.wrapping_sub(from) & 0x00ff_ffff) * 5 / 8
}

/// Returns the count of the system timer, which the first call starts; wraps at 2^24.
pub fn clock() -> u32 {
    const CSR: *mut u32 = core::ptr::without_provenance_mut(0xe000_e010);
    // SAFETY: the registers of SysTick exist on every Cortex-M and no other code uses them.
    unsafe {
        if CSR.read_volatile() & 1 == 0 {
            CSR.add(1).write_volatile(0x00ff_ffff);
            CSR.add(2).write_volatile(0);
            CSR.write_volatile(5);
        }
        // The timer counts down.
        0x00ff_ffff - CSR.add(2).read_volatile()
    }
}
