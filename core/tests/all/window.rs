//! The sliding window against sums over pixels in `f64`, for still and moving lamps.

use crate::common::{off, plain};
use glam::{DVec2, DVec3};
use hemilux_core::format::Format;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::lens::{Lens, Model};
use hemilux_core::pyramid::Quad;
use hemilux_core::response::SATURATED;
use hemilux_core::{
    BurstError, Calibration, Exposure, FrontEnd, FrontError, NewFrame, Order, Response, Sizes, Window,
};

const SIDE: usize = 200;
const TIMES: [f64; 3] = [0.001, 0.006, 0.036];

/// Radiance that saturates the shortest exposure.
const FULL: f64 = 1000.0;

/// A camera of 200 x 200 pixels.
fn camera(format: Format, response: Response) -> Calibration {
    let lens = Lens::try_new(plain(Model::Equidistant, [99.5, 99.5], 66.0, 85.0)).expect("a sound lens");
    let mut camera = Calibration::try_new(lens, format, SIDE as u32, SIDE as u32).expect("a size");
    camera.response = response;
    camera.scale = FULL * TIMES[0];
    camera
}

fn exposures() -> [Exposure; 3] {
    TIMES.map(|seconds| Exposure { seconds, gain: 1.0 })
}

/// The direction and the solid angle of each pixel in the field of view.
fn pixels(lens: &Lens) -> impl Iterator<Item = (usize, DVec3, f64)> + '_ {
    (0..SIDE * SIDE).filter_map(|i| {
        let at = DVec2::new((i % SIDE) as f64, (i / SIDE) as f64);
        Some((i, lens.unproject(at)?, lens.solid_angle(at)?))
    })
}

/// A disc of light.
#[derive(Clone, Copy)]
struct Lamp {
    towards: DVec3,
    radius: f64,
    radiance: f64,
}

impl Lamp {
    fn at(theta_deg: f64, radius_deg: f64, radiance: f64) -> Self {
        let (sin, cos) = theta_deg.to_radians().sin_cos();
        Self { towards: DVec3::new(sin, 0.0, cos), radius: radius_deg.to_radians(), radiance }
    }

    fn covers(&self, towards: DVec3) -> bool {
        self.towards.dot(towards) > self.radius.cos()
    }
}

/// A room with coloured walls.
fn radiance(towards: DVec3, lamp: &Lamp) -> [f64; 3] {
    let wall = 2.0 + 1.5 * towards.x;
    if lamp.covers(towards) { [lamp.radiance; 3] } else { [wall, 0.8 * wall, 0.6 * wall] }
}

/// The code whose relative exposure, which ascends, is nearest to `y`.
fn code(response: &Response, y: f64) -> u8 {
    let exposure = |code: u8| response.exposure(1, f64::from(code) / 255.0);
    (0..=255).min_by(|a, b| (exposure(*a) - y).abs().total_cmp(&(exposure(*b) - y).abs())).expect("codes")
}

fn frame(camera: &Calibration, lamp: &Lamp, index: usize) -> Vec<u8> {
    let samples = if camera.layout.format() == Format::Grey { 1 } else { 3 };
    let mut codes = vec![0; samples * SIDE * SIDE];
    for (i, towards, _) in pixels(&camera.lens) {
        let light = radiance(towards, lamp).map(|l| (l / FULL * TIMES[index] / TIMES[0]).min(1.0));
        for (code_at, y) in codes[samples * i..].iter_mut().zip(&light[..samples]) {
            *code_at = code(&camera.response, *y);
        }
    }
    codes
}

struct Probe {
    camera: Calibration,
    front: FrontEnd<Vec<u64>>,
    window: Window<Vec<u64>>,
}

impl Probe {
    fn new(camera: Calibration) -> Self {
        let order = Order::try_new(5).expect("an order");
        let words = Sizes::of(&camera, &exposures(), order).expect("sizes").words();
        let mut front = FrontEnd::try_new(camera, &exposures(), order, vec![0; words]).expect("a front end");
        let words = front.window_words(&exposures()).expect("exposures");
        let window = front.window(&exposures(), vec![0; words]).expect("a window");
        Self { camera, front, window }
    }

    fn push(&mut self, lamp: &Lamp, index: usize) {
        let codes = frame(&self.camera, lamp, index);
        let frame = NewFrame { index, samples: codes.as_slice().into() };
        self.front.slide(&mut self.window, frame, || {}).expect("a frame");
    }

    /// Luminance energy within twice the radius of `lamp`.
    fn light_of(&self, lamp: &Lamp) -> f64 {
        let near = Lamp { radius: 2.0 * lamp.radius, ..*lamp };
        let order = self.front.order().get();
        let quads = self.front.map().quads_of(order);
        let quads = quads.iter().enumerate().filter(|(i, _)| near.covers(healpix::centre(order, *i as u32)));
        quads.map(|(_, quad)| f64::from(quad.y())).sum()
    }
}

