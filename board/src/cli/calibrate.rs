//! `hemilux calibrate`: lens, response, vignetting and photometric calibration of a camera.

mod live;
mod photometric;

use super::{Failure, say};
use crate::calibrate::{
    Board, Calibrated, Charuco, CodedPicture, Codes, Fault, Grey, Kind, Picture, Printed, Request, Stated,
    Target, calibrate, check, circle_lens, exposed, find_circle, fit_response, fit_vignetting, flat_field,
    residual_picture, response_text, screen, target_svg, write, write_circle, write_response,
    write_vignetting,
};
use crate::recorded::{read_grey, read_lens};
use crate::source::Spec;
use clap::{Args, Subcommand, ValueEnum};
use hemilux_core::Response;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

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
    /// Compute a first lens without a board, from the image circle in pictures of a bright scene.
    Circle(CircleOptions),
    /// Compute the relative illumination of a lens from pictures of a lit screen at several angles, or of a flat field.
    Vignetting(VignettingOptions),
    /// Check that a lens file, a burst and the camera match; the exit status states the class of the fault.
    #[command(after_help = CHECK_HELP)]
    Check(CheckOptions),
    /// Compute the response from a recorded burst of a still scene.
    Response(ResponseOptions),
    /// Compute the illuminance per unit of irradiance from the reading of a luxmeter next to the probe, or on a lit patch in its view.
    Photometric(photometric::PhotometricOptions),
}

const CHECK_HELP: &str = "\
Exit status: 0 without a fault, 3 for a file that cannot be read, 4 for another image size, 5 for solid angles that do not add up,
6 for a lens that is uncertain or used beyond its calibration, 7 for exposures that are not what burst.toml says, 8 for another lens,
9 for another crop or binning, 10 for a photometric calibration older than the camera's settings.";

#[derive(Debug, Args)]
struct CheckOptions {
    /// Lens file.
    lens: PathBuf,
    /// Folder of a burst that the camera recorded.
    #[arg(long, value_name = "DIR")]
    burst: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct CircleOptions {
    /// Pictures of a bright, even scene, such as the sky or a lit wall; each part of the rim must be bright in one picture.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Field of view across the circle, degrees, from the data sheet of the lens.
    #[arg(long, value_name = "DEGREES", default_value_t = 180.0)]
    field_deg: f64,
    /// The lens file; its [response], [sensor] and vignetting are kept.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite a lens file that is better or does not state its accuracy.
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Args)]
struct VignettingOptions {
    /// Pictures with one fixed exposure of a small lit screen (phone, e-reader) in the dark, one for each angle from the axis to the rim.
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The pictures show an evenly lit surface that fills the view, such as the inside of a sphere.
    #[arg(long)]
    flat: bool,
    /// Lens file into which the vignetting is written; its [response] is used, or sRGB if it has none.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the vignetting of the lens file.
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
    /// Replace the [response] of the lens file.
    #[arg(long)]
    force: bool,
}

