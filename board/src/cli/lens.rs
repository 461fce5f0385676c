//! `hemilux lens`: lens files for hemilux and other programs.

use super::{Failure, say};
use crate::recorded::{Target, convert};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(super) struct Lens {
    #[command(subcommand)]
    command: LensCommand,
}

#[derive(Debug, Subcommand)]
enum LensCommand {
    /// Write a lens file of hemilux, OpenCV, Kalibr, ROS, COLMAP or OCamCalib for another program, to stdout.
    Convert(Convert),
}

#[derive(Debug, Args)]
struct Convert {
    /// The lens file; its contents determine the kind.
    file: PathBuf,
    /// The program that is to read it.
    #[arg(long, value_enum)]
    to: To,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum To {
    /// A [lens] table.
    Hemilux,
    /// YAML of cv::FileStorage.
    Opencv,
    /// YAML of camera_info_manager.
    Ros,
}

pub(super) fn run(options: &Lens) -> Result<(), Failure> {
    let LensCommand::Convert(Convert { file, to }) = &options.command;
    let target = match to {
        To::Hemilux => Target::Hemilux,
        To::Opencv => Target::Opencv,
        To::Ros => Target::Ros,
    };
    let converted = convert(file, target).map_err(Failure::new)?;
    for note in converted.notes {
        eprintln!("hemilux: {}: {note}", file.display());
    }
    say(&converted.text)
}
