//! `hemilux-sim replay`: processes recorded bursts with the probe's own pipeline.

use crate::error::SimError;
use crate::export::Export;
use crate::import;
use crate::output::Files;
use hemilux::calibration::{Burst, Calibration, Frame};
use hemilux::consistency::{self, LeftOut};
use hemilux::pipeline::{Pipeline, PipelineError, Settings};
use hemilux::recorded::{self, BurstFolder, ReadLimits, RecordedBurst};
use hemilux_core::format::Format;
use hemilux_core::response::{Curve, curve_len};
use hemilux_core::wire::{FramesLeftOut, LightSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `replay`.
#[derive(Clone, Debug)]
pub struct Job {
    /// Path of a burst, or of a folder of bursts that are one sequence.
    pub burst: PathBuf,
    /// Path of a lens file, for a folder of photographs without a `burst.toml`.
    pub lens: Option<PathBuf>,
    /// Limits on the size of the images.
    pub limits: ReadLimits,
    /// Origin of the exposure times.
    pub exposures: Exposures,
    /// Frames a second, for a recording without times.
    pub rate_hz: Option<f64>,
    /// Sampler, number of lights, extrapolation and lamps.
    pub settings: Settings,
    /// Paths of pictures and maps to write.
    pub files: Files,
    /// Form and axes of the light sets.
    pub export: Export,
}

/// Origin of the exposure times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposures {
    /// Exposure times are those of the manifest.
    #[default]
    Stated,
    /// The longest exposure time is that of the manifest; the others follow from ratios measured in the pixels.
    Measured,
}

/// Processes the bursts and prints one light set per burst on standard output, and a summary of each burst on standard error.
///
/// # Errors
/// [`SimError`] if a burst cannot be read or processed, or an output cannot be written.
pub fn run(job: &Job) -> Result<(), SimError> {
    let bursts = list(job)?;
    job.export.check_count(bursts.len())?;
    let many = bursts.len() > 1;
    let mut pipeline: Option<Pipeline> = None;
    for (index, folder) in bursts.iter().enumerate() {
        let mut read = read(job, &folder.folder)?;
        read.burst.timestamp_ns = read.burst.timestamp_ns.max(folder.timestamp_ns);
        if let (Some(rate), None) = (job.rate_hz, read.burst.phase_s()) {
            let frames = index * read.burst.frames.len();
            read.burst.phase_ns = 1 + (1e9 * frames as f64 / rate) as u64;
        }
        let exposures: Vec<_> = read.burst.frames.iter().map(|f| f.exposure).collect();
        let tells = pipeline.is_none();
        let same = pipeline.take().filter(|p| *p.calibration() == read.calibration);
        let running = match same {
            Some(p) => p,
            None => {
                let made = Pipeline::try_new(read.calibration, &exposures, job.settings.clone());
                made.map_err(|e| at(&folder.folder, e))?
            }
        };
        let pipeline = pipeline.insert(running);
        let found = pipeline.inspect(&read.burst);
        let left_out = consistency::remove(&mut read, &found);
        prepare(job, &folder.folder, &mut read, &left_out, tells);
        process(job, pipeline, &read.burst, Place { index, many, folder: &folder.folder }, &left_out)?;
    }
    Ok(())
}

/// Returns the bursts of the recording; a folder of photographs is one burst.
fn list(job: &Job) -> Result<Vec<BurstFolder>, SimError> {
    let is_photographs = !job.burst.join("burst.toml").is_file() && !import::list(&job.burst)?.is_empty();
    if !is_photographs {
        return Ok(recorded::read_sequence(&job.burst)?);
    }
    if job.lens.is_some() {
        return Ok(vec![BurstFolder { folder: job.burst.clone(), timestamp_ns: 0 }]);
    }
    let expected = "a burst.toml (hemilux-sim import --lens LENS PHOTO... --out DIR writes one; replay --lens LENS does without)";
    Err(SimError::at(&job.burst, "photographs without a burst.toml", expected))
}

fn read(job: &Job, folder: &Path) -> Result<RecordedBurst, SimError> {
    match &job.lens {
        Some(lens) if !folder.join("burst.toml").is_file() => {
            let text = import::describe(lens, &import::list(folder)?, false)?;
            Ok(recorded::read_described(folder, &text, &job.limits)?)
        }
        _ => Ok(recorded::read_recorded(folder, &job.limits)?),
    }
}

/// Prints the frames that were left out and the exposure ratios of the others, and applies the ratios if requested.
fn prepare(job: &Job, folder: &Path, read: &mut RecordedBurst, left_out: &[LeftOut], tells: bool) {
    for frame in left_out {
        eprintln!("hemilux-sim: {}/{frame}", folder.display());
    }
    let ratios = ratios(&read.calibration, &read.burst);
    if tells {
        print_ratios(&ratios);
    }
    if job.exposures == Exposures::Measured {
        apply(&ratios, &mut read.burst);
    }
}

/// Sets the exposure times by the measured ratios, from the longest exposure down.
fn apply(ratios: &[Ratio], burst: &mut Burst) {
    for (i, ratio) in ratios.iter().enumerate().rev() {
        let longer = burst.frames[i + 1].light();
        let usable = ratio.samples >= LEAST_SAMPLES && ratio.measured.is_finite() && ratio.measured > 0.0;
        let factor = if usable { ratio.measured } else { ratio.nominal };
        let exposure = &mut burst.frames[i].exposure;
        exposure.seconds = longer / factor / exposure.gain;
    }
}

