//! Simulated bursts of a scene whose lamps vary while the frames are exposed.
//!
//! Light is linear: the constant part of the scene and each lamp are rendered once through the lens. A row of a frame is the sum of the constant
//! part and of each lamp times its mean light while the row is exposed; then noise, response and quantisation are applied, as in
//! [`crate::burst`].

mod moving;
mod wave;

pub use moving::MovingView;
pub use wave::{Change, Course, Wave};

use crate::burst::{self, Sensor};
use crate::env::EnvMap;
use crate::error::SimError;
use crate::metrics::stability::LightSource;
use crate::output;
use crate::scenario::stage::with_disc;
use hemilux::calibration::{Burst, Calibration, Frame};
use hemilux::recorded::LensFile;
use hemilux_core::Exposure;
use std::path::Path;

/// A lamp: a disc whose light varies over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Direction and angular radius of the lamp's disc.
    pub source: LightSource,
    /// Linear RGB colour of the lamp, normalised to luminance 1.
    pub colour: [f64; 3],
    /// Luminous energy of the lamp at the mean of its waveform and level 1: sum of Y dOmega.
    pub flux: f64,
    /// Waveform and level of the lamp over time.
    pub course: Course,
}

/// A scene: constant light, and light that varies over time.
#[derive(Clone, Debug)]
pub struct World {
    /// Radiance of the scene that does not vary.
    pub still: EnvMap,
    /// Radiance of surfaces under flickering light, at level 1, with the course of the light.
    pub lit: Option<(EnvMap, Course)>,
    /// Lamps of the scene.
    pub lamps: Vec<Lamp>,
}

impl World {
    /// Returns the radiance at the time `at_s` in seconds, averaged over the period of each lamp.
    #[must_use]
    pub fn mean(&self, at_s: f64) -> EnvMap {
        let mut map = self.still.clone();
        if let Some((lit, course)) = &self.lit {
            let level = course.level(at_s) as f32;
            let texels = map.texels().iter().zip(lit.texels());
            let sums = texels.map(|(a, b)| std::array::from_fn(|c| a[c] + level * b[c])).collect();
            map = EnvMap::new(lit.width(), lit.height(), sums);
        }
        self.lamps.iter().fold(map, |map, lamp| {
            with_disc(&map, lamp.source, lamp.colour, lamp.flux * lamp.course.level(at_s))
        })
    }
}

/// The times at which a camera exposes the frames of its bursts.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Frame rate of the camera, frames per second.
    pub rate_hz: f64,
    /// Exposure times of a burst, ascending, seconds.
    pub exposures: Vec<f64>,
    /// Time from the readout of one row of a frame to that of the next, seconds.
    pub line_s: f64,
    /// Whether the order of the exposures rotates by one from burst to burst.
    pub rotates: bool,
}

impl Timing {
    /// Returns the index, over the frames of all bursts, of the frame with the exposure `index` of a burst.
    fn frame(&self, burst: usize, index: usize) -> usize {
        let count = self.exposures.len();
        let place = if self.rotates { (index + burst) % count } else { index };
        burst * count + place
    }

    /// Returns the time at which the exposure of a frame's first row ends, seconds.
    fn end_s(&self, burst: usize, index: usize) -> f64 {
        (self.frame(burst, index) + 1) as f64 / self.rate_hz
    }

    /// Returns the time at which a burst ends, seconds.
    #[must_use]
    pub fn burst_end_s(&self, burst: usize) -> f64 {
        ((burst + 1) * self.exposures.len()) as f64 / self.rate_hz
    }
}

/// A simulated camera in a scene, with the rendered parts of the scene.
pub struct Filming {
    timing: Timing,
    lens: LensFile,
    camera: burst::SensorModel,
    still: burst::ExposedScene,
    /// Radiance of the pixels under each varying light at level 1, with the course of the light.
    varying: Vec<(Vec<LitPixel>, Course)>,
    seed: u64,
}

/// Radiance of a pixel that a varying light illuminates.
#[derive(Clone, Copy, Debug)]
struct LitPixel {
    pixel: usize,
    radiance: [f64; 3],
}

/// Codes and time stamps of the frames of one burst.
struct BurstCodes {
    codes: Vec<Vec<u16>>,
    times_ns: Vec<u64>,
}

