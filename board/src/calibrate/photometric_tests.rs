//! Illuminance after a photometric calibration, on scenes whose light is known in closed form or by a sum over directions.

use super::factor::*;
use super::photometric::*;
use super::photometric_file::{KeepRefusal, Kept, KeptReadings, keep_reading};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::pipeline::{Pipeline, Settings};
use crate::recorded::{parse_photometric, radiometry};
use crate::scene::{self, Scene};
use crate::source::{PhotometricSource, Source, SourceError};
use glam::{DVec2, DVec3};
use hemilux_core::color::luminance;
use hemilux_core::lens::Lens;
use hemilux_core::{Exposure, Format};
use std::f64::consts::PI;

/// Lux per unit of relative irradiance of the light in these tests.
const TRUTH: f64 = 137.0;

const SIDE: usize = 480;

/// Radiance of a scene as a function of direction.
type RadianceOf = Box<dyn Fn(DVec3) -> f64 + Send>;

/// A 16-bit camera in a scene, with noise proportional to the value of each pixel.
struct SceneCamera {
    calibration: Calibration,
    light: RadianceOf,
    noise: f64,
    count: u64,
}

/// Returns a pseudo-random number from -1.73 to 1.73 of variance 1.
fn noise(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 12f64.sqrt()
}

impl SceneCamera {
    /// Creates a camera whose lens has a field of view of up to `degrees` from the axis.
    fn new(degrees: f64, noise: f64, light: RadianceOf) -> Self {
        let middle = SIDE as f64 / 2.0 - 0.5;
        let lens = Lens::equidistant([middle; 2], 0.96 * middle / degrees.to_radians(), degrees.to_radians());
        let calibration =
            Calibration::try_new(lens.expect("a lens"), Format::Rgb48, SIDE as u32, SIDE as u32);
        Self { calibration: calibration.expect("a layout"), light, noise, count: 0 }
    }

    fn scene(degrees: f64, noise: f64, name: &str) -> Self {
        let scene = scene::by_name(name).expect("a scene");
        Self::new(degrees, noise, Box::new(move |d| in_scene(&scene, d)))
    }
}

fn in_scene(scene: &Scene, d: DVec3) -> f64 {
    luminance(scene.radiance(d.as_vec3().to_array(), 0.0)).into()
}

impl Source for SceneCamera {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        [0.01, 0.1].map(|seconds| Exposure { seconds, gain: 1.0 }).to_vec()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        let lens = self.calibration.lens;
        self.count += 1;
        let seen: Vec<f64> = (0..SIDE * SIDE)
            .map(|i| {
                let at = DVec2::new((i % SIDE) as f64, (i / SIDE) as f64);
                let light = lens.unproject(at).map_or(0.0, |d| (self.light)(d));
                light * (1.0 + self.noise * noise(self.count << 32 | i as u64))
            })
            .collect();
        let frame = |exposure: Exposure| {
            let code = |v: &f64| [(v * exposure.seconds * 65_535.0).round().clamp(0.0, 65_535.0) as u16; 3];
            Frame { exposure, pixels: Pixels::U16(seen.iter().flat_map(code).collect()) }
        };
        burst.frames = self.exposures().into_iter().map(frame).collect();
        Ok(())
    }
}

/// Returns the irradiance of a level surface by the light from directions up to `degrees` from the zenith.
fn irradiance(light: &dyn Fn(DVec3) -> f64, degrees: f64) -> f64 {
    let (angles, azimuths) = (900, 900);
    let step = degrees.to_radians() / f64::from(angles);
    let mut sum = 0.0;
    for i in 0..angles {
        let theta = (f64::from(i) + 0.5) * step;
        for j in 0..azimuths {
            let phi = (f64::from(j) + 0.5) * 2.0 * PI / f64::from(azimuths);
            let d = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            sum += light(d) * theta.sin() * theta.cos();
        }
    }
    sum * step * 2.0 * PI / f64::from(azimuths)
}

fn truth(name: &str, degrees: f64) -> f64 {
    let scene = scene::by_name(name).expect("a scene");
    TRUTH * irradiance(&|d| in_scene(&scene, d), degrees)
}

