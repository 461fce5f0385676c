//! Command line of `hemilux-sim`: subcommands, options, help texts.

mod export;
mod maps;
mod program;
mod reports;
mod values;

use crate::error::SimError;
use crate::export::Export;
use crate::output::{self, Files};
use crate::{burst, chart, decompose, import, render, replay, score};
use clap::builder::PossibleValuesParser;
use clap::{Args, Parser, Subcommand};
use export::ExportArgs;
use hemilux::pipeline::{Settings, WINDOWS, WindowMode};
use hemilux::recorded::ReadLimits;
use hemilux::usage::{self, Explained};
use hemilux_core::Extrapolation;
use hemilux_core::SamplerKind;
use hemilux_core::mains::Lamps;
use hemilux_core::sampler::Request;
use maps::MapArgs;
use std::ffi::OsString;
use std::path::PathBuf;
use values::{ExposuresArg, ExtrapolationArg, sampler_parser};

const EXAMPLES: &str = "Examples:
  hemilux-sim decompose --env room.exr --lights 64 --picture room.png
  hemilux-sim decompose --env room.exr --ambient --tolerance 0.03
  hemilux-sim burst --env room.exr --lens fixtures/lens-160x140.toml --out burst
  hemilux-sim replay --burst burst --sampler q2tree --lights 64 --picture burst.png
  hemilux-sim decompose --env room.exr --lights 64 > lights.json
  hemilux-sim render --env room.exr --set lights.json --out render.png
  hemilux-sim decompose --env room.exr --lights 64 --format usda > lights.usda
  hemilux-sim chart --env maps --out charts
  hemilux-sim stress --out stress --quick";

/// Simulates a light probe: computes directional lights from environment maps and recorded bursts, and scores them.
#[derive(Parser, Debug)]
#[command(name = "hemilux-sim", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Decomposes latitude-longitude HDR maps to directional lights: one JSON light set per map on standard output.
    Decompose(DecomposeArgs),
    /// Converts bracketed photographs with EXIF data to a burst.
    Import(ImportArgs),
    /// Runs recorded bursts through the probe's pipeline: one JSON light set per burst on standard output.
    Replay(ReplayArgs),
    /// Scores a light set against its environment map: open, shadowed and energy error as ratios.
    Score(ScoreArgs),
    /// Runs every method over every scenario: error, flicker, leaks, step response, tracking, lag; writes SVG, JSON and a table.
    Stress(reports::StressArgs),
    /// Charts the error of every method against its time and against its number of lights, over the maps of a folder; writes SVG, JSON and a
    /// table.
    Chart(reports::ChartArgs),
    /// Compares lights with disc shape with point lights and with fitted mixtures of spherical Gaussians over the maps of a folder: errors,
    /// times, least numbers of lights.
    Discs(reports::DiscsArgs),
    /// Renders a small scene under the map and under a light set, side by side with the difference; with --over, inserts it into a photograph.
    Render(RenderArgs),
    /// Measures the time of every stage on one thread, and of a copy of the burst's bytes for comparison.
    Bench(reports::BenchArgs),
    /// Compares the merge of the needed exposures with the merge of all exposures: exposures read, open error, instructions.
    Reads(reports::ReadsArgs),
    /// Runs a sampler over maps of a built-in room without any output, for instruction counters.
    #[command(hide = true)]
    SampleFrames(SampleFramesArgs),
    /// Runs days of simulated time through the probe's pipeline, server and sockets, with clients of every kind and faults of the source, and
    /// prints a report; the exit status is 1 if a requirement is violated.
    Soak(reports::SoakArgs),
    /// Prints a table of durations, degradation steps and error of the probe if its stages are slower by a factor and its budget is fixed.
    Slowdown(reports::SlowdownArgs),
    /// Writes the burst that a camera would record under an HDR map.
    Burst(BurstArgs),
    /// Writes completions for a shell to standard output.
    Completions(program::CompletionsArgs),
    /// Writes the man pages of all commands.
    Man(program::ManArgs),
}

#[derive(Args, Debug)]
struct SamplerArgs {
    /// Sampler that decomposes the map.
    #[arg(long, default_value_t, value_parser = sampler_parser())]
    sampler: SamplerKind,
    /// Largest number of lights; with --ambient and 0 the set contains spherical harmonics alone.
    #[arg(long, default_value_t = 64)]
    lights: usize,
}

#[derive(Args, Debug)]
struct ModelArgs {
    /// Uses the least number of lights whose estimated shadowed error is at most this ratio: 0.03 is 3 per cent.
    #[arg(long, value_name = "E")]
    tolerance: Option<f32>,
    /// Separates ambient light as nine spherical-harmonic coefficients per channel.
    #[arg(long)]
    ambient: bool,
    /// Fits the lights as uniform discs, for renderers whose directional lights have an angular radius.
    #[arg(long)]
    soft: bool,
}

impl ModelArgs {
    fn request(&self, lights: usize) -> Request {
        Request { lights, tolerance: self.tolerance, ambient: self.ambient, soft: self.soft }
    }
}

