//! Commands that compare methods or measure the probe: `stress`, `chart`, `discs`, `bench`, `reads`, `soak`, `slowdown`.

use crate::error::SimError;
use crate::{bench, chart, discs, output, reads, slowdown, soak, stress};
use clap::Args;
use hemilux::timing::Budgets;
use hemilux_core::wire::STAGES;
use std::path::PathBuf;

/// Description of the scenarios of camera frames in the help of `stress`.
const CAMERA_FRAMES: &str = "In the scenarios bursts-swinging, bursts-walker and bursts-clouds, and those with sliding- in place of bursts-, each frame of a simulated \
    camera has a score: that of the newest set (of the last whole burst, or of --window sliding) against the scene at the end of the frame's \
    exposure. The column lag is the number of camera frames by which the sets are late. host-sim/METRICS.md defines all figures.";

#[derive(Args, Debug)]
#[command(after_help = CAMERA_FRAMES)]
pub(super) struct StressArgs {
    /// Folder for stress.svg, stress.json and stress.txt.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Runs smaller maps and shorter sequences, in less than a minute.
    #[arg(long)]
    quick: bool,
    /// Runs the probe's samplers alone, without the methods for comparison, as in fixtures/stress-quick.txt.
    #[arg(long)]
    core: bool,
    /// Replaces the procedural interior and sky by the maps of this folder, in rotation; without DIR by the maps in $HEMILUX_HDRI.
    #[arg(long, value_name = "DIR", num_args = 0..=1)]
    backgrounds: Option<Option<PathBuf>>,
}

#[derive(Args, Debug)]
pub(super) struct ChartArgs {
    /// Folder of latitude-longitude maps, which are resampled to 512 columns; by default three procedural maps.
    #[arg(long, value_name = "DIR")]
    env: Option<PathBuf>,
    /// Folder for chart-time.svg, chart-lights.svg, chart.json and chart.txt.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Runs three maps of 128 columns with every other power of two as number of lights, in less than a minute.
    #[arg(long)]
    quick: bool,
}

#[derive(Args, Debug)]
pub(super) struct DiscsArgs {
    /// Folder of latitude-longitude maps, which are resampled to 512 columns.
    #[arg(long, value_name = "DIR")]
    env: PathBuf,
    /// Computes the least numbers of lights alone, without the mixtures, which take minutes.
    #[arg(long)]
    fewest: bool,
}

#[derive(Args, Debug)]
pub(super) struct BenchArgs {
    /// Prints JSON in place of a table.
    #[arg(long)]
    json: bool,
    /// Runs this case alone: FORMAT:WIDTHxHEIGHT:SAMPLER:LIGHTS, such as rgb24:640x480:q2tree:64.
    #[arg(long, value_name = "CASE")]
    case: Option<bench::Case>,
    /// Processes this number of frames without time measurement, for instruction counters.
    #[arg(long, value_name = "T", requires = "case")]
    frames: Option<usize>,
    /// Largest allowed median times in milliseconds, such as front=30,total=60; the last column lists the stages that exceed them [default: the
    /// budgets of the probe].
    #[arg(long, value_name = "STAGE=MS,...", value_parser = hemilux::timing::read_budgets)]
    budget: Option<[Option<f32>; STAGES]>,
}

#[derive(Args, Debug)]
pub(super) struct SoakArgs {
    /// Hours of simulated time, with ten bursts per second.
    #[arg(long, value_name = "H", default_value_t = 24.0, conflicts_with = "frames")]
    hours: f64,
    /// Number of bursts, in place of a number of hours.
    #[arg(long, value_name = "T")]
    frames: Option<u64>,
    /// Least number of replies; further bursts are processed until the clients have received as many.
    #[arg(long, value_name = "N", default_value_t = 0)]
    replies: u64,
    /// Faults of the source, in the syntax of `hemilux --faults`.
    #[arg(
        long,
        value_name = "KIND=SHARE,...",
        default_value = "all=0.01,sound=8,late_s=0.002,gone_s=0.01,hang_s=0.02"
    )]
    faults: hemilux::source::FaultSpec,
}

