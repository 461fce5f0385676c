//! `hemilux lens`: converts lens files of hemilux and other programs.

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
    /// Convert a lens file of hemilux, OpenCV, Kalibr, ROS, COLMAP or OCamCalib for another program, and write it to stdout.
    Convert(Convert),
}

#[derive(Debug, Args)]
struct Convert {
    /// The lens file; its kind follows from its contents.
    file: PathBuf,
    /// The program for which the file is written.
    #[arg(long, value_enum)]
    to: To,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum To {
    /// A [lens] table of hemilux.
    Hemilux,
    /// YAML of OpenCV's cv::FileStorage.
    Opencv,
    /// YAML of ROS's camera_info_manager.
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
