//! Ends the program with a message on a processor without NEON, before the program executes an instruction of NEON.
//!
//! ARMv7 programs are built with NEON, which any of their functions may use, `main` included. So the check runs before: the loader
//! calls it ahead of everything else of the program. The C library and Rust's are built without NEON.
#![allow(unsafe_code, reason = "nothing safe runs that early")]

use libc::{_exit, AT_HWCAP, STDERR_FILENO, getauxval, write};

const LINE: &[u8] = b"hemilux: found a processor without NEON, expected ARMv7 with it ('neon' among the Features of /proc/cpuinfo)\n";

/// The kernel's bit, of `asm/hwcap.h`.
const HWCAP_NEON: libc::c_ulong = 1 << 12;

/// Exit status of a failure.
const STATUS: libc::c_int = 1;

// SAFETY: entries of this section are functions that the loader calls one by one, with arguments that C's convention lets us ignore.
#[used]
#[unsafe(link_section = ".preinit_array")]
static CHECK: extern "C" fn() = check;

/// Whole words only: there is nothing in it for a compiler to make vectors of (`tests/vectors/missing.sh` runs it without NEON).
extern "C" fn check() {
    // SAFETY: three functions of the C library that need nothing to be set up, and a line that lives for ever.
    unsafe {
        if getauxval(AT_HWCAP) & HWCAP_NEON == 0 {
            // Whether it can be written or not, the program ends.
            let _ = write(STDERR_FILENO, LINE.as_ptr().cast(), LINE.len());
            _exit(STATUS);
        }
    }
}
