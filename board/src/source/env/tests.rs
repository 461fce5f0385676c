use super::*;
use crate::maps::{Covers, write};
use crate::pipeline::{Pipeline, Settings};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Writes a map whose radiance is `radiance(theta, phi)` to `file`.
fn map(file: &Path, width: usize, covers: Covers, radiance: impl Fn(f64, f64) -> f32 + Sync) {
    let (height, lowest) = match covers {
        Covers::Sphere => (width / 2, PI),
        Covers::Hemisphere => (width / 4, FRAC_PI_2),
    };
    let texel = |row: usize, column: usize| {
        let theta = (row as f64 + 0.5) * lowest / height as f64;
        [radiance(theta, PI - (column as f64 + 0.5) * TAU / width as f64); 3]
    };
    std::fs::write(file, write::openexr(width, height, covers, texel).expect("a map")).expect("a file");
}

fn open(path: &Path, options: &str) -> EnvSource {
    let spec = EnvSpec::parse(&format!("{}{options}", path.display())).expect("a map");
    EnvSource::open(&spec, Pace::Free).expect("a source")
}

struct Found {
    flux: f64,
    horizontal: f64,
    clipped: f64,
    unseen: f64,
}

fn lights(source: &mut EnvSource) -> Found {
    let mut burst = Burst::default();
    source.next(&mut burst).expect("a burst");
    let (camera, exposures) = (*source.calibration(), source.exposures());
    let mut pipeline = Pipeline::try_new(camera, &exposures, Settings::default()).expect("a pipeline");
    let found = pipeline.process(&burst).expect("lights");
    Found {
        flux: f64::from(found.scalar_flux[1]),
        horizontal: f64::from(found.horizontal_irradiance[1]),
        clipped: found.seen.clipped,
        unseen: found.seen.unseen,
    }
}

fn near(found: f64, expected: f64, part: f64) {
    assert!((found / expected - 1.0).abs() < part, "{found}, expected {expected}");
}

#[test]
fn the_irradiance_of_a_uniform_map_is_pi_times_its_radiance() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, covers) in [("a.exr", Covers::Sphere), ("b.exr", Covers::Hemisphere)] {
        map(&folder.path().join(name), 256, covers, |_, _| 2.5);
        let found = lights(&mut open(&folder.path().join(name), ",view=whole"));
        near(found.horizontal, 2.5 * PI, 2e-3);
        near(found.flux, 2.5 * TAU, 5e-3);
        assert_eq!((found.clipped, found.unseen < 0.01), (0.0, true), "unseen {}", found.unseen);
    }
}

/// The sun is one texel of a fine map, 0.04 degrees wide: its energy must not depend on whether a sample of a pixel hits it.
#[test]
fn a_sun_of_one_texel_keeps_its_energy_in_both_views() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sun.exr");
    let texel = PI / 2048.0;
    for (theta, phi) in [(0.5, 0.3), (0.77, -1.234)] {
        let sun = |t: f64, p: f64| (t - theta).abs() < texel / 2.0 && (p - phi).abs() < texel / 2.0;
        map(&file, 4096, Covers::Sphere, |t, p| if sun(t, p) { 1e5 } else { 0.1 });
        let row = (theta / texel).floor();
        let omega = ((row * texel).cos() - ((row + 1.0) * texel).cos()) * texel;
        let (flux, ground) = (1e5 * omega, 0.1 * PI + 1e5 * omega * theta.cos());
        near(lights(&mut open(&file, ",view=whole")).horizontal, ground, 3e-3);
        let mut source = open(&file, "");
        let seen = lights(&mut source);
        near(seen.flux, flux + 0.1 * seen_solid_angle(&source), 5e-3);
        assert_eq!(seen.clipped, 0.0, "the sun does not clip");
    }
}

fn seen_solid_angle(source: &EnvSource) -> f64 {
    let (lens, layout) = (&source.calibration.lens, &source.calibration.layout);
    let pixel = |x, y| lens.solid_angle(DVec2::new(f64::from(x), f64::from(y))).unwrap_or(0.0);
    (0..layout.height()).flat_map(|y| (0..layout.width()).map(move |x| pixel(x, y))).sum()
}

#[test]
fn directions_are_those_of_the_map() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("lamp.exr");
    map(&file, 512, Covers::Sphere, |t, p| if (t - 0.6).hypot(p - 1.0) < 0.05 { 50.0 } else { 0.01 });
    for options in [",view=whole", ""] {
        let mut source = open(&file, options);
        let mut burst = Burst::default();
        source.next(&mut burst).expect("a burst");
        let settings = Settings { lights: 8, ..Settings::default() };
        let mut pipeline =
            Pipeline::try_new(source.calibration, &source.exposures(), settings).expect("a pipeline");
        let found = pipeline.process(&burst).expect("lights");
        let brightest =
            |a: &&hemilux_core::Light, b: &&hemilux_core::Light| a.irradiance[1].total_cmp(&b.irradiance[1]);
        let d = found.decomposition.lights.iter().max_by(brightest).expect("a light").direction;
        let (theta, phi) = (f64::from(d.z).acos(), f64::from(d.y).atan2(f64::from(d.x)));
        assert!((theta - 0.6).abs() < 0.03 && (phi - 1.0).abs() < 0.03, "{options}: {theta} {phi}");
    }
}

#[test]
fn a_folder_is_a_sequence_in_name_order_and_other_files_are_ignored() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, radiance) in [("b.exr", 2.0), ("a.EXR", 1.0), ("c.exr", 4.0)] {
        map(&folder.path().join(name), 64, Covers::Sphere, |_, _| radiance);
    }
    std::fs::write(folder.path().join("readme.txt"), "not a map").expect("a file");
    let mut source = open(folder.path(), ",view=whole");
    let found: Vec<_> = (0..4).map(|_| (lights(&mut source).horizontal / PI).round()).collect();
    assert_eq!(found, [1.0, 2.0, 4.0, 1.0]);
}

#[test]
fn each_map_stays_for_the_stated_time() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.exr", "b.exr"] {
        map(&folder.path().join(name), 16, Covers::Sphere, |_, _| 1.0);
    }
    let spec = EnvSpec::parse(&format!("{},every=1.5", folder.path().display())).expect("maps");
    assert_eq!(EnvSource::open(&spec, Pace::TEN_A_SECOND).expect("a source").stay, 15, "bursts");
}

#[test]
fn other_files_are_refused_on_one_line_that_names_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let (none, text) = (folder.path().join("none.exr"), folder.path().join("text.exr"));
    std::fs::write(&text, "not a map at all").expect("a file");
    for (path, named) in [(none.as_path(), "none.exr"), (&text, "text.exr")] {
        let spec = EnvSpec::parse(&path.display().to_string()).expect("a name");
        let error = EnvSource::open(&spec, Pace::Free).err().expect("refused").to_string();
        assert!(error.contains(named) && error.contains("expected") && !error.contains('\n'), "{error}");
    }
    std::fs::remove_file(text).expect("removed");
    let spec = EnvSpec::parse(&folder.path().display().to_string()).expect("a name");
    let error = EnvSource::open(&spec, Pace::Free).err().expect("refused").to_string();
    assert!(error.contains("a folder without maps"), "{error}");
}

#[test]
fn black_maps_give_no_lights_and_no_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("black.exr");
    map(&file, 64, Covers::Sphere, |_, _| 0.0);
    for options in ["", ",view=whole"] {
        let found = lights(&mut open(&file, options));
        assert!(found.flux.is_finite() && found.flux.abs() < 0.1, "{}", found.flux);
    }
}