#[derive(Args, Debug)]
struct FileArgs {
    /// PNG or JPEG file for the tone-mapped map with the lights drawn on it; a sequence has one numbered file per frame.
    #[arg(long, value_name = "FILE.png", value_parser = output::picture_path)]
    picture: Option<PathBuf>,
    /// OpenEXR file for the map's radiance; a sequence has one numbered file per frame.
    #[arg(long, value_name = "FILE.exr", value_parser = output::map_path)]
    map: Option<PathBuf>,
}

impl FileArgs {
    fn files(self, export: &Export) -> Files {
        Files { picture: self.picture, map: self.map, whole_maps: export.needs_whole_maps() }
    }
}

#[derive(Args, Debug)]
struct DecomposeArgs {
    /// A latitude-longitude OpenEXR or Radiance HDR map, a folder of such maps (one sequence in name order), or scene:NAME.
    #[arg(long, value_name = "FILE|FOLDER")]
    env: PathBuf,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Rate of a sequence, maps per second.
    #[arg(long, default_value_t = 10.0)]
    fps: f64,
    #[command(flatten)]
    files: FileArgs,
    #[command(flatten)]
    export: ExportArgs,
}

#[derive(Args, Debug)]
struct ReplayArgs {
    /// A folder with a burst.toml, a folder of folders with a burst.toml, or (with --lens) a folder of photographs.
    #[arg(long, value_name = "DIR")]
    burst: PathBuf,
    /// Lens file for a folder of photographs without a burst.toml.
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,
    /// Source of the exposure times.
    #[arg(long, value_enum, default_value = "stated")]
    exposures: ExposuresArg,
    /// Largest number of pixels of an image; by default 134217728, and less for short files.
    #[arg(long, value_name = "N")]
    max_pixels: Option<u64>,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    model: ModelArgs,
    /// Mains frequency, hertz, whose lamp flicker is removed; auto measures the frequency, off removes no flicker.
    #[arg(long, default_value = "auto", value_parser = PossibleValuesParser::new(Lamps::NAMES))]
    mains: String,
    /// Frames of a set: those of a burst, or the newest of each exposure, a set for every frame (needs --mains off).
    #[arg(long, default_value = "burst", value_parser = PossibleValuesParser::new(WINDOWS.map(|(name, _)| name)))]
    window: String,
    /// Bursts per second of a recording whose burst.toml files have no timestamp_ns.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Radiance of the part of the hemisphere outside the field of view.
    #[arg(long, value_enum, default_value = "none")]
    extrapolation: ExtrapolationArg,
    #[command(flatten)]
    files: FileArgs,
    #[command(flatten)]
    export: ExportArgs,
}

#[derive(Args, Debug)]
struct ImportArgs {
    /// Photographs, JPEG or PNG with EXIF data.
    #[arg(required = true, value_name = "PHOTO")]
    photos: Vec<PathBuf>,
    /// Lens file of the camera.
    #[arg(long, value_name = "FILE")]
    lens: PathBuf,
    /// Folder for the burst; it is created if it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Ignores the stated colour space (ICC profile, cICP, cHRM, Adobe RGB) of the photographs and reads them as Rec. 709 with the format's
    /// usual transfer function.
    #[arg(long)]
    ignore_profile: bool,
}

#[derive(Args, Debug)]
struct ScoreArgs {
    /// Environment map, or scene:NAME.
    #[arg(long, value_name = "FILE")]
    env: PathBuf,
    /// Light set, a JSON file as `decompose` writes it.
    #[arg(long, value_name = "LIGHTS.json")]
    set: PathBuf,
    #[command(flatten)]
    map: MapArgs,
}

#[derive(Args, Debug)]
struct BurstArgs {
    /// A latitude-longitude OpenEXR or Radiance HDR map, or scene:NAME.
    #[arg(long, value_name = "FILE")]
    env: PathBuf,
    #[command(flatten)]
    map: MapArgs,
    /// A file with a [lens] table (with its size) and optionally [response] and [sensor], as in a burst.toml.
    #[arg(long, value_name = "FILE.toml")]
    lens: PathBuf,
    /// Exposure times, seconds.
    #[arg(long, value_delimiter = ',', default_value = "0.000926,0.005555,0.033333")]
    exposures: Vec<f64>,
    /// Radiance that reaches the largest code in one second [default: the brightest texel nearly reaches it in the
    /// shortest exposure].
    #[arg(long)]
    scale: Option<f64>,
    /// Bits of a sensor code.
    #[arg(long, default_value_t = 12)]
    bits: u32,
    /// Electrons at full scale; 0 for a sensor without noise.
    #[arg(long, default_value_t = 10_000.0)]
    full_well: f64,
    /// Read noise, electrons.
    #[arg(long, default_value_t = 3.0)]
    read_noise: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the burst; it is created if it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Args, Debug)]
