//! A built-in scene before a simulated camera: bursts with noise and quantisation, which pass all stages of the pipeline.

use super::pace::Beat;
use super::sensor::Sensor;
use super::{Pace, Source, SourceError};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::clock;
use crate::exposure_plan::TimeRange;
use crate::scene::{Patch, Scene};
use glam::DVec2;
use hemilux_core::Exposure;
use hemilux_core::format::Format;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::mains::{Lamps, whole_periods};
use std::ops::Range;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const ROW: usize = 3 * WIDTH;

/// Focal length of the standard lens, and centre of its image, pixels.
const FOCAL: f64 = 196.4;
const CENTRE: (f64, f64) = (319.5, 239.5);

/// The exposure times of the bursts of [Nikodym2012], seconds.
pub(super) const SECONDS: [f64; 3] = [0.000_926, 0.005_555, 0.033_333];

/// Range of exposure times of the simulated sensor at 30 frames a second.
const RANGE: TimeRange = TimeRange { shortest_s: 30e-6, longest_s: SECONDS[2], step_s: 0.0 };

/// Radiance that saturates a pixel in the shortest exposure: above [`crate::scene::BRIGHTEST`] with the glow of lamps and noise.
const FULL: f64 = 60.0;

/// Renders a [`Scene`] as bursts of 640 x 480 RGB24 pixels through the standard lens of 160 x 140 degrees; a burst has three exposures unless
/// others are requested.
pub struct SceneSource {
    scene: Scene,
    calibration: Calibration,
    exposures: Vec<Exposure>,
    directions: Vec<[f32; 3]>,
    still: Vec<f32>,
    row: Vec<f32>,
    sensor: Sensor,
    /// Codes per unit of radiance, for each exposure of the burst.
    gains: Vec<f32>,
    lamps: Lamps,
    /// True if [`Source::set_exposures`] has replaced the exposures of the source.
    is_set: bool,
    beat: Beat,
    is_sliding: bool,
}

impl SceneSource {
    /// Creates the source of `scene` and renders the static field of the scene.
    #[must_use]
    pub fn new(scene: Scene, pace: Pace) -> Self {
        let calibration = calibration();
        let directions: Vec<_> = (0..WIDTH * HEIGHT).map(|i| direction(&calibration.lens, i)).collect();
        let seen = |d: &[f32; 3]| *d != [0.0; 3];
        let still = directions.iter().flat_map(|d| if seen(d) { scene.still(*d) } else { [0.0; 3] });
        Self {
            scene,
            exposures: SECONDS.iter().map(exposure).collect(),
            gains: SECONDS.iter().map(gain).collect(),
            still: still.collect(),
            row: vec![0.0; ROW],
            sensor: Sensor::new(),
            directions,
            calibration,
            lamps: Lamps::Auto,
            is_set: false,
            beat: Beat::new(pace),
            is_sliding: false,
        }
    }

    fn render(&mut self, number: u32, burst: &mut Burst) {
        let patches = self.scene.patches(self.beat.moment(number));
        let rows: [Range<usize>; 16] = std::array::from_fn(|i| patches.as_slice().get(i).map_or(0..0, rows));
        for y in 0..HEIGHT {
            self.row.copy_from_slice(&self.still[y * ROW..(y + 1) * ROW]);
            let touched = patches.as_slice().iter().zip(&rows).filter(|(_, rows)| rows.contains(&y));
            for (patch, _) in touched {
                paint(patch, &self.directions[y * WIDTH..(y + 1) * WIDTH], &mut self.row);
            }
            let stale = burst.stale;
            let frames = burst.frames.iter_mut().zip(&self.gains).enumerate();
            for (i, (frame, gain)) in frames.filter(|(i, _)| stale >> (i & 15) & 1 == 0) {
                let Pixels::U8(codes) = &mut frame.pixels else { continue };
                let seed = number.wrapping_mul(3).wrapping_add(i as u32).wrapping_mul(HEIGHT as u32);
                let codes = &mut codes[y * ROW..(y + 1) * ROW];
                self.sensor.expose(&self.row, *gain, seed.wrapping_add(y as u32), codes);
            }
        }
    }
}