#[derive(Args, Debug)]
pub(super) struct SlowdownArgs {
    /// Factors by which the time of a frame is multiplied, 1 to 64.
    #[arg(long, value_delimiter = ',', default_value = "1,2,4,8,16")]
    factors: Vec<f32>,
    /// Budget of a frame's total time, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 60.0)]
    budget: f32,
    /// Time of a frame at full quality and factor 1, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 40.0)]
    frame: f32,
    /// Simulated time with each factor, minutes, 1 to 1440.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=1440))]
    minutes: u32,
    /// Writes a chart of the errors against slowdowns from 1 to 16 to this SVG file.
    #[arg(long, value_name = "FILE")]
    chart: Option<PathBuf>,
}

pub(super) fn soak(args: &SoakArgs) -> Result<(), SimError> {
    if !(args.hours > 0.0 && args.hours <= 24.0 * 366.0) {
        let expected = "expected a number of hours above 0 and at most 8784";
        return Err(SimError::Usage(format!("--hours: found {}, {expected}", args.hours)));
    }
    if let Err(error) = hemilux::allocator::restart_without_thread_caches() {
        eprintln!(
            "soak: found {error} at a restart without the allocator's caches of threads: the memory includes them"
        );
    }
    let hours = (args.hours * 3600.0) as u64 * soak::FRAMES_A_SECOND;
    let frames = args.frames.unwrap_or(hours).max(1);
    let report = soak::run(&soak::SoakJob { frames, faults: args.faults.clone(), replies: args.replies })?;
    output::say(report.to_string().as_bytes())?;
    let failures = report.failures();
    if failures.is_empty() {
        Ok(())
    } else {
        Err(SimError::Failed(format!("soak: found {}", failures.join("; "))))
    }
}

pub(super) fn slowdown(args: &SlowdownArgs) -> Result<(), SimError> {
    if !args.factors.iter().all(|factor| (1.0..=64.0).contains(factor)) {
        let found = &args.factors;
        return Err(SimError::Usage(format!("--factors: found {found:?}, expected numbers from 1 to 64")));
    }
    for (option, ms) in [("--budget", args.budget), ("--frame", args.frame)] {
        if !hemilux::timing::BUDGETS_MS.contains(&ms) {
            return Err(SimError::Usage(format!(
                "{option}: found {ms}, expected 0.01 to 60000 milliseconds"
            )));
        }
    }
    let (factors, budget_ms, frame_ms) = (args.factors.clone(), args.budget, args.frame);
    let job = slowdown::SlowdownJob { factors, budget_ms, frame_ms, minutes: args.minutes };
    output::say(slowdown::table(&job)?.as_bytes())?;
    match &args.chart {
        Some(file) => output::save(file, slowdown::chart(&job)?.as_bytes()),
        None => Ok(()),
    }
}

/// Returns the folder that the option `--backgrounds` or else the environment variable `HEMILUX_HDRI` contains.
fn hdri(named: Option<PathBuf>) -> Result<PathBuf, SimError> {
    let from_environment = || std::env::var_os("HEMILUX_HDRI").map(PathBuf::from);
    let expected =
        "--backgrounds: found no folder, expected --backgrounds DIR or the environment variable HEMILUX_HDRI";
    named.or_else(from_environment).ok_or_else(|| SimError::Usage(expected.into()))
}

pub(super) fn stress(args: StressArgs) -> Result<(), SimError> {
    let backgrounds = args.backgrounds.map(hdri).transpose()?;
    stress::run(&stress::StressJob { out: args.out, quick: args.quick, core: args.core, backgrounds })
}

pub(super) fn chart(args: ChartArgs) -> Result<(), SimError> {
    chart::run(&chart::ChartJob { env: args.env, out: args.out, quick: args.quick })
}

pub(super) fn discs(args: DiscsArgs) -> Result<(), SimError> {
    discs::run(&discs::DiscsJob { env: args.env, fewest_alone: args.fewest })
}

pub(super) fn bench(args: BenchArgs) -> Result<(), SimError> {
    let mut budgets = Budgets::default();
    for (i, ms) in args.budget.unwrap_or_default().into_iter().enumerate() {
        budgets.set_ms(i, ms.unwrap_or(budgets.ms(i)));
    }
    bench::run(&bench::BenchJob { json: args.json, case: args.case, frames: args.frames, budgets })
}

#[derive(Args, Debug)]
pub(super) struct ReadsArgs {
    /// Adds instructions per frame, counted by callgrind where valgrind is installed; the counts take minutes.
    #[arg(long)]
    count: bool,
}

pub(super) fn reads(args: &ReadsArgs) -> Result<(), SimError> {
    reads::run(args.count)
}