impl Filming {
    /// Renders the parts of `world` through `lens`. The radiance `scale` reaches the largest code in one second; without `scale`, the brightest
    /// pixel of the mean over time reaches half of the largest code in the shortest exposure.
    #[must_use]
    pub fn new(world: &World, lens: LensFile, timing: Timing, sensor: Sensor, scale: Option<f64>) -> Self {
        let scale = scale.unwrap_or_else(|| {
            let all = World { still: world.still.clone(), ..world.clone() };
            2.0 * burst::fitted_scale(&burst::expose(&all.mean(0.0), &lens), &timing.exposures)
        });
        let still = burst::expose(&world.still, &lens);
        let (width, height) = (world.still.width(), world.still.height());
        let dark = EnvMap::new(width, height, vec![[0.0; 3]; width * height]);
        let render = |map: &EnvMap| {
            let pixels = burst::expose(map, &lens).radiance.into_iter().enumerate();
            let lit = pixels.filter(|(_, rgb)| *rgb != [0.0; 3]);
            lit.map(|(pixel, radiance)| LitPixel { pixel, radiance }).collect::<Vec<_>>()
        };
        let room = world.lit.iter().map(|(map, course)| (render(map), course.clone()));
        let lamps = world.lamps.iter().map(|lamp| {
            let disc = with_disc(&dark, lamp.source, lamp.colour, lamp.flux);
            (render(&disc), lamp.course.clone())
        });
        let varying = room.chain(lamps).collect();
        Self { camera: burst::SensorModel::new(&lens, sensor, scale), timing, lens, still, varying, seed: 1 }
    }

    /// Returns the camera with another seed of the noise.
    #[must_use]
    pub fn seeded(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// Returns the calibration of the camera.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.camera.calibration(&self.lens)
    }

    /// Returns the exposures of a burst, ascending.
    #[must_use]
    pub fn exposures(&self) -> Vec<Exposure> {
        self.timing.exposures.iter().map(|&seconds| Exposure { seconds, gain: 1.0 }).collect()
    }

    fn take(&self, burst: usize) -> BurstCodes {
        let count = self.timing.exposures.len();
        let codes = (0..count).map(|index| {
            let seconds = self.timing.exposures[index];
            let scene = self.exposed(self.timing.end_s(burst, index), seconds);
            let frame = self.timing.frame(burst, index);
            self.camera.record(&scene, seconds, &mut burst::noise(self.seed, frame))
        });
        let ns = |index| (1e9 * (1.0 + self.timing.end_s(burst, index))) as u64;
        BurstCodes { codes: codes.collect(), times_ns: (0..count).map(ns).collect() }
    }

    /// Returns the mean radiance of each pixel during its exposure of `seconds`; `end_s` is the time at which the exposure of the first row ends,
    /// seconds.
    fn exposed(&self, end_s: f64, seconds: f64) -> burst::ExposedScene {
        let mut scene = self.still.clone();
        let [width, height] = self.lens.size.map(|n| n as usize);
        for (pixels, course) in &self.varying {
            let means: Vec<f64> = (0..height)
                .map(|row| end_s + row as f64 * self.timing.line_s)
                .map(|end| course.mean(end - seconds, end))
                .collect();
            for LitPixel { pixel, radiance } in pixels {
                let mean = means[pixel / width];
                scene.radiance[*pixel].iter_mut().zip(radiance).for_each(|(sum, v)| *sum += mean * v);
            }
        }
        scene
    }

    /// Returns the burst with the number `burst`, from 0.
    #[must_use]
    pub fn burst(&self, burst: usize) -> Burst {
        let BurstCodes { codes, times_ns } = self.take(burst);
        let frames = codes.into_iter().zip(self.exposures());
        let frames = frames.map(|(codes, exposure)| Frame { exposure, pixels: self.camera.pixels(codes) });
        let timestamp_ns = times_ns.iter().copied().max().unwrap_or(0);
        Burst { frames: frames.collect(), timestamp_ns, phase_ns: times_ns[0], ..Burst::default() }
    }

    /// Writes the burst with the number `burst` as a recorded burst to `folder`; with `has_times`, the frames have time stamps.
    ///
    /// # Errors
    /// [`SimError`] if the folder or a file cannot be written.
    pub fn record(&self, burst: usize, folder: &Path, has_times: bool) -> Result<(), SimError> {
        std::fs::create_dir_all(folder)
            .map_err(|e| SimError::at(folder, e, "a folder that can be created"))?;
        let BurstCodes { codes, times_ns } = self.take(burst);
        for (index, codes) in codes.iter().enumerate() {
            burst::save(folder, self.lens.size, codes, index, self.camera.white())?;
        }
        let times_ns = if has_times { &times_ns[..] } else { &[] };
        let manifest = burst::manifest(&self.timing.exposures, times_ns, &self.lens, &self.camera);
        output::save(&folder.join("burst.toml"), manifest.as_bytes())
    }
}
