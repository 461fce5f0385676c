//! The command `hemilux`.

use std::io::Write;
use std::panic::PanicHookInfo;
use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(target_env = "gnu")]
    return_large_blocks();
    std::panic::set_hook(Box::new(tell_panic));
    match hemilux::cli::run(std::env::args_os()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let _ = writeln!(std::io::stderr(), "hemilux: {}", failure.line);
            ExitCode::from(failure.status)
        }
    }
}

/// Makes the allocator return blocks of 256 KB and more, such as answers of thousands of lights, to the system when they are freed. By
/// default, glibc raises its threshold M_MMAP_THRESHOLD to the size of the largest freed block and keeps freed blocks below the threshold:
/// with sets of 50,000 lights, the program keeps 14 MB.
#[cfg(target_env = "gnu")]
#[allow(unsafe_code, reason = "the option has no safe wrapper")]
fn return_large_blocks() {
    // SAFETY: `mallopt` may be called at any time; it takes and returns integers.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 256 << 10) };
}

/// Prints a panic as one line on stderr.
fn tell_panic(panic: &PanicHookInfo<'_>) {
    let thread = std::thread::current();
    let place = panic.location().map_or_else(String::new, |place| format!(" at {place}"));
    let why = panic.payload_as_str().unwrap_or("no reason").replace('\n', " ");
    let _ = writeln!(
        std::io::stderr(),
        "hemilux: thread {} panicked{place}: {why}",
        thread.name().unwrap_or("?")
    );
}