struct RenderArgs {
    /// Environment map for the reference and the background.
    #[arg(long, value_name = "FILE")]
    env: PathBuf,
    #[command(flatten)]
    map: MapArgs,
    /// Light set, a JSON file as `decompose` writes it.
    #[arg(long, value_name = "LIGHTS.json")]
    set: PathBuf,
    /// Picture to write, PNG or JPEG.
    #[arg(long, value_name = "FILE.png", value_parser = output::picture_path)]
    out: PathBuf,
    /// Photograph into which the objects are inserted by differential rendering, in place of the comparison.
    #[arg(long, value_name = "PHOTO.png")]
    over: Option<PathBuf>,
}

#[derive(Args, Debug)]
struct SampleFramesArgs {
    #[command(flatten)]
    sampler: SamplerArgs,
    /// Number of frames.
    #[arg(long, default_value_t = 1)]
    frames: usize,
}

/// Parses and runs the command line `arguments`, whose first element is the program's name.
///
/// # Errors
/// [`SimError::Usage`] for a wrong command line, [`SimError::Failed`] if the command fails.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> Result<(), SimError> {
    match Cli::try_parse_from(arguments) {
        Ok(cli) => run_command(cli.command),
        Err(error) => match usage::explain::<Cli>(&error) {
            Explained::Help(text) => output::say(text.as_bytes()),
            Explained::Refused(line) => Err(SimError::Usage(line)),
        },
    }
}

fn run_command(command: Command) -> Result<(), SimError> {
    match command {
        Command::Completions(args) => program::completions(&args),
        Command::Man(args) => program::man(&args),
        Command::Decompose(args) => run_decompose(args),
        Command::Replay(args) => run_replay(args),
        Command::Import(a) => import::run(&import::ImportJob {
            lens: a.lens,
            photos: a.photos,
            out: a.out,
            ignores_profile: a.ignore_profile,
        }),
        Command::Score(a) => {
            let options = a.map.into();
            let map = decompose::read(&a.env, &options)?;
            let line = score::score_command(&map, &a.set, decompose::domain(&map, &options))?;
            println!("{line}");
            Ok(())
        }
        Command::Stress(args) => reports::stress(args),
        Command::Chart(args) => reports::chart(args),
        Command::Discs(args) => reports::discs(args),
        Command::Render(a) => render::run(&render::RenderJob {
            env: a.env,
            options: a.map.into(),
            set: a.set,
            out: a.out,
            over: a.over,
        }),
        Command::Bench(args) => reports::bench(args),
        Command::Reads(args) => reports::reads(&args),
        Command::Soak(args) => reports::soak(&args),
        Command::Slowdown(args) => reports::slowdown(&args),
        Command::SampleFrames(a) => {
            chart::counted::sample_frames(a.sampler.sampler, a.sampler.lights, a.frames)
        }
        Command::Burst(a) => {
            let sensor = burst::Sensor { bits: a.bits, full_well: a.full_well, read_noise: a.read_noise };
            burst::run(&burst::BurstJob {
                env: a.env,
                options: a.map.into(),
                lens: a.lens,
                exposures: a.exposures,
                scale: a.scale,
                sensor,
                seed: a.seed,
                out: a.out,
            })
        }
    }
}

fn run_decompose(args: DecomposeArgs) -> Result<(), SimError> {
    if !(args.fps > 0.0 && args.fps.is_finite()) {
        return Err(SimError::Usage(format!(
            "--fps: found {}, expected a positive number of maps per second",
            args.fps
        )));
    }
    let SamplerArgs { sampler, lights } = args.sampler;
    let export = args.export.export()?;
    decompose::run(&decompose::DecomposeJob {
        env: args.env,
        sampler,
        request: args.model.request(lights),
        options: args.map.into(),
        fps: args.fps,
        files: args.files.files(&export),
        export,
    })
}

fn run_replay(args: ReplayArgs) -> Result<(), SimError> {
    let extrapolation = match args.extrapolation {
        ExtrapolationArg::None => Extrapolation::None,
        ExtrapolationArg::Average => Extrapolation::Average,
    };
    if let Some(rate) = args.rate.filter(|rate| !(*rate > 0.0 && rate.is_finite())) {
        return Err(SimError::Usage(format!(
            "--rate: found {rate}, expected a positive number of bursts per second"
        )));
    }
    let SamplerArgs { sampler, lights } = args.sampler;
    let ModelArgs { tolerance, ambient, soft } = args.model;
    let settings = Settings {
        sampler,
        lights,
        tolerance,
        ambient,
        soft,
        extrapolation,
        lamps: Lamps::named(&args.mains).unwrap_or_default(),
        window: WindowMode::named(&args.window).unwrap_or_default(),
        ..Settings::default()
    };
    let export = args.export.export()?;
    let files = args.files.files(&export);
    replay::run(&replay::ReplayJob {
        burst: args.burst,
        lens: args.lens,
        limits: ReadLimits { max_pixels: args.max_pixels, ..ReadLimits::default() },
        exposures: args.exposures.into(),
        rate_hz: args.rate,
        settings,
        files,
        export,
    })
}
