//! `hemilux-sim burst`: simulates the burst that a camera records under an environment map.

use crate::decompose;
use crate::env::EnvMap;
use crate::error::SimError;
use crate::footprint;
use crate::output;
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::maps::ReadOptions;
use hemilux::recorded::{self, LensFile, Levels};
use hemilux_core::Exposure;
use hemilux_core::Response;
use hemilux_core::format::Format;
use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::path::{Path, PathBuf};

/// Relative exposure (1 is the largest code) of the brightest visible texel in the shortest frame, if [`LEAST_MEAN`] allows it.
const HEADROOM: f64 = 0.9;

/// Least mean relative exposure of the longest frame: eight 12-bit codes. In scenes of higher contrast the brightest texels are allowed to
/// clip, so that the mean stays above the noise.
const LEAST_MEAN: f64 = 0.002;

/// Exposure times of \[Nikodym2012\], seconds.
pub const THESIS_EXPOSURES_S: [f64; 3] = [0.000_926, 0.005_555, 0.033_333];

/// Properties of the simulated sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Number of bits of a code of the sensor.
    pub bits: u32,
    /// Electrons at the largest code and gain 1; 0 for a sensor without noise.
    pub full_well: f64,
    /// Read noise of the sensor, electrons.
    pub read_noise: f64,
}

/// Arguments of `burst`.
#[derive(Clone, Debug)]
pub struct BurstJob {
    /// Path of the environment map.
    pub env: PathBuf,
    /// Options for reading the map.
    pub options: ReadOptions,
    /// Path of the simulated camera's lens file.
    pub lens: PathBuf,
    /// Exposure times of the burst's frames, seconds.
    pub exposures: Vec<f64>,
    /// Radiance that reaches the largest code in one second; `None` to fit the value to the scene.
    pub scale: Option<f64>,
    /// Properties of the simulated sensor.
    pub sensor: Sensor,
    /// Seed of the simulated sensor noise.
    pub seed: u64,
    /// Folder for the burst; it is created if it does not exist.
    pub out: PathBuf,
}

/// Image-side radiance of each pixel, row by row; pixels outside of the image circle are black.
#[derive(Clone, Debug)]
pub(crate) struct ExposedScene {
    pub radiance: Vec<[f64; 3]>,
    /// Largest radiance of any channel over all pixels.
    brightest: f64,
    /// Mean radiance over the channels of all pixels in the image circle.
    mean: f64,
}

/// Simulates a burst and writes its frames and its `burst.toml` to the folder `job.out`.
///
/// # Errors
/// [`SimError`] if the map or the lens file cannot be read, an option is out of range, or the burst cannot be written.
pub fn run(job: &BurstJob) -> Result<(), SimError> {
    check(job)?;
    let env = decompose::read(&job.env, &job.options)?;
    let lens = recorded::read_lens(&job.lens)?;
    lens.notes.iter().for_each(|note| eprintln!("hemilux-sim: {}: {note}", job.lens.display()));
    let scene = expose(&env, &lens);
    let scale = job.scale.unwrap_or_else(|| fitted_scale(&scene, &job.exposures));
    let camera = SensorModel::new(&lens, job.sensor, scale);
    std::fs::create_dir_all(&job.out)
        .map_err(|e| SimError::at(&job.out, e, "a folder that can be created"))?;
    for (index, seconds) in job.exposures.iter().enumerate() {
        let codes = camera.record(&scene, *seconds, &mut noise(job.seed, index));
        save(&job.out, lens.size, &codes, index, camera.levels.white)?;
    }
    let manifest = manifest(&job.exposures, &[], &lens, &camera);
    output::save(&job.out.join("burst.toml"), manifest.as_bytes())
}

/// Returns the radiance that reaches the largest code in one second, chosen so that the brightest pixel has the relative exposure [`HEADROOM`] in
/// the shortest exposure, or a larger one if the mean in the longest exposure would fall below [`LEAST_MEAN`].
pub(crate) fn fitted_scale(scene: &ExposedScene, exposures: &[f64]) -> f64 {
    let shortest = exposures.iter().copied().fold(f64::INFINITY, f64::min);
    let longest = exposures.iter().copied().fold(0.0, f64::max);
    let fitted = (scene.brightest * shortest / HEADROOM).min(scene.mean * longest / LEAST_MEAN);
    if fitted > 0.0 { fitted } else { 1.0 }
}

/// Returns the code levels of the lens file; without them, black is 1/16 of the codes and white the largest code.
fn levels(lens: &LensFile, sensor: Sensor) -> Levels {
    let full = f64::from((1u32 << sensor.bits) - 1);
    lens.levels.unwrap_or(Levels { black: f64::from(1u32 << sensor.bits >> 4), white: full })
}

