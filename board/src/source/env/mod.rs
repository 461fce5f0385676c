//! Environment maps as a source: bursts that a simulated camera takes of a map, or of the maps of a folder in turn.

mod raster;
mod spec;
#[cfg(test)]
mod tests;

pub use spec::{EnvSpec, View};

use super::pace::Beat;
use super::replay::MAX_RECORDING_BYTES;
use super::sensor::Sensor;
use super::{Pace, Source, SourceError, scene};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::clock;
use crate::maps::{self, MapError, ReadOptions};
use glam::DVec2;
use hemilux_core::format::Format;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::{Exposure, Levels};
use raster::Raster;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Largest accepted number of texels of a map: 8192 x 4096, 400 MB while the map is read.
const MAX_TEXELS: u64 = 1 << 25;

/// File extensions of environment maps.
const ENDS: [&str; 4] = ["exr", "hdr", "pic", "pfm"];

/// Width and height of the image of [`View::Whole`], pixels.
const WHOLE_SIDE: u32 = 512;

/// Code of a saturated pixel in [`View::Whole`], 16 bits.
const WHOLE_WHITE: f64 = 65_535.0;

/// The longest exposure time of the cameras of both views, seconds.
const LONGEST: f64 = 0.033_333;

/// Ratio of the radiance that saturates a pixel in the shortest exposure to the radiance of the brightest pixel, so large that noise does
/// not saturate this pixel.
const MARGIN: f64 = 1.2;

/// A source of bursts that a simulated camera takes of environment maps.
pub struct EnvSource {
    view: View,
    calibration: Calibration,
    /// Radiance of each pixel, red, green and blue, one element per map.
    maps: Vec<Vec<f32>>,
    /// Radiance that saturates a pixel in an exposure of `own[0]` seconds.
    full: f64,
    own: Vec<f64>,
    exposures: Vec<Exposure>,
    sensor: Sensor,
    beat: Beat,
    /// Number of bursts that show one map before the next map follows.
    stay: u32,
}

impl EnvSource {
    /// Reads and renders the maps of `spec`.
    ///
    /// # Errors
    /// [`MapError`]: no map, a map that cannot be read, or more than [`MAX_RECORDING_BYTES`] of rendered maps.
    pub fn open(spec: &EnvSpec, pace: Pace) -> Result<Self, MapError> {
        let mut calibration = match spec.view {
            View::Lens => scene::calibration(),
            View::Whole => whole(),
        };
        let maps = render(&spec.path, &calibration)?;
        let brightest = maps.iter().flatten().fold(0.0, |top: f32, v| top.max(*v));
        let full = if brightest > 0.0 { MARGIN * f64::from(brightest) } else { 1.0 };
        let own = match spec.view {
            View::Lens => times(full / median(&maps, full), 6.0, 3..=8),
            View::Whole => times(full / median(&maps, full), 256.0, 2..=3),
        };
        calibration.scale = full * own[0];
        let stay = match pace {
            Pace::Every(period) => (spec.every_s / period.as_secs_f64()).round().max(1.0) as u32,
            Pace::Free => 1,
        };
        let (exposures, sensor) = (own.iter().map(exposure).collect(), Sensor::new());
        let (view, beat) = (spec.view, Beat::new(pace));
        Ok(Self { view, calibration, maps, full, own, exposures, sensor, beat, stay })
    }

    fn render(&self, number: u32, burst: &mut Burst) {
        let map = &self.maps[(number / self.stay) as usize % self.maps.len()];
        let row = 3 * self.calibration.layout.width() as usize;
        for (i, frame) in burst.frames.iter_mut().enumerate() {
            let seconds = frame.exposure.seconds;
            match &mut frame.pixels {
                Pixels::U8(codes) => {
                    let gain = Sensor::gain(seconds, self.full, self.own[0]);
                    let seed = number.wrapping_mul(12).wrapping_add(i as u32).wrapping_mul(1 << 12);
                    for (y, (codes, radiance)) in codes.chunks_mut(row).zip(map.chunks(row)).enumerate() {
                        self.sensor.expose(radiance, gain, seed.wrapping_add(y as u32), codes);
                    }
                }
                Pixels::U16(codes) => {
                    let gain = (WHOLE_WHITE * seconds / self.calibration.scale) as f32;
                    codes.iter_mut().zip(map).for_each(|(code, l)| *code = (l * gain + 0.5) as u16);
                }
            }
        }
    }

    /// Resizes `burst` to one frame per exposure; the memory of frames of the right size is reused.
    fn fit(&self, burst: &mut Burst) {
        let samples = self.maps[0].len();
        let fits = |f: &Frame| match (&f.pixels, self.view) {
            (Pixels::U8(codes), View::Lens) => codes.len() == samples,
            (Pixels::U16(codes), View::Whole) => codes.len() == samples,
            _ => false,
        };
        if burst.frames.len() != self.exposures.len() || !burst.frames.iter().all(fits) {
            let pixels = || match self.view {
                View::Lens => Pixels::U8(vec![0; samples]),
                View::Whole => Pixels::U16(vec![0; samples]),
            };
            burst.frames = self.exposures.iter().map(|e| Frame { exposure: *e, pixels: pixels() }).collect();
        }
        burst.frames.iter_mut().zip(&self.exposures).for_each(|(frame, e)| frame.exposure = *e);
    }
}