/// Returns the illuminance and the uncertainty that a calibrated probe reports for a scene.
fn told(camera: SceneCamera, reading: &FactorReading) -> (f64, f64) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("p.toml");
    let digest = radiometry(&camera.calibration);
    keep_reading(&path, &Kept { reading, class: "any", camera: &digest }, false).expect("kept");
    let text = std::fs::read_to_string(&path).expect("a file");
    let photometric = parse_photometric(&path, &text, None).expect("a file").expect("a calibration");
    let mut source = PhotometricSource::new(Box::new(camera), photometric);
    let uncertainty = source.lux().expect("in lux").uncertainty;
    let mut burst = Burst::default();
    source.next(&mut burst).expect("a burst");
    let settings = Settings::default();
    let mut pipeline =
        Pipeline::try_new(*source.calibration(), &source.exposures(), settings).expect("a pipeline");
    let lux = luminance(pipeline.process(&burst).expect("a map").horizontal_irradiance);
    (lux.into(), uncertainty.into())
}

#[test]
fn direct_calibration_measures_other_scenes_within_one_per_cent() {
    for (first, lens) in [("room", 92.0), ("overcast", 92.0), ("sky", 92.0), ("overcast", 84.0)] {
        let method = Method::Direct { lux: truth(first, 90.0), unseen: Unseen::Rim };
        let reading =
            measure(&mut SceneCamera::scene(lens, 0.05, first), &method, 3, 0.01).expect("a reading");
        for second in scene::NAMES {
            let (lux, uncertainty) = told(SceneCamera::scene(lens, 0.05, second), &reading);
            let off = lux / truth(second, lens.min(90.0)) - 1.0;
            assert!(off.abs() < 0.01, "{first} to {second}, {lens} degrees: {off}, {reading:?}");
            assert!(off.abs() < uncertainty, "{first} to {second}: {off}, stated {uncertainty}");
        }
    }
}

/// With a lens of 160 degrees and a bright unseen horizon, the uncorrected factor is several per cent off.
#[test]
fn unseen_part_is_corrected_and_its_share_reported() {
    let method = |unseen| Method::Direct { lux: truth("overcast", 90.0), unseen };
    let measured = |unseen| measure(&mut SceneCamera::scene(75.0, 0.0, "overcast"), &method(unseen), 1, 0.01);
    let (rim, dark) = (measured(Unseen::Rim).expect("a reading"), measured(Unseen::Dark).expect("a reading"));
    assert!((rim.unseen - 15f64.to_radians().sin().powi(2)).abs() < 2e-3, "{rim:?}");
    assert!((rim.factor / TRUTH - 1.0).abs() < 0.02, "{rim:?}");
    assert!((rim.factor / TRUTH - 1.0).abs() < 2.0 * rim.own, "{rim:?}");
    assert!(dark.factor / TRUTH - 1.0 > 0.03, "{dark:?}");
}

/// The patch is a grey card of 20 degrees with known radiance; the other scene is dim and has another gradient.
#[test]
fn indirect_calibration_measures_other_scenes_within_three_per_cent() {
    let (reflectance, lux) = (0.18, 900.0);
    let card = reflectance * lux / PI / TRUTH;
    let towards = DVec3::new(0.5, 0.2, 0.8).normalize();
    let light = move |d: DVec3| {
        if d.dot(towards) > 10f64.to_radians().cos() { card } else { 0.1 + 0.2 * d.z.max(0.0) }
    };
    let mut camera = SceneCamera::new(92.0, 0.05, Box::new(light));
    let middle = camera.calibration.lens.project(towards).expect("in view");
    let corner = |i: i32| middle + 17.0 * DVec2::from_angle(f64::from(i) * PI / 3.0);
    let method = Method::Indirect { outline: (0..6).map(corner).collect(), reflectance, lux };
    let reading = measure(&mut camera, &method, 3, 0.015).expect("a reading");
    for name in scene::NAMES {
        let (found, uncertainty) = told(SceneCamera::scene(92.0, 0.05, name), &reading);
        let off = found / truth(name, 90.0) - 1.0;
        assert!(off.abs() < 0.03 && off.abs() < uncertainty, "{name}: {off}, stated {uncertainty}");
    }
}

