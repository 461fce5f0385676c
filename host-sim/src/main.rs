//! `hemilux-sim`: see `--help`.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match hemilux_sim::cli::run(hemilux_sim::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("hemilux-sim: {e}");
            ExitCode::from(e.code())
        }
    }
}