/// Energy per texel of the source order: of each texel the longest exposure without a saturated code, of other texels the shortest.
fn twin(camera: &Calibration, lamp: &Lamp, order: u8) -> Vec<[f64; 3]> {
    let samples = if camera.layout.format() == Format::Grey { 1 } else { 3 };
    let texels = Domain::Hemisphere.quads(order);
    let mut sums = vec![[[0.0; 3]; 3]; texels];
    let mut is_clipped = vec![[false; 3]; texels];
    for (index, seconds) in TIMES.into_iter().enumerate() {
        let codes = frame(camera, lamp, index);
        for (i, towards, omega) in pixels(&camera.lens).filter(|(_, towards, _)| towards.z > 0.0) {
            let texel = healpix::ipix(order, towards) as usize;
            for c in 0..3 {
                let x = f64::from(codes[samples * i + c.min(samples - 1)]) / 255.0;
                sums[texel][index][c] += camera.response.exposure(c, x) * camera.scale / seconds * omega;
                is_clipped[texel][index] |= x >= SATURATED;
            }
        }
    }
    let chosen = is_clipped.iter().map(|clipped| (0..3).rev().find(|i| !clipped[*i]).unwrap_or(0));
    sums.iter().zip(chosen).map(|(sums, index)| sums[index]).collect()
}

#[test]
fn a_still_scene_takes_the_longest_exposure_that_is_not_clipped() {
    let lamps = [Lamp::at(40.0, 12.0, 0.7 * FULL), Lamp::at(20.0, 5.0, 0.1 * FULL)];
    for (format, response) in
        [(Format::Rgb24, Response::Linear), (Format::Rgb24, Response::Srgb), (Format::Grey, Response::Linear)]
    {
        let lamp = lamps[usize::from(response == Response::Srgb)];
        let mut probe = Probe::new(camera(format, response));
        (0..3).for_each(|index| probe.push(&lamp, index));
        assert!(probe.window.is_complete());
        let order = probe.front.source_order().get();
        let expected = twin(&probe.camera, &lamp, order);
        let found = probe.front.map();
        let (mut sum, mut all) = (0.0, 0.0);
        for (texel, (quad, expected)) in found.quads_of(order).iter().zip(&expected).enumerate() {
            for (v, expected) in quad.rgb().into_iter().zip(expected) {
                assert!(
                    off(f64::from(v), *expected) < 5e-3 || (f64::from(v) - expected).abs() < 1e-9,
                    "{format:?}, texel {texel}: {v}, expected {expected}"
                );
                (sum, all) = (sum + f64::from(v), all + expected);
            }
        }
        assert!(off(sum, all) < 2e-4, "{format:?}: {sum}, expected {all}");
    }
}

#[test]
fn a_lamp_that_every_exposure_measures_moves_with_each_frame() {
    let mut probe = Probe::new(camera(Format::Rgb24, Response::Linear));
    let lamp = |theta| Lamp::at(theta, 5.0, 25.0);
    (0..3).for_each(|index| probe.push(&lamp(0.0), index));
    let full = probe.light_of(&lamp(0.0));
    let dark = probe.light_of(&lamp(40.0));
    for (index, theta) in [(1, 20.0), (2, 40.0), (1, 60.0), (2, 20.0)] {
        let before = probe.light_of(&lamp(theta));
        probe.push(&lamp(theta), index);
        let found = probe.light_of(&lamp(theta));
        assert!(found > 0.9 * full && before < 0.75 * full, "{theta}: {found} of {full}, {before} before");
    }
    let left = probe.light_of(&lamp(40.0));
    assert!(off(left, dark) < 0.02, "the place it left: {left}, expected {dark}");
}

#[test]
fn a_lamp_that_only_the_shortest_exposure_measures_is_neither_lost_nor_shown_twice() {
    let mut probe = Probe::new(camera(Format::Rgb24, Response::Linear));
    let lamp = |theta| Lamp::at(theta, 3.0, 0.8 * FULL);
    (0..3).for_each(|index| probe.push(&lamp(0.0), index));
    let full = probe.light_of(&lamp(0.0));
    let wall = probe.light_of(&lamp(30.0));
    for index in [1, 2] {
        probe.push(&lamp(30.0), index);
        let (old, new) = (probe.light_of(&lamp(0.0)), probe.light_of(&lamp(30.0)));
        assert!(off(old, full) < 0.01, "exposure {index}: {old}, expected {full}");
        // Without its longer exposures, the wall has the quantisation of the shortest.
        assert!((new - wall).abs() < 0.01 * full, "exposure {index}: {new}, expected {wall}");
    }
    probe.push(&lamp(30.0), 0);
    let (old, new) = (probe.light_of(&lamp(0.0)), probe.light_of(&lamp(30.0)));
    let mut other = Probe::new(camera(Format::Rgb24, Response::Linear));
    (0..3).for_each(|index| other.push(&lamp(30.0), index));
    let expected = other.light_of(&lamp(30.0));
    assert!(off(new, expected) < 0.01 && old < 0.05 * full, "{old}, and {new}, expected {expected}");
}

#[test]
fn frames_that_do_not_fit_leave_the_map_unchanged() {
    let mut probe = Probe::new(camera(Format::Rgb24, Response::Linear));
    (0..3).for_each(|index| probe.push(&Lamp::at(0.0, 3.0, 100.0), index));
    let before: Vec<Quad> = probe.front.map().quads_of(5).to_vec();
    let codes = frame(&probe.camera, &Lamp::at(20.0, 3.0, 100.0), 2);
    for (index, len, expected) in [
        (3, codes.len(), BurstError::FrameCount { found: 4, expected: 3 }),
        (2, 7, BurstError::FrameSize { index: 0, found: 7, expected: codes.len() }),
    ] {
        let frame = NewFrame { index, samples: codes[..len].into() };
        let found = probe.front.slide(&mut probe.window, frame, || {});
        assert_eq!(found, Err(FrontError::Burst(expected)));
        assert_eq!(probe.front.map().quads_of(5), before);
    }
}