impl Source for SceneSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.exposures.clone()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.is_set = seconds.is_some();
        let own = [SECONDS[0], SECONDS[1], whole_periods(SECONDS[2], self.lamps)];
        let seconds = seconds.unwrap_or(&own);
        self.exposures = seconds.iter().map(exposure).collect();
        self.gains = seconds.iter().map(gain).collect();
        Ok(())
    }

    fn set_lamps(&mut self, lamps: Lamps) {
        self.lamps = lamps;
        if !self.is_set {
            let _ = self.set_exposures(None);
        }
    }

    fn exposure_range(&self) -> Option<TimeRange> {
        Some(RANGE.of_whole_periods(self.lamps))
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        None
    }

    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        self.is_sliding = is_sliding;
        true
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        let number = self.beat.due()?;
        let is_same = burst.frames.iter().map(|frame| frame.exposure).eq(self.exposures.iter().copied());
        make_room(burst, &self.exposures);
        if self.is_sliding && is_same {
            burst.renew(number as usize % self.exposures.len().max(1));
        } else {
            burst.stale = 0;
        }
        burst.before_ns = clock::monotonic_ns();
        self.render(number, burst);
        burst.timestamp_ns = clock::monotonic_ns();
        Ok(())
    }
}

fn exposure(seconds: &f64) -> Exposure {
    Exposure { seconds: *seconds, gain: 1.0 }
}

/// Returns the codes per unit of radiance in an exposure of `seconds`.
fn gain(seconds: &f64) -> f32 {
    Sensor::gain(*seconds, FULL, SECONDS[0])
}

/// Resizes `burst` to one RGB24 frame per element of `exposures`; the memory of frames of the right size is reused.
fn make_room(burst: &mut Burst, exposures: &[Exposure]) {
    let fits = |f: &Frame| matches!(&f.pixels, Pixels::U8(codes) if codes.len() == ROW * HEIGHT);
    if burst.frames.len() != exposures.len() || !burst.frames.iter().all(fits) {
        let frame = |e: &Exposure| Frame { exposure: *e, pixels: Pixels::U8(vec![0; ROW * HEIGHT]) };
        burst.frames = exposures.iter().map(frame).collect();
    }
    for (frame, exposure) in burst.frames.iter_mut().zip(exposures) {
        frame.exposure = *exposure;
    }
}

/// Returns the calibration of the standard lens with a linear sensor of 8 bits.
pub(super) fn calibration() -> Calibration {
    let mut vignetting = [0.0; 8];
    vignetting[0] = 1.0;
    let lens = Lens::try_new(Intrinsics {
        model: Model::Equidistant,
        centre_px: DVec2::new(CENTRE.0, CENTRE.1),
        focal_px: DVec2::splat(FOCAL),
        skew_px: 0.0,
        max_theta: 80f64.to_radians(),
        vignetting,
    });
    let lens = lens.expect("the standard lens is a lens");
    let mut calibration = Calibration::try_new(lens, Format::Rgb24, WIDTH as u32, HEIGHT as u32)
        .expect("the standard size is a size");
    calibration.levels = Sensor::levels();
    calibration.scale = FULL * SECONDS[0];
    calibration
}

/// Returns the direction of the pixel with the index `index` as a unit vector; zero outside of the lens circle.
fn direction(lens: &Lens, index: usize) -> [f32; 3] {
    let pixel = DVec2::new((index % WIDTH) as f64, (index / WIDTH) as f64);
    lens.unproject(pixel).map_or([0.0; 3], |d| d.as_vec3().to_array())
}

