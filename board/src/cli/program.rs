//! Commands about the program itself: shell completions and man pages.

use super::{Cli, Failure, say_bytes};
use crate::usage::{self, Shell};
use clap::Args;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub(super) struct Completions {
    /// Name of the shell.
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Clone, Debug, Args)]
pub(super) struct Man {
    /// Folder for the pages; it must exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn completions(options: &Completions) -> Result<(), Failure> {
    say_bytes(&usage::completions::<Cli>(options.shell))
}

pub(super) fn man(options: &Man) -> Result<(), Failure> {
    let written = usage::man_pages::<Cli>(&options.out);
    let failed = |(path, error): (PathBuf, std::io::Error)| {
        Failure::new(format!("{}: found {error}, expected a file that can be written", path.display()))
    };
    written.map(drop).map_err(failed)
}