/// Options that describe the printed board.
#[derive(Debug, Args)]
pub(super) struct PrintedOptions {
    /// Kind of the printed pattern.
    #[arg(long, value_enum, default_value = "chessboard")]
    kind: KindOption,
    /// Number of inner corners, where four squares meet, as COLUMNSxROWS; for an AprilGrid, of tags.
    #[arg(long, value_name = "COLUMNSxROWS")]
    board: Board,
    /// ChArUco: name of the markers' dictionary in OpenCV.
    #[arg(long, value_name = "NAME", default_value = "DICT_5X5_100")]
    dictionary: String,
    /// ChArUco: side of a marker, in squares.
    #[arg(long, value_name = "SQUARES", default_value_t = 0.75)]
    marker: f64,
    /// AprilGrid: gap between tags, in tags (tagSpacing of Kalibr).
    #[arg(long, value_name = "TAGS", default_value_t = 0.3)]
    gap: f64,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum KindOption {
    /// Black and white squares.
    Chessboard,
    /// A chessboard with markers in its white squares.
    Charuco,
    /// Tags of the family 36h11, as Kalibr prints them.
    Aprilgrid,
}

impl PrintedOptions {
    fn printed(&self) -> Result<Printed, Failure> {
        match self.kind {
            KindOption::Chessboard => Ok(self.board.into()),
            KindOption::Charuco => {
                let charuco = Charuco::new(&self.dictionary, self.marker);
                let charuco = charuco.ok_or_else(|| {
                    Failure::usage(format!(
                        "--dictionary {} --marker {}: expected a dictionary of OpenCV, such as DICT_5X5_100, and 0.4 to 0.95 squares",
                        self.dictionary, self.marker
                    ))
                })?;
                Ok(Printed { corners: self.board, kind: Kind::Charuco(charuco) })
            }
            KindOption::Aprilgrid => Printed::april_grid(self.board, self.gap).ok_or_else(|| {
                Failure::usage(format!(
                    "--board {} --gap {}: expected at most 587 tags, and a gap of 0.1 to 1 tags",
                    self.board, self.gap
                ))
            }),
        }
    }
}

#[derive(Debug, Args)]
struct TargetOptions {
    #[command(flatten)]
    printed: PrintedOptions,
    /// Side of a square, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 25.0)]
    square_mm: f64,
}

#[derive(Debug, Args)]
struct LensOptions {
    /// Pictures of the board, taken in the camera's mode of the probe: 15 to 30, the board at all places up to the rim, at several angles.
    #[arg(required_unless_present = "live", conflicts_with = "live", value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Take the pictures from --source: each as soon as the board is sharp, still and at a new position; stderr names the part of the view
    /// without a board.
    #[arg(long, requires = "source")]
    live: bool,
    /// The source of --live.
    #[arg(long, requires = "live", value_parser = str::parse::<Spec>)]
    source: Option<Spec>,
    /// Largest number of pictures of --live.
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u8).range(3..=40))]
    views: u8,
    /// Longest time of --live, seconds; the lens is then computed from the pictures taken so far.
    #[arg(long, value_name = "SECONDS", default_value_t = 300)]
    seconds: u16,
    #[command(flatten)]
    printed: PrintedOptions,
    /// Accept a board whose upper left square is white.
    #[arg(long)]
    any_colours: bool,
    /// Side of a square, millimetres, written to the lens file; it has no effect on the lens.
    #[arg(long, value_name = "MM")]
    square_mm: Option<f64>,
    /// The lens file; its [response], [sensor] and vignetting are kept.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The part of the sensor that the pictures cover, sensor pixels, from `hemilux devices`; written to the lens file.
    #[arg(long, value_name = "LEFT,TOP,COLUMNS,ROWS", value_parser = numbers::<4>, requires = "binning")]
    crop: Option<[u32; 4]>,
    /// Sensor pixels per pixel of the pictures; written to the lens file.
    #[arg(long, value_name = "COLUMNS,ROWS", value_parser = numbers::<2>, requires = "crop")]
    binning: Option<[u32; 2]>,
    /// File for a drawing of the residuals over the image, SVG.
    #[arg(long, value_name = "FILE")]
    residuals: Option<PathBuf>,
    /// Overwrite a lens file that is better or does not state its accuracy.
    #[arg(long)]
    force: bool,
}

pub(super) fn run(options: &Calibrate) -> Result<(), Failure> {
    match &options.command {
        CalibrateCommand::Target(options) => {
            let target = Target { printed: options.printed.printed()?, square_mm: options.square_mm };
            say(&target_svg(&target).map_err(|e| Failure::usage(format!("--square-mm: {e}")))?)
        }
        CalibrateCommand::Lens(options) => lens(options),
        CalibrateCommand::Circle(options) => circle(options),
        CalibrateCommand::Vignetting(options) => vignetting(options),
        CalibrateCommand::Check(options) => {
            let fault = |fault: Fault| Failure { line: fault.to_string(), status: fault.status() };
            check(&options.lens, options.burst.as_deref()).map_err(fault)?;
            say("no fault found\n")
        }
        CalibrateCommand::Response(options) => response(options),
        CalibrateCommand::Photometric(options) => photometric::run(options),
    }
}

