//! A world in time: bursts of a scene whose lamps vary while the frames are exposed.
//!
//! Light is linear: the still part and each lamp are rendered once through the lens, and each row of each frame adds the lamps' mean
//! light over the interval in which that row is exposed. Noise, response and quantisation follow, as in [`crate::burst`].

mod wave;

pub use wave::{Change, Course, Wave};

use crate::burst::{self, Sensor};
use crate::env::EnvMap;
use crate::error::SimError;
use crate::metrics::stability::Source;
use crate::output;
use crate::scenario::stage::with_disc;
use hemilux::calibration::{Burst, Calibration, Frame};
use hemilux::recorded::LensFile;
use hemilux_core::Exposure;
use std::path::Path;

/// A lamp of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Direction and radius.
    pub source: Source,
    /// Colour, luminance 1.
    pub colour: [f64; 3],
    /// Mean luminous flux: sum of Y dOmega.
    pub flux: f64,
    /// Light over time.
    pub course: Course,
}

/// A still scene and its lamps.
#[derive(Clone, Debug)]
pub struct World {
    /// The constant part of the light.
    pub still: EnvMap,
    /// The scene by the light of the mains, if it has any.
    pub lit: Option<(EnvMap, Course)>,
    /// Lamps of the world.
    pub lamps: Vec<Lamp>,
}

impl World {
    /// Radiance at `at_s`, averaged over the period of each lamp.
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

/// Times at which a camera takes bursts and exposures.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Frames a second.
    pub rate_hz: f64,
    /// Exposure times, ascending, seconds.
    pub exposures: Vec<f64>,
    /// Time from the readout of one row to the next, seconds.
    pub line_s: f64,
    /// Whether each burst begins one exposure later than the burst before.
    pub rotates: bool,
}

impl Timing {
    /// Index of the frame, counted over all bursts, that takes exposure `index` of a burst.
    fn frame(&self, burst: usize, index: usize) -> usize {
        let count = self.exposures.len();
        let place = if self.rotates { (index + burst) % count } else { index };
        burst * count + place
    }

    /// End of the exposure of a frame's first row, seconds.
    fn end_s(&self, burst: usize, index: usize) -> f64 {
        (self.frame(burst, index) + 1) as f64 / self.rate_hz
    }

    /// End of a burst, seconds.
    #[must_use]
    pub fn burst_end_s(&self, burst: usize) -> f64 {
        ((burst + 1) * self.exposures.len()) as f64 / self.rate_hz
    }
}

/// A camera before a world.
pub struct Filming {
    timing: Timing,
    lens: LensFile,
    camera: burst::SensorModel,
    still: burst::ExposedScene,
    /// Radiance and course of what varies.
    varying: Vec<(Vec<Lit>, Course)>,
    seed: u64,
}

/// A pixel that sees a lamp.
#[derive(Clone, Copy, Debug)]
struct Lit {
    pixel: usize,
    radiance: [f64; 3],
}

/// Frames of one burst.
struct Taken {
    codes: Vec<Vec<u16>>,
    times_ns: Vec<u64>,
}

impl Filming {
    /// Renders the parts of `world` through `lens`. The radiance of full scale is `scale`, at one second; without it, the brightest texel of
    /// the mean fills half of the shortest exposure.
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
            lit.map(|(pixel, radiance)| Lit { pixel, radiance }).collect::<Vec<_>>()
        };
        let room = world.lit.iter().map(|(map, course)| (render(map), course.clone()));
        let lamps = world.lamps.iter().map(|lamp| {
            let disc = with_disc(&dark, lamp.source, lamp.colour, lamp.flux);
            (render(&disc), lamp.course.clone())
        });
        let varying = room.chain(lamps).collect();
        Self { camera: burst::SensorModel::new(&lens, sensor, scale), timing, lens, still, varying, seed: 1 }
    }

    /// Another seed of the noise.
    #[must_use]
    pub fn seeded(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// The calibration of the camera.
    #[must_use]
    pub fn calibration(&self) -> Calibration {
        self.camera.calibration(&self.lens)
    }

    /// The exposures of a burst.
    #[must_use]
    pub fn exposures(&self) -> Vec<Exposure> {
        self.timing.exposures.iter().map(|&seconds| Exposure { seconds, gain: 1.0 }).collect()
    }

    fn take(&self, burst: usize) -> Taken {
        let count = self.timing.exposures.len();
        let codes = (0..count).map(|index| {
            let seconds = self.timing.exposures[index];
            let scene = self.exposed(self.timing.end_s(burst, index), seconds);
            let frame = self.timing.frame(burst, index);
            self.camera.record(&scene, seconds, &mut burst::noise(self.seed, frame))
        });
        let ns = |index| (1e9 * (1.0 + self.timing.end_s(burst, index))) as u64;
        Taken { codes: codes.collect(), times_ns: (0..count).map(ns).collect() }
    }

    /// Mean radiance of each pixel while it is exposed; `end_s` is the end of the first row's exposure.
    fn exposed(&self, end_s: f64, seconds: f64) -> burst::ExposedScene {
        let mut scene = self.still.clone();
        let [width, height] = self.lens.size.map(|n| n as usize);
        for (pixels, course) in &self.varying {
            let means: Vec<f64> = (0..height)
                .map(|row| end_s + row as f64 * self.timing.line_s)
                .map(|end| course.mean(end - seconds, end))
                .collect();
            for Lit { pixel, radiance } in pixels {
                let mean = means[pixel / width];
                scene.radiance[*pixel].iter_mut().zip(radiance).for_each(|(sum, v)| *sum += mean * v);
            }
        }
        scene
    }

    /// Takes burst number `burst`, from 0.
    #[must_use]
    pub fn burst(&self, burst: usize) -> Burst {
        let Taken { codes, times_ns } = self.take(burst);
        let frames = codes.into_iter().zip(self.exposures());
        let frames = frames.map(|(codes, exposure)| Frame { exposure, pixels: self.camera.pixels(codes) });
        let timestamp_ns = times_ns.iter().copied().max().unwrap_or(0);
        Burst { frames: frames.collect(), before_ns: 0, timestamp_ns, phase_ns: times_ns[0] }
    }

    /// Writes burst number `burst` as a recorded burst to `folder`; `has_times` states whether its frames have time stamps.
    ///
    /// # Errors
    /// [`SimError`].
    pub fn record(&self, burst: usize, folder: &Path, has_times: bool) -> Result<(), SimError> {
        std::fs::create_dir_all(folder).map_err(|e| SimError::at(folder, e, "a folder that can be made"))?;
        let Taken { codes, times_ns } = self.take(burst);
        for (index, codes) in codes.iter().enumerate() {
            burst::save(folder, self.lens.size, codes, index, self.camera.white())?;
        }
        let times_ns = if has_times { &times_ns[..] } else { &[] };
        let manifest = burst::manifest(&self.timing.exposures, times_ns, &self.lens, &self.camera);
        output::save(&folder.join("burst.toml"), manifest.as_bytes())
    }
}
