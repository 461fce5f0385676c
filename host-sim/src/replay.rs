//! `hemilux-sim replay`: processes recorded bursts with the probe's pipeline.

mod rolling;

use crate::error::SimError;
use crate::export::Export;
use crate::import;
use crate::output::Files;
use crate::ratios;
use hemilux::calibration::Burst;
use hemilux::consistency::{self, LeftOut};
use hemilux::pipeline::{Pipeline, PipelineError, Settings, WindowMode};
use hemilux::recorded::{self, BurstFolder, ReadLimits, RecordedBurst};
use hemilux_core::wire::{FramesLeftOut, LightSet};
use rolling::RollingBurst;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `replay`.
#[derive(Clone, Debug)]
pub struct ReplayJob {
    /// Path of the folder of a burst, or of a folder of such folders, which are one sequence.
    pub burst: PathBuf,
    /// Path of a lens file, for a folder of photographs without a `burst.toml`.
    pub lens: Option<PathBuf>,
    /// Limits on the size of the recorded images.
    pub limits: ReadLimits,
    /// Source of the exposure times of the bursts.
    pub exposures: Exposures,
    /// Bursts per second of a recording without time stamps.
    pub rate_hz: Option<f64>,
    /// Sampler, number of lights, extrapolation and lamps.
    pub settings: Settings,
    /// Paths of pictures and maps to write.
    pub files: Files,
    /// File format and axes of the light sets.
    pub export: Export,
}

/// Source of the exposure times of a burst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposures {
    /// The manifest states the exposure time of each frame.
    #[default]
    Stated,
    /// The manifest states the exposure time of the brightest frame; the times of the other frames follow from ratios measured in the pixels.
    Measured,
}

/// Processes the bursts; writes one light set per burst, or per frame with a sliding window, to standard output, and a summary of each set to
/// standard error.
///
/// # Errors
/// [`SimError`] if a burst cannot be read or processed, or an output cannot be written.
pub fn run(job: &ReplayJob) -> Result<(), SimError> {
    let bursts = list(job)?;
    job.export.check_count(bursts.len())?;
    let many = bursts.len() > 1;
    let mut pipeline: Option<Pipeline> = None;
    let mut rolling = RollingBurst::default();
    for (index, folder) in bursts.iter().enumerate() {
        let mut read = read(job, &folder.folder)?;
        read.burst.timestamp_ns = read.burst.timestamp_ns.max(folder.timestamp_ns);
        if let (Some(rate), None) = (job.rate_hz, read.burst.phase_s()) {
            let frames = index * read.burst.frames.len();
            read.burst.phase_ns = 1 + (1e9 * frames as f64 / rate) as u64;
        }
        let is_first = pipeline.is_none();
        if job.exposures == Exposures::Measured {
            ratios::measure(&mut read, is_first);
        }
        let exposures: Vec<_> = read.burst.frames.iter().map(|f| f.exposure).collect();
        let same = pipeline.take().filter(|p| *p.calibration() == read.calibration);
        let running = match same {
            Some(p) => p,
            None => {
                let made = Pipeline::try_new(read.calibration, &exposures, job.settings.clone());
                made.map_err(|e| at(&folder.folder, e))?
            }
        };
        let pipeline = pipeline.insert(running);
        if job.settings.window == WindowMode::Sliding {
            rolling.process(
                job,
                pipeline,
                &mut read,
                SequencePosition { index, many, folder: &folder.folder },
            )?;
            continue;
        }
        let found = pipeline.inspect(&read.burst);
        let left_out = consistency::remove(&mut read, &found);
        report(&folder.folder, &left_out);
        if is_first && job.exposures == Exposures::Stated {
            ratios::print(&ratios::of(&read.calibration, &read.burst));
        }
        let place = SequencePosition { index, many, folder: &folder.folder };
        process(job, pipeline, &read.burst, FramesLeftOut::NONE, place, &left_out)?;
    }
    Ok(())
}

/// Returns the folders of the recording's bursts; a folder of photographs is one burst.
fn list(job: &ReplayJob) -> Result<Vec<BurstFolder>, SimError> {
    let is_photographs = !job.burst.join("burst.toml").is_file() && !import::list(&job.burst)?.is_empty();
    if !is_photographs {
        return Ok(recorded::read_sequence(&job.burst)?);
    }
    if job.lens.is_some() {
        return Ok(vec![BurstFolder { folder: job.burst.clone(), timestamp_ns: 0 }]);
    }
    let expected = "a burst.toml (hemilux-sim import --lens LENS PHOTO... --out DIR writes it), or the option --lens LENS";
    Err(SimError::at(&job.burst, "photographs without a burst.toml", expected))
}

fn read(job: &ReplayJob, folder: &Path) -> Result<RecordedBurst, SimError> {
    match &job.lens {
        Some(lens) if !folder.join("burst.toml").is_file() => {
            let text = import::describe(lens, &import::list(folder)?, false)?;
            Ok(recorded::read_described(folder, &text, &job.limits)?)
        }
        _ => Ok(recorded::read_recorded(folder, &job.limits)?),
    }
}

/// Reports the frames that were left out.
fn report(folder: &Path, left_out: &[LeftOut]) {
    for frame in left_out {
        eprintln!("hemilux-sim: {}/{frame}", folder.display());
    }
}

/// Position of a burst in its sequence.
#[derive(Clone, Copy)]
struct SequencePosition<'a> {
    index: usize,
    /// Whether the sequence has several bursts, whose output files are numbered.
    many: bool,
    folder: &'a Path,
}

fn process(
    job: &ReplayJob,
    pipeline: &mut Pipeline,
    burst: &Burst,
    found: FramesLeftOut,
    place: SequencePosition<'_>,
    left_out: &[LeftOut],
) -> Result<(), SimError> {
    let processed = pipeline.process_kept(burst, found, Instant::now()).map_err(|e| at(place.folder, e))?;
    let seen = processed.seen;
    eprintln!(
        "hemilux-sim: {}: shares of the hemisphere: clipped {:.4}, unseen {:.4}; light from below {:.4} of the light from above",
        place.folder.display(),
        seen.clipped,
        seen.unseen,
        seen.below
    );
    let set = LightSet {
        run: "sim",
        frame: place.index as u64,
        timestamp_ns: burst.timestamp_ns,
        valid: true,
        sampler: job.settings.sampler.name(),
        requested: job.settings.lights as u32,
        ..processed.light_set()
    };
    job.export.print_with(&set, job.files.map_name().as_deref(), left_out)?;
    let lights = set.lights.to_vec();
    job.files.write(place.many.then_some(place.index), &pipeline.map().polar, None, &lights)
}

/// Converts an error of the pipeline to one with the path of the burst; a wrong sampler or number of lights is a usage error.
fn at(folder: &Path, e: PipelineError) -> SimError {
    match e {
        PipelineError::Sampler(e) => e.into(),
        e @ PipelineError::Window(_) => SimError::Usage(e.to_string()),
        e => SimError::Failed(format!("{}: {e}", folder.join("burst.toml").display())),
    }
}
