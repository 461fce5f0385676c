//! Ends the program with an error message on a processor without NEON, before any NEON instruction is executed.
//!
//! ARMv7 programs are compiled with NEON, which the compiler may use in any function, `main` included. The check is therefore called by the
//! loader, before all other code of the program. The C library and Rust's standard library are compiled without NEON.
#![allow(unsafe_code, reason = "nothing safe runs that early")]

use libc::{_exit, AT_HWCAP, STDERR_FILENO, getauxval, write};

const LINE: &[u8] = b"hemilux: found a processor without NEON, expected ARMv7 with it ('neon' among the Features of /proc/cpuinfo)\n";

/// The NEON bit of `AT_HWCAP`, from the kernel's `asm/hwcap.h`.
const HWCAP_NEON: libc::c_ulong = 1 << 12;

/// Exit status of the program on a processor without NEON.
const STATUS: libc::c_int = 1;

// SAFETY: entries of this section are functions that the loader calls one by one; their arguments may be ignored by C's calling convention.
#[used]
#[unsafe(link_section = ".preinit_array")]
static CHECK: extern "C" fn() = check;

/// Uses scalar C calls alone, which a compiler cannot vectorise (`tests/vectors/missing.sh` runs the check without NEON).
extern "C" fn check() {
    // SAFETY: the three C functions need no initialisation, and `LINE` is static.
    unsafe {
        if getauxval(AT_HWCAP) & HWCAP_NEON == 0 {
            // The program ends even if the message cannot be written.
            let _ = write(STDERR_FILENO, LINE.as_ptr().cast(), LINE.len());
            _exit(STATUS);
        }
    }
}
