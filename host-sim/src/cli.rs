//! The command line.

use crate::error::SimError;
use crate::output::Files;
use crate::{burst, decompose, replay, score};
use clap::{Args, Parser, Subcommand};
use hemilux::pipeline::Settings;
use hemilux::samplers;
use hemilux_core::fill::Extrapolation;
use hemilux_core::healpix::Domain;
use hemilux_core::polar::Grid;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  hemilux-sim decompose --env room.exr --lights 64 --picture room.png
  hemilux-sim burst --env room.exr --lens fixtures/lens-160x140.toml --out burst
  hemilux-sim replay --burst burst --sampler q2tree --lights 64 --picture burst.png";

/// Simulates and judges a light probe: environment maps and recorded bursts in, directional lights out.
#[derive(Parser, Debug)]
#[command(version, after_help = EXAMPLES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Decomposes latitude-longitude HDR maps: one JSON light set per map on standard output.
    Decompose(DecomposeArgs),
    /// Runs recorded bursts through the probe's pipeline: one JSON light set per burst on standard output.
    Replay(ReplayArgs),
    /// Scores a light set against the map it stands for: open, shadowed and energy error as ratios.
    Score(ScoreArgs),
    /// Makes the burst that a camera under an HDR map would have recorded.
    Burst(BurstArgs),
}

#[derive(Args, Debug)]
struct SamplerArgs {
    /// How lights are found.
    #[arg(long, default_value = "q2tree", value_parser = clap::builder::PossibleValuesParser::new(samplers::NAMES))]
    sampler: String,
    /// Most lights.
    #[arg(long, default_value_t = 64)]
    lights: usize,
}

#[derive(Args, Debug)]
struct FileArgs {
    /// Writes the tone-mapped map with the lights drawn on it; of a sequence, one numbered file per frame.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Writes the map as OpenEXR; of a sequence, one numbered file per frame.
    #[arg(long, value_name = "FILE.exr")]
    map: Option<PathBuf>,
}

impl From<FileArgs> for Files {
    fn from(args: FileArgs) -> Self {
        Self { picture: args.picture, map: args.map }
    }
}

#[derive(Args, Debug)]
struct DecomposeArgs {
    /// A latitude-longitude OpenEXR or Radiance HDR map, a folder of them (one sequence in name order), or scene:NAME.
    #[arg(long, value_name = "FILE|FOLDER")]
    env: PathBuf,
    #[command(flatten)]
    sampler: SamplerArgs,
    /// Uses the upper half alone, as a probe that looks up sees it.
    #[arg(long)]
    hemisphere: bool,
    /// Maps a second of a sequence.
    #[arg(long, default_value_t = 10.0)]
    fps: f64,
    #[command(flatten)]
    files: FileArgs,
}

#[derive(Args, Debug)]
struct ReplayArgs {
    /// A folder with a burst.toml, or a folder of such folders.
    #[arg(long, value_name = "DIR")]
    burst: PathBuf,
    #[command(flatten)]
    sampler: SamplerArgs,
    /// What stands for the part of the hemisphere that the lens does not see.
    #[arg(long, value_enum, default_value = "none")]
    extrapolation: ExtrapolationArg,
    #[command(flatten)]
    files: FileArgs,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum ExtrapolationArg {
    /// Darkness.
    None,
    /// The average radiance of what is seen.
    Average,
}

#[derive(Args, Debug)]
struct ScoreArgs {
    /// The map, or scene:NAME.
    #[arg(long, value_name = "FILE")]
    env: PathBuf,
    /// The light set, JSON.
    #[arg(long, value_name = "LIGHTS.json")]
    set: PathBuf,
    /// Scores against the upper half of the map alone.
    #[arg(long)]
    hemisphere: bool,
}

#[derive(Args, Debug)]
struct BurstArgs {
    /// A latitude-longitude OpenEXR or Radiance HDR map, or scene:NAME.
    #[arg(long, value_name = "FILE")]
    env: PathBuf,
    /// A file with a [lens] table (with its size) and optionally [response] and [sensor], as in a burst.toml.
    #[arg(long, value_name = "FILE.toml")]
    lens: PathBuf,
    /// Exposure times, seconds.
    #[arg(long, value_delimiter = ',', default_value = "0.000926,0.005555,0.033333")]
    exposures: Vec<f64>,
    /// Radiance of full scale at one second; chosen so that the brightest texel just fits where left out.
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
    /// Folder to write.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// [`SimError`].
pub fn run(cli: Cli) -> Result<(), SimError> {
    match cli.command {
        Command::Decompose(args) => {
            if !(args.fps > 0.0 && args.fps.is_finite()) {
                return Err(SimError::Usage(format!(
                    "--fps: found {}, expected a positive number",
                    args.fps
                )));
            }
            let domain = if args.hemisphere { Domain::Hemisphere } else { Domain::Sphere };
            let SamplerArgs { sampler, lights } = args.sampler;
            let files = args.files.into();
            decompose::run(&decompose::Job { env: args.env, sampler, lights, domain, fps: args.fps, files })
        }
        Command::Replay(args) => {
            let extrapolation = match args.extrapolation {
                ExtrapolationArg::None => Extrapolation::None,
                ExtrapolationArg::Average => Extrapolation::Average,
            };
            let SamplerArgs { sampler, lights } = args.sampler;
            let settings = Settings { sampler, lights, extrapolation, grid: Grid::POLAR };
            replay::run(&replay::Job { burst: args.burst, settings, files: args.files.into() })
        }
        Command::Score(a) => {
            let line = score::score_command(&decompose::read(&a.env)?, &a.set, a.hemisphere)?;
            println!("{line}");
            Ok(())
        }
        Command::Burst(a) => {
            let sensor = burst::Sensor { bits: a.bits, full_well: a.full_well, read_noise: a.read_noise };
            burst::run(&burst::Job {
                env: a.env,
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
