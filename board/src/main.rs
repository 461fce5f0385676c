//! The command `hemilux`.

use std::io::Write;
use std::panic::PanicHookInfo;
use std::process::ExitCode;

fn main() -> ExitCode {
    hemilux::allocator::keep_little_memory();
    std::panic::set_hook(Box::new(tell_panic));
    match hemilux::cli::run(std::env::args_os()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let _ = writeln!(std::io::stderr(), "hemilux: {}", failure.line);
            ExitCode::from(failure.status)
        }
    }
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
