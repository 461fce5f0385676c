//! `hemilux calibrate`: what a probe must know of its camera.

use super::{Failure, say};
use crate::calibrate::{
    Board, Calibrated, Grey, Picture, Target, calibrate, exposed, fit_response, residual_picture,
    response_text, target_svg, write, write_response,
};
use crate::recorded::read_grey;
use clap::{Args, Subcommand};
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub(super) struct Calibrate {
    #[command(subcommand)]
    command: CalibrateCommand,
}

#[derive(Debug, Subcommand)]
enum CalibrateCommand {
    /// Write a chessboard to print, as SVG, to stdout.
    Target(TargetOptions),
    /// Compute the lens from pictures of a chessboard.
    Lens(LensOptions),
    /// Compute the response from a recorded burst of a still scene.
    Response(ResponseOptions),
}

#[derive(Debug, Args)]
struct ResponseOptions {
    /// Folder of the burst, with its burst.toml: at least 3 exposures 1 to 2 stops apart, camera and scene still.
    burst: PathBuf,
    /// Lens file in which the [response] is written; without it, the table goes to stdout.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the [response] that the lens file has.
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Args)]
struct TargetOptions {
    /// Inner corners: the points where four squares meet, columns by rows.
    #[arg(long, value_name = "COLUMNSxROWS")]
    board: Board,
    /// Side of a square, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 25.0)]
    square_mm: f64,
}

#[derive(Debug, Args)]
struct LensOptions {
    /// Pictures of the board, taken in the camera's mode of the probe: 15 to 30, the board at all places up to the rim, at several angles.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Inner corners: the points where four squares meet, columns by rows.
    #[arg(long, value_name = "COLUMNSxROWS")]
    board: Board,
    /// Side of a square, millimetres; the lens does not depend on it, the file states it.
    #[arg(long, value_name = "MM")]
    square_mm: Option<f64>,
    /// The lens file; its [response], [sensor] and vignetting are kept.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Picture of the residuals over the image, SVG.
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
    /// Overwrite a lens file that is better, or does not state how good it is.
    #[arg(long)]
    force: bool,
}

pub(super) fn run(options: &Calibrate) -> Result<(), Failure> {
    match &options.command {
        CalibrateCommand::Target(options) => {
            let target = Target { board: options.board, square_mm: options.square_mm };
            say(&target_svg(&target).map_err(|e| Failure::usage(format!("--square-mm: {e}")))?)
        }
        CalibrateCommand::Lens(options) => lens(options),
        CalibrateCommand::Response(options) => response(options),
    }
}

fn lens(options: &LensOptions) -> Result<(), Failure> {
    let pictures = options.images.iter().map(|path| picture(path)).collect::<Result<Vec<_>, _>>()?;
    let calibrated = calibrate(&pictures, options.board).map_err(Failure::new)?;
    write(&options.out, &calibrated, options.square_mm, options.force).map_err(Failure::new)?;
    if let Some(path) = &options.residuals {
        let written = std::fs::write(path, residual_picture(&calibrated));
        written.map_err(|e| {
            Failure::new(format!("{}: found {e}, expected a file that can be written", path.display()))
        })?;
    }
    say(&report(&calibrated, &options.out))
}

fn response(options: &ResponseOptions) -> Result<(), Failure> {
    let (_, frames, step) = exposed(&options.burst).map_err(Failure::new)?;
    let refused = |e| Failure::new(format!("{}: {e}", options.burst.display()));
    let fitted = fit_response(&frames, step).map_err(refused)?;
    for n in &fitted.neighbours {
        eprintln!(
            "hemilux: exposures of the ratio {:.3}: {:.3} by the pictures, they agree within {:.1} % in the median",
            n.declared,
            n.estimated,
            100.0 * n.disagreement
        );
    }
    match &options.out {
        Some(path) => write_response(path, &fitted, options.force).map_err(Failure::new),
        None => say(&response_text(&fitted)),
    }
}

fn picture(path: &Path) -> Result<Picture, Failure> {
    let image = read_grey(path).map_err(Failure::new)?;
    let no_pixels = || Failure::new(format_args!("{}: found no pixels, expected an image", path.display()));
    let grey = Grey::new(image.width, image.samples).ok_or_else(no_pixels)?;
    Ok(Picture { name: path.display().to_string(), grey })
}

fn report(calibrated: &Calibrated, out: &Path) -> String {
    let mut text = String::new();
    for used in &calibrated.used {
        let _ = match used.corners {
            0 => writeln!(text, "{}: no board used", used.name),
            n => writeln!(text, "{}: {n} corners, error {:.3} px", used.name, used.rms_px),
        };
    }
    let _ = writeln!(
        text,
        "{} of {} boards, {} corners kept, {} left out; error {:.3} px, largest {:.3} px; covered up to {:.1} degrees from the axis",
        calibrated.boards(),
        calibrated.used.len(),
        calibrated.corners(),
        calibrated.left_out,
        calibrated.rms_px,
        calibrated.largest_px,
        calibrated.covered_deg
    );
    for spread in &calibrated.spread {
        let halves = spread.halves_deg.map_or("too few boards to tell".into(), |v| format!("{v:.3} degrees"));
        let _ = writeln!(
            text,
            "{:5.1} degrees from the axis: uncertainty {:.3} degrees, difference of the two halves {halves}",
            spread.angle_deg, spread.uncertainty_deg
        );
    }
    let _ = writeln!(text, "wrote {}", out.display());
    text
}