/// Returns a range of image rows that contains all pixels that show `patch`.
///
/// An equidistant lens stretches by theta / sin(theta) across, so no point of a cap of radius a round theta lies farther from the image of
/// the cap's middle than f a (theta + a) / sin(theta + a).
fn rows(patch: &Patch) -> Range<usize> {
    let [x, y, z] = patch.direction.map(f64::from);
    let (across, radius) = (x.hypot(y), f64::from(patch.radius));
    let theta = across.atan2(z);
    let edge = theta + radius;
    if edge > 2.5 {
        return 0..HEIGHT;
    }
    let middle = CENTRE.1 + if across > 0.0 { FOCAL * theta * y / across } else { 0.0 };
    let reach = FOCAL * radius * edge / edge.sin() + 1.0;
    let row = |v: f64| (v.max(0.0) as usize).min(HEIGHT);
    row(middle - reach)..row(middle + reach + 1.0)
}

/// Paints `patch` over one row of radiances, whose pixels have the directions `directions`.
fn paint(patch: &Patch, directions: &[[f32; 3]], row: &mut [f32]) {
    let reach = patch.radius.cos();
    for (pixel, d) in row.chunks_exact_mut(3).zip(directions) {
        let p = patch.direction;
        if p[0] * d[0] + p[1] * d[1] + p[2] * d[2] > reach {
            pixel.copy_from_slice(&patch.over([pixel[0], pixel[1], pixel[2]], *d));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::{Pipeline, Settings};
    use crate::scene;

    fn source(name: &str) -> SceneSource {
        SceneSource::new(scene::by_name(name).expect("a scene"), Pace::Free)
    }

    #[test]
    fn bursts_are_equal_in_every_run_and_differ_within_a_run() {
        let (mut a, mut b) = (source("room"), source("room"));
        let (mut x, mut y) = (Burst::default(), Burst::default());
        for _ in 0..2 {
            a.next(&mut x).expect("a burst");
            b.next(&mut y).expect("a burst");
            assert_eq!(x.frames, y.frames, "two runs");
        }
        a.next(&mut x).expect("a burst");
        assert_ne!(x.frames, y.frames, "two moments");
    }

    /// The expected value is the sum of radiance times solid angle over the pixels, from the analytic scene and the lens's own solid angles.
    #[test]
    fn the_pipeline_measures_the_flux_of_the_scene_without_clipping() {
        for name in scene::NAMES {
            let mut source = source(name);
            let mut pipeline =
                Pipeline::try_new(*source.calibration(), &source.exposures(), Settings::default())
                    .expect("a pipeline");
            let mut burst = Burst::default();
            source.next(&mut burst).expect("a burst");
            let found = pipeline.process(&burst).expect("lights");
            assert_eq!(found.seen.clipped, 0.0, "{name}");
            let flux = flux(&source);
            for (c, expected) in flux.into_iter().enumerate() {
                let off = (f64::from(found.scalar_flux[c]) / expected - 1.0).abs();
                assert!(off < 2e-3, "{name}: {:?}, expected {flux:?}", found.scalar_flux);
            }
        }
    }

    fn flux(source: &SceneSource) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (i, d) in source.directions.iter().enumerate() {
            let pixel = DVec2::new((i % WIDTH) as f64, (i / WIDTH) as f64);
            let Some(omega) = source.calibration.lens.solid_angle(pixel) else { continue };
            let rgb = source.scene.radiance(*d, 0.0);
            (0..3).for_each(|c| sum[c] += f64::from(rgb[c]) * omega);
        }
        sum
    }

    #[test]
    fn a_patch_touches_no_row_outside_its_bounds() {
        let source = source("sky");
        for patch in source.scene.patches(3.0).as_slice() {
            let rows = rows(patch);
            let reach = patch.radius.cos();
            for (i, d) in source.directions.iter().enumerate() {
                let p = patch.direction;
                let inside = p[0] * d[0] + p[1] * d[1] + p[2] * d[2] > reach;
                assert!(!inside || rows.contains(&(i / WIDTH)), "row {} of {patch:?}", i / WIDTH);
            }
        }
    }
}