#[test]
fn clipped_dark_and_small_patches_are_refused_in_one_line() {
    let direct = Method::Direct { lux: 100.0, unseen: Unseen::Rim };
    let refused = |camera: &mut SceneCamera, method: &Method, words: &str| {
        let line = measure(camera, method, 2, 0.0).expect_err(words).to_string();
        assert!(line.contains(words) && !line.contains('\n'), "{line}");
    };
    let bright = |d: DVec3| if d.z > 0.99 { 1e4 } else { 1.0 };
    refused(&mut SceneCamera::new(92.0, 0.0, Box::new(bright)), &direct, "clipped in the shortest exposure");
    refused(&mut SceneCamera::new(92.0, 0.0, Box::new(|_| 0.0)), &direct, "expected a lit scene");
    let square = |side: f64| {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let outline = corners.map(|c| DVec2::splat(239.5 - 0.5 * side) + side * DVec2::from(c)).to_vec();
        Method::Indirect { outline, reflectance: 0.5, lux: 100.0 }
    };
    refused(
        &mut SceneCamera::new(92.0, 0.0, Box::new(bright)),
        &square(40.0),
        "--patch: found pixels that clip",
    );
    refused(&mut SceneCamera::scene(92.0, 0.0, "room"), &square(2.0), "expected at least 12");
}

fn reading(factor: f64) -> FactorReading {
    FactorReading { method: "direct".into(), factor, own: 0.01, shared: 0.02, unseen: 0.0 }
}

#[test]
fn repeated_readings_reduce_all_uncertainty_but_the_meters() {
    let one = combine(&[reading(100.0)]).expect("a factor");
    assert!((one.uncertainty - 2.0 * 0.01f64.hypot(0.02)).abs() < 1e-9, "{one:?}");
    let four = combine(&[99.0, 101.0, 99.0, 101.0].map(reading)).expect("a factor");
    // The scatter of the four readings, 1.155 %, exceeds their own uncertainty of 1 %: the scatter divided by the root of 4 is expected.
    let expected = 2.0 * (0.5 * 0.01 * (4f64 / 3.0).sqrt()).hypot(0.02);
    assert!((four.factor - 100.0).abs() < 1e-9 && (four.uncertainty - expected).abs() < 1e-6, "{four:?}");
    assert_eq!(combine(&[]), None);
}

#[test]
fn readings_of_a_class_accumulate_in_the_file_and_outliers_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lens.toml");
    std::fs::write(&path, "# mine\nversion = 1\n[lens]\nmodel = \"equidistant\"\n").expect("a file");
    let keep = |factor, class, camera, fresh| {
        keep_reading(&path, &Kept { reading: &reading(factor), class, camera }, fresh)
    };
    assert_eq!(keep(100.0, "daylight", "a", false).expect("kept").count, 1);
    let KeptReadings { factor, count } = keep(102.0, "daylight", "a", false).expect("kept");
    assert_eq!((count, factor.factor), (2, 101.0));
    assert!(matches!(keep(130.0, "daylight", "a", false), Err(KeepRefusal::Far { .. })));
    assert_eq!(keep(130.0, "led", "a", false).expect("another class").count, 1);
    assert!(matches!(keep(100.0, "led", "b", false), Err(KeepRefusal::OtherCamera { .. })));
    let text = std::fs::read_to_string(&path).expect("a file");
    assert!(text.starts_with("# mine\n") && text.contains("[lens]"), "{text}");
    let led = parse_photometric(&path, &text, Some("led")).expect("a file").expect("a class");
    assert_eq!((led.factor, led.camera.as_str()), (130.0, "a"));
    assert_eq!(keep(100.0, "led", "b", true).expect("all of another camera are dropped").count, 1);
    let text = std::fs::read_to_string(&path).expect("a file");
    assert!(!text.contains("daylight"), "{text}");
}

#[test]
fn verdicts_follow_the_difference() {
    let verdicts = [0.0, -0.099, 0.11, -0.25, 0.26].map(Verdict::of);
    let expected = [Verdict::Good, Verdict::Good, Verdict::Fair, Verdict::Fair, Verdict::Reject];
    assert_eq!(verdicts, expected);
}
