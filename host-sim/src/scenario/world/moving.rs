//! A simulated camera in a scene that moves while the frames are exposed.

use super::Timing;
use crate::burst::{self, Sensor};
use crate::env::EnvMap;
use crate::footprint::Footprints;
use hemilux::calibration::{Calibration, Frame};
use hemilux::recorded::LensFile;
use hemilux_core::Exposure;

/// Longest interval of the times at which the light of an exposure is averaged, seconds; a lamp that moves by 100 degrees in a second moves by
/// less than half a degree in it.
const STEP_S: f64 = 0.004;

/// Relative exposure (1 is the largest code) of the brightest radiance in the shortest exposure.
const HEADROOM: f64 = 0.9;

/// A camera that takes the frames of its bursts one after the other. `F` returns the radiance of the scene at a time in seconds, as maps of
/// one size. All rows of a frame are exposed at the same time.
pub struct MovingView<F> {
    scene: F,
    timing: Timing,
    lens: LensFile,
    footprints: Footprints,
    camera: burst::SensorModel,
    seed: u64,
}

impl<F: Fn(f64) -> EnvMap> MovingView<F> {
    /// Creates a camera; `seed` is the seed of its noise. The radiance `brightest` reaches 0.9 of the largest code in the shortest exposure.
    #[must_use]
    pub fn new(scene: F, lens: LensFile, timing: Timing, sensor: Sensor, brightest: f64, seed: u64) -> Self {
        let shortest = timing.exposures.iter().copied().fold(f64::INFINITY, f64::min);
        let camera = burst::SensorModel::new(&lens, sensor, brightest * shortest / HEADROOM);
        let map = scene(0.0);
        let footprints = Footprints::new([map.width(), map.height()], &lens);
        Self { scene, timing, lens, footprints, camera, seed }
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

    /// Returns the index of the exposure of the frame with the number `frame`, counted from 0 over all bursts.
    #[must_use]
    pub fn index(&self, frame: usize) -> usize {
        let count = self.timing.exposures.len();
        let burst = frame / count;
        (0..count).find(|index| self.timing.frame(burst, *index) == frame).unwrap_or(0)
    }

    /// Returns the time at which the exposure of the frame with the number `frame` ends, seconds.
    #[must_use]
    pub fn end_s(&self, frame: usize) -> f64 {
        self.timing.end_s(frame / self.timing.exposures.len(), self.index(frame))
    }

    /// Returns the frame with the number `frame`.
    #[must_use]
    pub fn frame(&self, frame: usize) -> Frame {
        let seconds = self.timing.exposures[self.index(frame)];
        let map = self.mean(self.end_s(frame), seconds);
        let scene = burst::ExposedScene::of(self.footprints.radiance(&map));
        let codes = self.camera.record(&scene, seconds, &mut burst::noise(self.seed, frame));
        Frame { exposure: Exposure { seconds, gain: 1.0 }, pixels: self.camera.pixels(codes) }
    }

    /// Returns the mean radiance of the scene during an exposure of `seconds` that ends at `end_s`.
    fn mean(&self, end_s: f64, seconds: f64) -> EnvMap {
        let steps = (seconds / STEP_S).ceil().max(1.0) as usize;
        let at = |step: usize| end_s - seconds * (step as f64 + 0.5) / steps as f64;
        let mut mean = (self.scene)(at(0));
        for step in 1..steps {
            let map = (self.scene)(at(step));
            let part = 1.0 / (step + 1) as f32;
            let texels = mean.texels().iter().zip(map.texels());
            let texels = texels.map(|(a, b)| std::array::from_fn(|c| a[c] + part * (b[c] - a[c]))).collect();
            mean = EnvMap::new(map.width(), map.height(), texels);
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::stage::Stage;
    use crate::scenario::{Setting, bursts};
    use hemilux::calibration::Pixels;

    /// The mean of a linear function over an interval is its value in the middle.
    #[test]
    fn light_that_grows_has_in_each_frame_its_value_in_the_middle_of_the_exposure() {
        let size = Stage::new(&Setting::QUICK).room;
        let scene = |s: f64| EnvMap::from_fn(size.width(), size.height(), |_| [(1.0 + 10.0 * s) as f32; 3]);
        let exposures = vec![0.001, 0.005, 0.03];
        let timing = Timing { rate_hz: 30.0, exposures: exposures.clone(), line_s: 0.0, rotates: true };
        let sensor = Sensor { full_well: 0.0, ..bursts::SENSOR };
        let view = MovingView::new(scene, bursts::lens(), timing, sensor, 100.0, 1);
        let levels = view.calibration().levels;
        for (frame, index) in [0, 1, 2, 2, 0, 1, 1, 2, 0].into_iter().enumerate() {
            let seconds = exposures[index];
            assert_eq!(view.index(frame), index, "frame {frame}");
            let taken = view.frame(frame);
            assert_eq!(taken.exposure.seconds, seconds, "frame {frame}");
            let Pixels::U16(codes) = taken.pixels else { panic!("codes of 8 bits") };
            let middle = codes[3 * (96 * 192 + 96)];
            let radiance = 1.0 + 10.0 * ((frame + 1) as f64 / 30.0 - 0.5 * seconds);
            let share = radiance * seconds * HEADROOM / (100.0 * 0.001);
            let expected = levels.black + share * (levels.white - levels.black);
            assert!(
                (f64::from(middle) - expected).abs() <= 0.51,
                "frame {frame}: {middle}, expected {expected}"
            );
        }
    }
}