/// Returns the random generator of the noise of frame `index`.
pub(crate) fn noise(seed: u64, index: usize) -> Pcg64 {
    Pcg64::seed_from_u64(seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u64))
}

/// Simulates a burst and returns it with the camera's calibration; `exposures` are ascending exposure times in seconds.
///
/// # Panics
/// If the image of the lens has more than 2^26 pixels.
#[must_use]
pub fn in_memory(
    env: &EnvMap,
    lens: &LensFile,
    exposures: &[f64],
    sensor: Sensor,
    seed: u64,
) -> (Calibration, Burst) {
    let scene = expose(env, lens);
    let scale = fitted_scale(&scene, exposures);
    let camera = SensorModel::new(lens, sensor, scale);
    let frame = |(index, &seconds): (usize, &f64)| {
        let pixels = camera.pixels(camera.record(&scene, seconds, &mut noise(seed, index)));
        Frame { exposure: Exposure { seconds, gain: 1.0 }, pixels }
    };
    let frames = exposures.iter().enumerate().map(frame).collect();
    (camera.calibration(lens), Burst { frames, ..Burst::default() })
}

fn check(job: &BurstJob) -> Result<(), SimError> {
    let count = job.exposures.len();
    if !(1..=hemilux_core::MAX_EXPOSURES).contains(&count) {
        let most = hemilux_core::MAX_EXPOSURES;
        return Err(SimError::Usage(format!("--exposures: found {count} times, expected 1 to {most} times")));
    }
    if let Some(bad) = job.exposures.iter().find(|t| !(**t > 0.0 && t.is_finite())) {
        return Err(SimError::Usage(format!("--exposures: found {bad}, expected positive seconds")));
    }
    if !(8..=16).contains(&job.sensor.bits) {
        return Err(SimError::Usage(format!(
            "--bits: found {}, expected 8 to 16 bits per code",
            job.sensor.bits
        )));
    }
    Ok(())
}

/// Returns the mean image-side radiance of the map over the footprint of every pixel.
pub(crate) fn expose(env: &EnvMap, lens: &LensFile) -> ExposedScene {
    ExposedScene::of(footprint::pixels(lens).map(|pixel| footprint::mean(env, lens, pixel)))
}

impl ExposedScene {
    /// Creates the scene from the radiance of each pixel, row by row; `None` for pixels outside of the image circle.
    pub(crate) fn of(pixels: impl Iterator<Item = Option<[f64; 3]>>) -> Self {
        let mut radiance = Vec::with_capacity(pixels.size_hint().0);
        let (mut brightest, mut sum, mut seen) = (0.0f64, 0.0, 0usize);
        for value in pixels {
            if let Some(rgb) = value {
                brightest = rgb.into_iter().fold(brightest, f64::max);
                sum += rgb.iter().sum::<f64>() / 3.0;
                seen += 1;
            }
            radiance.push(value.unwrap_or_default());
        }
        Self { radiance, brightest, mean: sum / seen.max(1) as f64 }
    }
}

/// Returns the relative exposure (1 at the white level) of every code of the sensor, for each channel.
fn curves(response: &Response, Levels { black, white }: Levels) -> [Vec<f64>; 3] {
    let codes = 0..=(white as u32);
    std::array::from_fn(|c| {
        codes.clone().map(|z| response.exposure(c, (f64::from(z) - black) / (white - black))).collect()
    })
}

/// Model of a sensor: noise, response curve, code levels.
#[derive(Clone, Debug)]
pub(crate) struct SensorModel {
    levels: Levels,
    /// Radiance that reaches the white level in one second.
    scale: f64,
    sensor: Sensor,
    /// Relative exposure of every code of the sensor, for each channel.
    curves: [Vec<f64>; 3],
}

impl SensorModel {
    /// Creates the model with the response and levels of a lens file; the radiance `scale` reaches the white level in one second.
    pub fn new(lens: &LensFile, sensor: Sensor, scale: f64) -> Self {
        let levels = levels(lens, sensor);
        Self { levels, scale, sensor, curves: curves(&lens.response, levels) }
    }

    /// Returns the pixel format of the frames: 8 bits per sample if the white level allows it, 16 bits otherwise.
    fn format(&self) -> Format {
        if self.levels.white <= 255.0 { Format::Rgb24 } else { Format::Rgb48 }
    }

    /// Converts codes to samples of the frames' pixel format.
    pub fn pixels(&self, codes: Vec<u16>) -> Pixels {
        match self.format() {
            Format::Rgb24 => Pixels::U8(codes.iter().map(|c| *c as u8).collect()),
            _ => Pixels::U16(codes),
        }
    }

