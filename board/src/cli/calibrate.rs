//! `hemilux calibrate`: what a probe must know of its camera.

use super::{Failure, say};
use crate::calibrate::{
    Board, Calibrated, Fault, Grey, Picture, Shown, Target, calibrate, check, exposed, fit_response,
    fit_vignetting, flat_field, residual_picture, response_text, screen, target_svg, write, write_response,
    write_vignetting,
};
use crate::recorded::{read_grey, read_lens};
use clap::{Args, Subcommand};
use hemilux_core::Response;
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
    /// Compute the relative illumination of a lens from pictures of a lit screen at several angles, or of a flat field.
    Vignetting(VignettingOptions),
    /// Check that a lens file, a burst and the camera belong together; the exit status names the class of the fault.
    #[command(after_help = CHECK_HELP)]
    Check(CheckOptions),
    /// Compute the response from a recorded burst of a still scene.
    Response(ResponseOptions),
}

const CHECK_HELP: &str = "\
Exit status: 0 without a fault, 3 for a file that cannot be read, 4 for another image size, 5 for solid angles that do not add up,
6 for a lens that is uncertain or used beyond its calibration, 7 for exposures that are not what burst.toml says, 8 for another lens.";

#[derive(Debug, Args)]
struct CheckOptions {
    /// Lens file.
    lens: PathBuf,
    /// Folder of a burst that the camera recorded.
    #[arg(long, value_name = "DIR")]
    burst: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct VignettingOptions {
    /// Pictures at one fixed exposure: of a small lit screen (phone, e-reader) in the dark, one for each angle from the axis to the rim.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The pictures show an evenly lit surface that fills the view, such as the inside of a sphere.
    #[arg(long)]
    flat: bool,
    /// Lens file into which the vignetting is written; its [response] applies, sRGB where it has none.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the vignetting that the lens file has.
    #[arg(long)]
    force: bool,
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
        CalibrateCommand::Vignetting(options) => vignetting(options),
        CalibrateCommand::Check(options) => {
            let fault = |fault: Fault| Failure { line: fault.to_string(), status: fault.status() };
            check(&options.lens, options.burst.as_deref()).map_err(fault)?;
            say("no fault found\n")
        }
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

fn vignetting(options: &VignettingOptions) -> Result<(), Failure> {
    let file = read_lens(&options.out).map_err(Failure::new)?;
    let response = file.told_response().unwrap_or(Response::Srgb);
    let mut readings = Vec::new();
    for path in &options.images {
        let grey = grey(path)?;
        let size = grey.size();
        if size != file.size.map(|n| n as usize) {
            return Err(Failure::new(format!(
                "{}: found {} x {} pixels, expected {} x {} as the lens",
                path.display(),
                size[0],
                size[1],
                file.size[0],
                file.size[1]
            )));
        }
        let shown = Shown { grey: &grey, response: &response };
        if options.flat {
            readings.extend(flat_field(&file.lens, &shown));
        } else if let Some(reading) = screen(&file.lens, &shown) {
            readings.push(reading);
        } else {
            eprintln!(
                "hemilux: {}: found no screen that is lit and not clipped, left out: expose so that its code is between a tenth and all of the range",
                path.display()
            );
        }
    }
    let fitted = fit_vignetting(&file.lens, &readings).map_err(Failure::new)?;
    write_vignetting(&options.out, &fitted, options.force).map_err(Failure::new)?;
    say(&format!(
        "{} readings up to {:.1} degrees fit within {:.1} %, the worst within {:.1} %\nwrote {}\n",
        fitted.readings,
        fitted.covered.to_degrees(),
        100.0 * fitted.rms,
        100.0 * fitted.largest,
        options.out.display()
    ))
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

fn grey(path: &Path) -> Result<Grey, Failure> {
    let image = read_grey(path).map_err(Failure::new)?;
    let no_pixels = || Failure::new(format_args!("{}: found no pixels, expected an image", path.display()));
    Grey::new(image.width, image.samples).ok_or_else(no_pixels)
}

fn picture(path: &Path) -> Result<Picture, Failure> {
    Ok(Picture { name: path.display().to_string(), grey: grey(path)? })
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
