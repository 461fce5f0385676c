//! Commands about the program itself: shell completions and man pages.

use super::Cli;
use crate::error::SimError;
use crate::output;
use clap::Args;
use hemilux::usage::{self, Shell};
use std::path::PathBuf;

#[derive(Args, Debug)]
pub(super) struct CompletionsArgs {
    /// Shell that reads the completions.
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Args, Debug)]
pub(super) struct ManArgs {
    /// Existing folder for the man pages.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn completions(args: &CompletionsArgs) -> Result<(), SimError> {
    output::say(&usage::completions::<Cli>(args.shell))
}

pub(super) fn man(args: &ManArgs) -> Result<(), SimError> {
    let written = usage::man_pages::<Cli>(&args.out);
    written.map(drop).map_err(|(path, error)| SimError::at(&path, error, "a file that can be written"))
}