    /// Returns the calibration of a camera with this sensor and the lens of `lens`.
    pub fn calibration(&self, lens: &LensFile) -> Calibration {
        let [width, height] = lens.size;
        let mut calibration = Calibration::try_new(lens.lens, self.format(), width, height)
            .expect("the lens file's size is legal for an image");
        calibration.response = lens.response;
        calibration.levels = Levels { black: self.levels.black, white: self.levels.white };
        calibration.scale = self.scale;
        calibration
    }

    /// Returns the white level, the code of a saturated sample.
    pub fn white(&self) -> f64 {
        self.levels.white
    }

    /// Returns the codes of one frame of `seconds`: relative exposure, photon and read noise, response, rounding to the nearest code.
    pub fn record(&self, scene: &ExposedScene, seconds: f64, noise: &mut impl Rng) -> Vec<u16> {
        let mut codes = Vec::with_capacity(3 * scene.radiance.len());
        for rgb in &scene.radiance {
            for (channel, value) in rgb.iter().enumerate() {
                let y = self.noisy(value * seconds / self.scale, noise);
                codes.push(self.code(channel, y));
            }
        }
        codes
    }

    /// Adds photon and read noise to the relative exposure `y`.
    fn noisy(&self, y: f64, noise: &mut impl Rng) -> f64 {
        if self.sensor.full_well <= 0.0 {
            return y;
        }
        let electrons = y * self.sensor.full_well;
        let sigma = (electrons + self.sensor.read_noise * self.sensor.read_noise).sqrt();
        let normal: f64 = StandardNormal.sample(noise);
        (electrons + sigma * normal) / self.sensor.full_well
    }

    /// Returns the code whose relative exposure is nearest to `y`.
    fn code(&self, channel: usize, y: f64) -> u16 {
        let curve = &self.curves[channel];
        let above = curve.partition_point(|v| *v < y).min(curve.len() - 1);
        let below = above.saturating_sub(1);
        let nearer = if (y - curve[below]).abs() < (curve[above] - y).abs() { below } else { above };
        (nearer as f64).min(self.levels.white) as u16
    }
}

/// Writes the codes of one frame as a PNG file to `folder`: 8 bits per sample if `white` is at most 255, 16 bits otherwise.
pub(crate) fn save(
    folder: &Path,
    [width, height]: [u32; 2],
    codes: &[u16],
    index: usize,
    white: f64,
) -> Result<(), SimError> {
    let path = folder.join(file_name(index));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = if white <= 255.0 {
        let codes = codes.iter().map(|c| *c as u8).collect();
        image::RgbImage::from_raw(width, height, codes).map(image::DynamicImage::ImageRgb8)
    } else {
        image::ImageBuffer::from_raw(width, height, codes.to_vec()).map(image::DynamicImage::ImageRgb16)
    };
    let image =
        image.ok_or_else(|| SimError::at(&path, "too few samples", "three samples for each pixel"))?;
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|e| SimError::at(&path, e, "a picture that PNG can hold"))?;
    output::save(&path, bytes.get_ref())
}

fn file_name(index: usize) -> String {
    format!("frame-{index}.png")
}

/// Returns the text of a `burst.toml` for frames with `exposures` in seconds; `times_ns` contains the time stamps of the frames in nanoseconds,
/// or is empty.
pub(crate) fn manifest(exposures: &[f64], times_ns: &[u64], lens: &LensFile, camera: &SensorModel) -> String {
    use toml::{Table, Value};
    let Levels { black, white } = camera.levels;
    let mut response = lens.response_table.clone().unwrap_or_default();
    response.entry("model").or_insert_with(|| Value::from("linear"));
    response.insert("scale".into(), Value::from(camera.scale));
    let sensor =
        Table::from_iter([("black", black), ("white", white)].map(|(k, v)| (k.to_string(), Value::from(v))));
    let frames = exposures.iter().enumerate().map(|(index, seconds)| {
        let mut frame = Table::from_iter([
            ("file".to_string(), Value::from(file_name(index))),
            ("exposure_s".to_string(), Value::from(*seconds)),
            ("gain".to_string(), Value::from(1.0)),
            ("sequence".to_string(), Value::from(index as i64)),
            ("known".to_string(), Value::from("reported")),
        ]);
        if let Some(ns) = times_ns.get(index) {
            frame.insert("timestamp_ns".into(), Value::from(i64::try_from(*ns).unwrap_or(i64::MAX)));
        }
        Value::Table(frame)
    });
    let frames: Vec<Value> = frames.collect();
    let manifest = Table::from_iter([
        ("version".to_string(), Value::from(1)),
        ("lens".to_string(), Value::Table(lens.lens_table.clone())),
        ("response".to_string(), Value::Table(response)),
        ("sensor".to_string(), Value::Table(sensor)),
        ("frame".to_string(), Value::from(frames)),
    ]);
    manifest.to_string()
}