impl Source for EnvSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.exposures.clone()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.exposures = seconds.unwrap_or(&self.own).iter().map(exposure).collect();
        Ok(())
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        None
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        let number = self.beat.due()?;
        self.fit(burst);
        burst.before_ns = clock::monotonic_ns();
        self.render(number, burst);
        burst.timestamp_ns = clock::monotonic_ns();
        Ok(())
    }
}

fn exposure(seconds: &f64) -> Exposure {
    Exposure { seconds: *seconds, gain: 1.0 }
}

/// Returns ascending exposure times, seconds, with the ratio `step` that cover radiances with a ratio of up to `range`.
fn times(range: f64, step: f64, count: std::ops::RangeInclusive<usize>) -> Vec<f64> {
    let needed = (range.max(1.0).ln() / step.ln()).ceil() as usize + 1;
    let count = needed.clamp(*count.start(), *count.end());
    (0..count).rev().map(|k| LONGEST / step.powi(k as i32)).collect()
}

/// Returns the median of the positive samples of all maps; `none` if there are no positive samples.
fn median(maps: &[Vec<f32>], none: f64) -> f64 {
    let mut lit: Vec<f32> =
        maps.iter().flat_map(|map| map.iter().step_by(97)).copied().filter(|v| *v > 0.0).collect();
    let middle = lit.len() / 2;
    if lit.is_empty() { none } else { f64::from(*lit.select_nth_unstable_by(middle, f32::total_cmp).1) }
}

/// Returns the radiance of each pixel of `camera` for the map at `path`, or for each map of a folder in the order of their names.
fn render(path: &Path, camera: &Calibration) -> Result<Vec<Vec<f32>>, MapError> {
    let files = files(path)?;
    let each = 12 * u64::from(camera.layout.width()) * u64::from(camera.layout.height());
    let most = MAX_RECORDING_BYTES / each;
    if files.len() as u64 > most {
        return Err(refusal(path, format!("{} maps", files.len()), format!("at most {most}")));
    }
    let options = ReadOptions { max_pixels: Some(MAX_TEXELS), ..ReadOptions::default() };
    let mut raster: Option<Raster> = None;
    let mut maps = Vec::with_capacity(files.len());
    for file in &files {
        let map = maps::read(file, &options)?;
        let way = match raster.take().filter(|r| r.fits(&map)) {
            Some(way) => way,
            None => Raster::new(&map, camera),
        };
        maps.push(way.radiance(&map, camera));
        raster = Some(way);
    }
    Ok(maps)
}

/// Returns the path itself if it is a file, the paths of the maps in a folder otherwise.
fn files(path: &Path) -> Result<Vec<PathBuf>, MapError> {
    let expected = "a map (.exr, .hdr or .pfm) or a folder of maps";
    if !path.is_dir() {
        return Ok(vec![path.into()]);
    }
    let is_map = |p: &Path| p.extension().is_some_and(|e| ENDS.iter().any(|end| e.eq_ignore_ascii_case(end)));
    let listed = std::fs::read_dir(path).and_then(|all| all.map(|e| e.map(|e| e.path())).collect());
    let mut files: Vec<PathBuf> = listed.map_err(|e: std::io::Error| refusal(path, e, expected))?;
    files.retain(|file| is_map(file));
    files.sort();
    if files.is_empty() { Err(refusal(path, "a folder without maps", expected)) } else { Ok(files) }
}

fn refusal(path: &Path, found: impl Display, expected: impl Display) -> MapError {
    MapError { path: path.into(), found: found.to_string(), expected: expected.to_string() }
}

/// Returns the calibration of an ideal lens for the upper hemisphere with a linear sensor of 16 bits.
fn whole() -> Calibration {
    let middle = f64::from(WHOLE_SIDE - 1) / 2.0;
    let mut vignetting = [0.0; 8];
    vignetting[0] = 1.0;
    let lens = Lens::try_new(Intrinsics {
        model: Model::Equidistant,
        centre_px: DVec2::splat(middle),
        focal_px: DVec2::splat(middle / std::f64::consts::FRAC_PI_2),
        skew_px: 0.0,
        max_theta: std::f64::consts::FRAC_PI_2,
        vignetting,
    });
    let lens = lens.expect("the ideal lens is a lens");
    let mut calibration =
        Calibration::try_new(lens, Format::Rgb48, WHOLE_SIDE, WHOLE_SIDE).expect("a square image has a size");
    calibration.levels = Levels { black: 0.0, white: WHOLE_WHITE };
    calibration
}