/// Least number of samples for a measured ratio to replace the stated one.
const LEAST_SAMPLES: usize = 1000;

/// Position of a burst in its sequence.
#[derive(Clone, Copy)]
struct Place<'a> {
    index: usize,
    many: bool,
    folder: &'a Path,
}

fn process(
    job: &Job,
    pipeline: &mut Pipeline,
    burst: &Burst,
    place: Place<'_>,
    left_out: &[LeftOut],
) -> Result<(), SimError> {
    let processed =
        pipeline.process_kept(burst, FramesLeftOut::NONE, Instant::now()).map_err(|e| at(place.folder, e))?;
    let seen = processed.seen;
    eprintln!(
        "hemilux-sim: {}: clipped {:.4} and unseen {:.4} of the hemisphere, light from below {:.4} of that from above",
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

/// Adds the path of the burst to an error of the pipeline; a wrong sampler or number of lights is a usage error.
fn at(folder: &Path, e: PipelineError) -> SimError {
    match e {
        PipelineError::Sampler(e) => e.into(),
        e => SimError::Failed(format!("{}: {e}", folder.join("burst.toml").display())),
    }
}

/// Largest number of samples of a frame on which a ratio is measured, which bounds the memory; of larger frames every n-th pixel is used.
const MOST_SAMPLES: usize = 3 << 20;

/// Exposure ratio of two frames with neighbouring exposures: stated and measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// Exposure times of the manifest, seconds.
    pub seconds: [f64; 2],
    /// Ratio of the manifest's exposure times.
    pub nominal: f64,
    /// Median ratio over pixels that are well exposed in both frames.
    pub measured: f64,
    /// Number of samples of the measurement.
    pub samples: usize,
}

/// Measures the ratios of neighbouring exposures; exposure times that cameras report have errors of up to a fifth. Empty for frames in
/// other formats than red, green and blue.
#[must_use]
pub fn ratios(calibration: &Calibration, burst: &Burst) -> Vec<Ratio> {
    let c = calibration;
    if !matches!(c.layout.format(), Format::Rgb24 | Format::Rgb48) {
        return Vec::new();
    }
    let depth = c.layout.format().depth();
    let table = vec![0; curve_len(depth)];
    let Ok(curve) = Curve::try_new(&c.response, depth, c.levels, table) else { return Vec::new() };
    burst.frames.windows(2).map(|pair| ratio(&curve, pair)).collect()
}

fn ratio(curve: &Curve<Vec<i32>>, pair: &[Frame]) -> Ratio {
    // A twentieth of full scale: below it quantisation dominates.
    let least = 1 << (hemilux_core::response::CURVE_BITS - 5);
    let step = sample_count(&pair[0]).div_ceil(MOST_SAMPLES);
    let [short, long] = [codes(&pair[0]), codes(&pair[1])];
    let mut found: Vec<f32> = std::iter::zip(short, long)
        .enumerate()
        .filter(|(i, _)| (i / 3) % step == 0)
        .filter(|(_, (a, b))| !curve.is_saturated(*b) && curve.is_trusted(*a))
        .map(|(i, (a, b))| (curve.exposure_q27(i % 3, a), curve.exposure_q27(i % 3, b)))
        .filter(|(a, _)| *a > least)
        .map(|(a, b)| (f64::from(b) / f64::from(a)) as f32)
        .collect();
    found.sort_by(f32::total_cmp);
    Ratio {
        seconds: [pair[0].exposure.seconds, pair[1].exposure.seconds],
        nominal: pair[1].light() / pair[0].light(),
        measured: found.get(found.len() / 2).map_or(f64::NAN, |ratio| f64::from(*ratio)),
        samples: found.len(),
    }
}

fn sample_count(frame: &Frame) -> usize {
    match &frame.pixels {
        hemilux::calibration::Pixels::U8(v) => v.len(),
        hemilux::calibration::Pixels::U16(v) => v.len(),
    }
}

fn codes(frame: &Frame) -> Box<dyn Iterator<Item = u32> + '_> {
    match &frame.pixels {
        hemilux::calibration::Pixels::U8(v) => Box::new(v.iter().map(|c| u32::from(*c))),
        hemilux::calibration::Pixels::U16(v) => Box::new(v.iter().map(|c| u32::from(*c))),
    }
}

/// Deviation of a measured ratio from the declared one that is told.
const CONTRADICTION: f64 = 0.1;

fn print_ratios(ratios: &[Ratio]) {
    if ratios.is_empty() {
        return;
    }
    eprintln!("hemilux-sim: exposure ratios, by the file and as measured in the pixels");
    eprintln!("    shorter s     longer s    nominal   measured   off by   samples");
    for r in ratios {
        let [a, b] = r.seconds;
        let off = 100.0 * (r.measured / r.nominal - 1.0);
        eprintln!("{a:>13.6}{b:>13.6}{:>11.3}{:>11.3}{off:>+8.1} %{:>10}", r.nominal, r.measured, r.samples);
    }
    if ratios.iter().any(|r| (r.measured / r.nominal - 1.0).abs() > CONTRADICTION) {
        eprintln!(
            "hemilux-sim: the exposure times contradict the pixels by more than {:.0} %: where the scene stood still, --exposures measured \
             takes the pixels' ratios",
            100.0 * CONTRADICTION
        );
    }
}