fn lens(options: &LensOptions) -> Result<(), Failure> {
    let request = Request { board: options.printed.printed()?, any_colours: options.any_colours };
    let calibrated = match options.source.as_ref().filter(|_| options.live) {
        Some(source) => {
            let time = Duration::from_secs(options.seconds.into());
            live::live(source, request, options.views.into(), time)?
        }
        None => {
            let pictures = options.images.iter().map(|path| picture(path)).collect::<Result<Vec<_>, _>>()?;
            calibrate(&pictures, &request).map_err(Failure::new)?
        }
    };
    check_mode(options, calibrated.size)?;
    let stated = Stated { square_mm: options.square_mm, crop: options.crop, binning: options.binning };
    write(&options.out, &calibrated, &stated, options.force).map_err(Failure::new)?;
    if let Some(path) = &options.residuals {
        let written = std::fs::write(path, residual_picture(&calibrated));
        written.map_err(|e| {
            Failure::new(format!("{}: found {e}, expected a file that can be written", path.display()))
        })?;
    }
    say(&report(&calibrated, &options.out))
}

/// Refuses a crop and a binning that do not match the size of the pictures.
fn check_mode(options: &LensOptions, size: [usize; 2]) -> Result<(), Failure> {
    let Some((crop, binning)) = options.crop.zip(options.binning) else { return Ok(()) };
    let fits = |axis: usize| {
        binning[axis] > 0 && ((crop[2 + axis] / binning[axis]) as usize).abs_diff(size[axis]) <= 1
    };
    if fits(0) && fits(1) {
        return Ok(());
    }
    Err(Failure::usage(format!(
        "--crop, --binning: found {} x {} sensor pixels by {} x {}, expected a crop that is the pictures' size, {} x {}, times binning",
        crop[2], crop[3], binning[0], binning[1], size[0], size[1]
    )))
}

fn circle(options: &CircleOptions) -> Result<(), Failure> {
    let pictures = options.images.iter().map(|path| grey(path)).collect::<Result<Vec<_>, _>>()?;
    let circle = find_circle(&pictures).map_err(Failure::new)?;
    let lens = circle_lens(&circle, options.field_deg, pictures[0].size())
        .map_err(|e| Failure::usage(format!("--field-deg: {e}")))?;
    write_circle(&options.out, &lens, options.force).map_err(Failure::new)?;
    let worst = lens.spread.iter().map(|[_, uncertainty]| *uncertainty).fold(0.0, f64::max);
    say(&format!(
        "circle of {:.1} pixels around ({:.1}, {:.1}), its rim within {:.2} pixels; an equidistant lens of {} degrees, whose directions are uncertain by up to \
         {worst:.1} degrees: a first calibration, to be replaced by one with a board\nwrote {}\n",
        circle.radius,
        circle.centre.x,
        circle.centre.y,
        circle.deviation_px,
        options.field_deg,
        options.out.display()
    ))
}

/// Parses `text` as `N` whole numbers that commas separate.
fn numbers<const N: usize>(text: &str) -> Result<[u32; N], String> {
    let all: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let all = all.and_then(|all| all.try_into().ok());
    all.ok_or_else(|| format!("expected {N} whole numbers joined by commas"))
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
        let shown = CodedPicture { grey: &grey, response: &response };
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
    let Codes { frames, step } = exposed(&options.burst).map_err(Failure::new)?.codes;
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
        let halves = spread.halves_deg.map_or("unknown".into(), |v| format!("{v:.3} degrees"));
        let _ = writeln!(
            text,
            "{:5.1} degrees from the axis: uncertainty {:.3} degrees, difference of the two halves {halves}",
            spread.angle_deg, spread.uncertainty_deg
        );
    }
    if !calibrated.board.tells_mirror() {
        let _ = writeln!(
            text,
            "a board of {} looks the same in a mirror: mirrored pictures cannot be detected (boards of odd counts, such as 9x7, ChArUco \
             and AprilGrid tell)",
            calibrated.board
        );
    }
    let _ = writeln!(text, "wrote {}", out.display());
    text
}
