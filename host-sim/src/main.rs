//! The command `hemilux-sim`; `--help` lists its subcommands.

use std::process::ExitCode;

fn main() -> ExitCode {
    hemilux::allocator::keep_little_memory();
    match hemilux_sim::cli::run(std::env::args_os()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("hemilux-sim: {e}");
            ExitCode::from(e.code())
        }
    }
}
