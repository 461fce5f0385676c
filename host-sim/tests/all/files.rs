//! Maps, pictures and lens files with properties of other programs' files: each is read with the expected value or refused by its path.

use crate::common::{root, sim, sim_ok, text};
use image::{ImageEncoder, Rgb, RgbImage};
use serde_json::Value;
use std::path::Path;

const LENS: &str = "[lens]\nmodel = \"equidistant\"\nsize = [64, 64]\ncentre = [31.5, 31.5]\nfocal = [20.0, 20.0]\nmax_angle_deg = 88.0\n";

/// Returns a picture of 64 x 64 pixels: a gradient and a bright disc, times `factor`.
fn scene(factor: f64, shift: usize) -> RgbImage {
    RgbImage::from_fn(64, 64, |x, y| {
        let (u, v) = ((x as usize + shift) % 64, (y as usize + shift) % 64);
        let disc = if u.abs_diff(44) < 8 && v.abs_diff(20) < 8 { 20.0 } else { 0.0 };
        let code = (factor * (1.0 + u as f64 / 32.0 + v as f64 / 64.0 + disc)).min(255.0);
        Rgb([code as u8; 3])
    })
}

fn burst_toml(frames: &[(&str, f64)]) -> String {
    let frames: String =
        frames.iter().map(|(file, s)| format!("[[frame]]\nfile = \"{file}\"\nexposure_s = {s}\n")).collect();
    format!("version = 1\n{LENS}{frames}")
}

fn set(arguments: &[&str]) -> Value {
    let line = sim_ok(arguments);
    serde_json::from_str(line.lines().next().expect("a line")).expect("JSON")
}

fn replay(folder: &Path, more: &[&str]) -> Value {
    set(&[&["replay", "--burst", text(folder), "--lights", "16"], more].concat())
}

fn flux(set: &Value) -> f64 {
    set["scalar_flux"][1].as_f64().expect("a flux")
}

/// Runs a command, which must end with the exit status 1 and one line on standard error that contains `part`.
fn refused(arguments: &[&str], part: &str) {
    let output = sim(arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {told}");
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.contains(part), "{part}: {told}");
}

/// Returns a JPEG file with an EXIF block of the entries (tag, type, value); times and f-numbers are in units of 1/100,000.
fn jpeg(image: &RgbImage, entries: &[(u16, u16, u32)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 100);
    encoder
        .write_image(image, image.width(), image.height(), image::ExtendedColorType::Rgb8)
        .expect("a JPEG");
    // The first directory contains the orientation and the offset of the second directory, which contains the exposure.
    let (first, second): (Vec<_>, Vec<_>) =
        entries.iter().copied().partition(|(tag, ..)| *tag == ORIENTATION);
    let mut tiff = b"MM\0\x2a\0\0\0\x08".to_vec();
    let second_at = 8 + 2 + 12 * (first.len() as u32 + 1) + 4;
    tiff.extend((first.len() as u16 + 1).to_be_bytes());
    first.iter().for_each(|(tag, _, value)| tiff.extend(entry(*tag, 3, *value << 16)));
    tiff.extend(entry(0x8769, 4, second_at));
    tiff.extend([0; 4]);
    let values_at = second_at + 2 + 12 * second.len() as u32 + 4;
    let mut values: Vec<u8> = Vec::new();
    tiff.extend((second.len() as u16).to_be_bytes());
    for (tag, kind, value) in second {
        if kind == 3 {
            tiff.extend(entry(tag, kind, value << 16));
        } else if kind == 4 {
            tiff.extend(entry(tag, kind, value));
        } else {
            tiff.extend(entry(tag, kind, values_at + values.len() as u32));
            values.extend([value.to_be_bytes(), 100_000u32.to_be_bytes()].concat());
        }
    }
    tiff.extend([0; 4]);
    tiff.extend(values);
    let length = (tiff.len() + 8) as u16;
    let app1 = [&[0xff, 0xe1][..], &length.to_be_bytes(), b"Exif\0\0", &tiff].concat();
    bytes.splice(2..2, app1);
    bytes
}

/// Returns the bytes of a directory entry of one value, big endian.
fn entry(tag: u16, kind: u16, value: u32) -> Vec<u8> {
    [&tag.to_be_bytes()[..], &kind.to_be_bytes(), &1u32.to_be_bytes(), &value.to_be_bytes()].concat()
}

const ORIENTATION: u16 = 0x0112;
const EXPOSURE_TIME: u16 = 0x829a;
const F_NUMBER: u16 = 0x829d;
const ISO: u16 = 0x8827;
const EXPOSURE_INDEX: u16 = 0x8832;
const SHUTTER_SPEED: u16 = 0x9201;
const APERTURE: u16 = 0x9202;
const FLASH: u16 = 0x9209;
const COLOUR_SPACE: u16 = 0xa001;

/// Asserts that two sets have equal lights: components of directions within 1e-4, channels of irradiance within 1e-4 of the light's irradiance.
fn assert_same_lights(direct: &Value, back: &Value, name: &str) {
    assert!((flux(back) / flux(direct) - 1.0).abs() < 1e-4, "{name}: {} {}", flux(back), flux(direct));
    let [a, b] = [direct, back].map(|set| set["lights"].as_array().expect("lights"));
    assert_eq!(a.len(), b.len(), "{name}");
    for (a, b) in a.iter().zip(b) {
        for (key, least) in [("direction", 1.0), ("irradiance", 0.0)] {
            let [a, b]: [[f64; 3]; 2] =
                [a, b].map(|light| std::array::from_fn(|i| light[key][i].as_f64().expect("a number")));
            let size = a.iter().copied().fold(least, f64::max);
            let off = a.iter().zip(b).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max);
            assert!(off < 1e-4, "{name}: {key} {b:?}, expected {a:?}, off by {off}");
        }
    }
}

#[test]
fn written_hemisphere_maps_are_read_as_hemispheres() {
    let folder = tempfile::tempdir().expect("a folder");
    let (room, map) = (folder.path().join("room.exr"), folder.path().join("map.exr"));
    crate::common::write_room(&room);
    let decompose = |more: &[&str], sampling: &[&str]| {
        let hemisphere = ["decompose", "--env", text(&room), "--hemisphere", "--map", text(&map)];
        let command = if more.is_empty() { &hemisphere[..] } else { more };
        set(&[command, sampling].concat())
    };
    for sampling in [
        &["--sampler", "q2tree", "--lights", "32"][..],
        &["--sampler", "adaptive", "--lights", "4"],
        &["--sampler", "adaptive", "--lights", "64"],
        &["--sampler", "adaptive", "--lights", "64", "--ambient"],
        &["--sampler", "adaptive", "--lights", "16", "--soft"],
        &["--sampler", "adaptive", "--lights", "64", "--soft"],
        &["--sampler", "adaptive", "--lights", "200"],
    ] {
        let direct = decompose(&[], sampling);
        let back = decompose(&["decompose", "--env", text(&map)], sampling);
        assert_same_lights(&direct, &back, &format!("{sampling:?}"));
    }
    let direct = decompose(&[], &["--lights", "32"]);
    let back = decompose(&["decompose", "--env", text(&map)], &["--lights", "32"]);
    let json = folder.path().join("set.json");
    std::fs::write(&json, direct.to_string()).expect("a file");
    let score: Value =
        serde_json::from_str(&sim_ok(&["score", "--env", text(&map), "--set", text(&json)])).expect("JSON");
    let expected: Value =
        serde_json::from_str(&sim_ok(&["score", "--env", text(&room), "--set", text(&json), "--hemisphere"]))
            .expect("JSON");
    for key in ["open", "shadowed", "energy"] {
        let (a, b) = (score[key].as_f64().expect("a score"), expected[key].as_f64().expect("a score"));
        assert!((a - b).abs() < 1e-4, "{key}: {a} {b}");
    }
    let sphere = set(&["decompose", "--env", text(&map), "--sphere", "--lights", "16"]);
    assert!(flux(&sphere) > 1.5 * flux(&back), "--sphere has precedence: {} {}", flux(&sphere), flux(&back));
}

#[test]
fn written_real_maps_have_the_lights_of_the_originals() {
    let Some(maps) = crate::common::shared("hdri") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let written = folder.path().join("map.exr");
    for file in std::fs::read_dir(maps).expect("a folder") {
        let path = file.expect("a file").path();
        if path.extension().is_none_or(|extension| extension != "exr") {
            continue;
        }
        for (part, sampling) in [
            (&["--hemisphere"][..], &["--lights", "64"][..]),
            (&["--hemisphere"], &["--lights", "16", "--soft"]),
            (&[], &["--lights", "64", "--ambient"]),
            (&[], &["--lights", "200", "--soft"]),
        ] {
            let read = ["decompose", "--env", text(&path), "--map", text(&written)];
            let direct = set(&[&read, part, sampling].concat());
            let back = set(&[&["decompose", "--env", text(&written)], sampling].concat());
            assert_same_lights(&direct, &back, &format!("{} {part:?} {sampling:?}", path.display()));
        }
    }
}

#[test]
fn written_maps_of_a_replay_have_the_lights_of_the_burst() {
    let folder = tempfile::tempdir().expect("a folder");
    let (room, burst, map) =
        (folder.path().join("room.exr"), folder.path().join("b"), folder.path().join("map.exr"));
    crate::common::write_room(&room);
    let lens = root().join("fixtures/lens-184.toml");
    sim_ok(&["burst", "--env", text(&room), "--lens", text(&lens), "--out", text(&burst)]);
    let direct = set(&["replay", "--burst", text(&burst), "--lights", "64", "--map", text(&map)]);
    let back = set(&["decompose", "--env", text(&map), "--lights", "64"]);
    assert!((flux(&back) / flux(&direct) - 1.0).abs() < 1e-4, "{} {}", flux(&back), flux(&direct));
    let json = folder.path().join("set.json");
    std::fs::write(&json, direct.to_string()).expect("a file");
    let score: Value =
        serde_json::from_str(&sim_ok(&["score", "--env", text(&map), "--set", text(&json)])).expect("JSON");
    assert!(score["shadowed"].as_f64().expect("a score") < 0.05, "{score}");
}

#[test]
fn clipped_texels_are_counted_in_the_set() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = folder.path().join("sun.exr");
    exr::prelude::write_rgb_file(
        &map,
        64,
        32,
        |x, _| if x < 16 { (2e12f32, 0.5, 0.5) } else { (0.5, 0.5, 0.5) },
    )
    .expect("a map");
    let clipped =
        set(&["decompose", "--env", text(&map), "--lights", "16"])["clipped"].as_f64().expect("a number");
    assert!((clipped - 0.25).abs() < 1e-3, "a quarter of the sphere: {clipped}");
    exr::prelude::write_rgb_file(&map, 64, 32, |x, y| {
        if (x, y) == (40, 8) { (300_000f32, 280_000.0, 250_000.0) } else { (0.5, 0.5, 0.5) }
    })
    .expect("a map");
    let sun = set(&["decompose", "--env", text(&map), "--lights", "16"]);
    // The flux of the background, 4 pi 0.5, and the texel's solid angle times its radiance.
    let omega = ((8f64 / 32.0 * std::f64::consts::PI).cos() - (9f64 / 32.0 * std::f64::consts::PI).cos())
        * std::f64::consts::TAU
        / 64.0;
    let expected = std::f64::consts::TAU + omega * (280_000.0 - 0.5);
    assert!((flux(&sun) / expected - 1.0).abs() < 1e-4, "{} {expected}", flux(&sun));
    assert_eq!(sun["clipped"].as_f64(), Some(0.0), "nothing is clipped");
}

#[test]
fn pgm_samples_are_codes_up_to_their_maxval() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, maxval: u32, white: &str, bytes: Vec<u8>| {
        let to = folder.path().join(name);
        std::fs::create_dir_all(&to).expect("a folder");
        let header = format!("P5\n# a comment\n64 64\n{maxval}\n").into_bytes();
        std::fs::write(to.join("f.pgm"), [header, bytes].concat()).expect("a file");
        std::fs::write(to.join("burst.toml"), format!("{}{white}", burst_toml(&[("f.pgm", 0.01)])))
            .expect("a file");
        to
    };
    let codes: Vec<u16> = (0..64 * 64u16).collect();
    let big: Vec<u8> = codes.iter().flat_map(|c| c.to_be_bytes()).collect();
    let stated = write("stated", 4095, "[sensor]\nwhite = 4095\n", big.clone());
    let default = write("default", 4095, "", big);
    let sixteen = write(
        "sixteen",
        65535,
        "[sensor]\nwhite = 4095\n",
        codes.iter().flat_map(|c| c.to_be_bytes()).collect(),
    );
    let expected = flux(&replay(&sixteen, &[]));
    for (name, folder) in [("stated", stated), ("default", default)] {
        let found = flux(&replay(&folder, &[]));
        assert!((found / expected - 1.0).abs() < 1e-3, "{name}: {found}, expected {expected}");
    }
    let beyond = write("beyond", 4095, "[sensor]\nwhite = 65535\n", vec![0; 8192]);
    refused(&["replay", "--burst", text(&beyond)], "white <= 4095");
}

#[test]
fn exif_orientation_is_applied() {
    let folder = tempfile::tempdir().expect("a folder");
    let upright = scene(8.0, 0);
    let turned = image::imageops::rotate180(&upright);
    let write = |name: &str, files: &[(&str, Vec<u8>)]| {
        let to = folder.path().join(name);
        std::fs::create_dir_all(&to).expect("a folder");
        files.iter().for_each(|(file, bytes)| std::fs::write(to.join(file), bytes).expect("a file"));
        let frames: Vec<_> = files.iter().map(|(file, _)| (*file, 0.01)).collect();
        std::fs::write(to.join("burst.toml"), burst_toml(&frames)).expect("a file");
        to
    };
    let (a, b) = (jpeg(&upright, &[(ORIENTATION, 3, 1)]), jpeg(&turned, &[(ORIENTATION, 3, 3)]));
    let mean = |set: &Value| -> [f64; 3] {
        let lights = set["lights"].as_array().expect("lights");
        let of = |l: &Value, key: &str, i: usize| l[key][i].as_f64().expect("a number");
        [0, 1, 2].map(|i| lights.iter().map(|l| of(l, "direction", i) * of(l, "irradiance", 1)).sum())
    };
    let alone = mean(&replay(&write("alone", &[("a.jpg", a.clone())]), &[]));
    let both = mean(&replay(&write("both", &[("a.jpg", a.clone()), ("b.jpg", b)]), &[]));
    for (found, expected) in both.iter().zip(alone) {
        assert!((found - expected).abs() < 0.01 * alone[2].abs(), "{both:?}, expected {alone:?}");
    }
    let cut = write("cut", &[("a.jpg", a[..a.len() * 2 / 3].to_vec())]);
    refused(&["replay", "--burst", text(&cut)], "ends early");
}

#[test]
fn frames_that_contradict_their_neighbours_are_left_out_and_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, images: [RgbImage; 3]| {
        let to = folder.path().join(name);
        std::fs::create_dir_all(&to).expect("a folder");
        for (image, file) in images.iter().zip(["a.png", "b.png", "c.png"]) {
            image.save(to.join(file)).expect("a picture");
        }
        std::fs::write(
            to.join("burst.toml"),
            burst_toml(&[("a.png", 0.0025), ("b.png", 0.005), ("c.png", 0.01)]),
        )
        .expect("a file");
        to
    };
    let sound = [scene(6.0, 0), scene(12.0, 0), scene(24.0, 0)];
    let expected = replay(&write("sound", sound.clone()), &[]);
    assert!(expected.get("frames_left_out").is_none(), "a sound burst");
    let black = RgbImage::new(64, 64);
    let white = RgbImage::from_pixel(64, 64, Rgb([255; 3]));
    for (name, index, image, file, why) in [
        ("black longest", 2, black.clone(), "c.png", "black"),
        ("black middle", 1, black, "b.png", "black"),
        ("white shortest", 0, white, "a.png", "saturated"),
        ("moved middle", 1, scene(12.0, 24), "b.png", "other-scene"),
    ] {
        let mut images = sound.clone();
        images[index] = image;
        let found = replay(&write(name, images), &[]);
        let left_out = serde_json::json!([{"index": index, "why": why, "file": file}]);
        assert_eq!(found["frames_left_out"], left_out, "{name}");
        assert!(
            (flux(&found) / flux(&expected) - 1.0).abs() < 0.06,
            "{name}: {} {}",
            flux(&found),
            flux(&expected)
        );
    }
}

#[test]
fn photographs_with_exif_data_are_imported_as_a_burst() {
    let folder = tempfile::tempdir().expect("a folder");
    let (photos, lens, out) =
        (folder.path().join("photos"), folder.path().join("lens.toml"), folder.path().join("out"));
    std::fs::create_dir_all(&photos).expect("a folder");
    std::fs::write(&lens, format!("{LENS}[response]\nmodel = \"linear\"\n")).expect("a file");
    // Exposures of 1/400 s, 1/100 s, and 1/100 s at ISO 400 have the ratios 1, 4 and 16.
    for (file, factor, time, iso) in
        [("x.jpg", 32.0, 1000, 400), ("y.jpg", 2.0, 250, 100), ("z.jpg", 8.0, 1000, 100)]
    {
        let entries = [(EXPOSURE_TIME, 5, time), (F_NUMBER, 5, 280_000), (ISO, 3, iso)];
        std::fs::write(photos.join(file), jpeg(&scene(factor, 0), &entries)).expect("a file");
    }
    let files = ["x.jpg", "y.jpg", "z.jpg"].map(|f| photos.join(f));
    let mut arguments = vec!["import", "--lens", text(&lens), "--out", text(&out)];
    arguments.extend(files.iter().map(|f| text(f)));
    sim_ok(&arguments);
    let manifest: toml::Table =
        std::fs::read_to_string(out.join("burst.toml")).expect("a manifest").parse().expect("TOML");
    let frames = manifest["frame"].as_array().expect("frames");
    let told: Vec<_> = frames
        .iter()
        .map(|f| (f["file"].as_str(), f["exposure_s"].as_float(), f["gain"].as_float()))
        .collect();
    let expected = [("y.jpg", 0.0025, 1.0), ("z.jpg", 0.01, 1.0), ("x.jpg", 0.01, 4.0)];
    assert_eq!(told, expected.map(|(f, s, g)| (Some(f), Some(s), Some(g))), "ascending exposures");
    let imported = flux(&replay(&out, &[]));
    let direct = flux(&replay(&photos, &["--lens", text(&lens)]));
    assert_eq!(imported, direct, "without a burst.toml");
    for (file, bytes) in [("._x.jpg", &b"\0\x05\x16\x07"[..]), ("x.dng", b"II*\0"), ("z.DNG", b"II*\0")] {
        std::fs::write(photos.join(file), bytes).expect("a file");
    }
    let beside = flux(&replay(&photos, &["--lens", text(&lens)]));
    assert_eq!(beside, direct, "hidden files and the raw files of photographs are ignored");
    refused(&["replay", "--burst", text(&photos)], "hemilux-sim import");
    let untimed = photos.join("w.jpg");
    std::fs::write(&untimed, jpeg(&scene(2.0, 0), &[(ISO, 3, 100)])).expect("a file");
    refused(&["import", "--lens", text(&lens), "--out", text(&out), text(&untimed)], "exposure time");
    std::fs::write(photos.join("w.dng"), b"II*\0........").expect("a file");
    refused(&["import", "--lens", text(&lens), "--out", text(&out), text(&photos.join("w.dng"))], "w.dng");
}

/// Returns the arguments of an import of one photograph.
fn import(folder: &Path, photo: &Path) -> Vec<String> {
    let lens = folder.join("lens.toml");
    std::fs::write(&lens, LENS).expect("a file");
    let out = folder.join("out");
    ["import", "--lens", text(&lens), "--out", text(&out), text(photo)].map(Into::into).to_vec()
}

#[test]
fn colour_spaces_of_photographs_are_applied_or_refused_by_name() {
    use moxcms::ColorProfile;
    let folder = tempfile::tempdir().expect("a folder");
    let photo = folder.path().join("a.jpg");
    let mut linear = ColorProfile::new_srgb();
    let line = moxcms::curve_from_gamma(1.0);
    (linear.red_trc, linear.green_trc, linear.blue_trc) =
        (Some(line.clone()), Some(line.clone()), Some(line));
    for (profile, expected) in [
        (ColorProfile::new_srgb(), Ok("srgb")),
        (linear, Ok("linear")),
        (ColorProfile::new_display_p3(), Err("other primaries")),
        (ColorProfile::new_adobe_rgb(), Err("other primaries")),
        (ColorProfile::new_bt2020_pq(), Err("ICC profile")),
    ] {
        let icc = profile.encode().expect("a profile");
        let mut bytes = jpeg(&scene(2.0, 0), &[(EXPOSURE_TIME, 5, 1000)]);
        let header = [b"ICC_PROFILE\0\x01\x01".as_slice(), &icc].concat();
        let segment = [&[0xff, 0xe2], &(header.len() as u16 + 2).to_be_bytes()[..], &header].concat();
        bytes.splice(2..2, segment);
        std::fs::write(&photo, bytes).expect("a file");
        let arguments = import(folder.path(), &photo);
        let mut arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        match expected {
            Err(part) => {
                refused(&arguments, part);
                arguments.push("--ignore-profile");
                sim_ok(&arguments);
            }
            Ok(model) => {
                sim_ok(&arguments);
                let manifest =
                    std::fs::read_to_string(folder.path().join("out/burst.toml")).expect("a manifest");
                assert!(manifest.contains(&format!("model = \"{model}\"")), "{model}: {manifest}");
            }
        }
    }
}

#[test]
fn exposures_in_apex_units_and_in_fields_of_large_numbers_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let photo = folder.path().join("a.jpg");
    let read = |entries: &[(u16, u16, u32)]| {
        std::fs::write(&photo, jpeg(&scene(2.0, 0), entries)).expect("a file");
        let arguments = import(folder.path(), &photo);
        let output = sim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    // The photograph states an exposure time of 2^-7 s, the f-number 2^(4 / 2) and ISO 102400.
    let told = read(&[
        (SHUTTER_SPEED, 5, 700_000),
        (APERTURE, 5, 400_000),
        (ISO, 3, 65_535),
        (EXPOSURE_INDEX, 4, 102_400),
    ]);
    for part in ["0.007812", "102400", "      4  "] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let told = read(&[(EXPOSURE_TIME, 5, 1000), (ISO, 3, 65_535)]);
    assert!(told.contains("PhotographicSensitivity 65535"), "{told}");
    let told = read(&[(EXPOSURE_TIME, 5, 1000), (COLOUR_SPACE, 3, 2)]);
    assert!(told.contains("Adobe RGB"), "{told}");
    let told = read(&[(EXPOSURE_TIME, 5, 1000), (APERTURE, 5, 400_000_000)]);
    assert!(told.contains("found ApertureValue 4000, expected an APEX value"), "{told}");
}

#[test]
fn photographs_of_another_size_than_the_lens_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let photo = folder.path().join("a.jpg");
    let small = image::imageops::thumbnail(&scene(2.0, 0), 32, 48);
    std::fs::write(&photo, jpeg(&small, &[(EXPOSURE_TIME, 5, 1000)])).expect("a file");
    let arguments = import(folder.path(), &photo);
    refused(
        &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
        "found 32 x 48 pixels, expected 64 x 64",
    );
}

#[test]
fn photographs_that_state_different_fields_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let other = folder.path().join("a.jpg");
    let photo = folder.path().join("b.jpg");
    std::fs::write(&other, jpeg(&scene(2.0, 0), &[(EXPOSURE_TIME, 5, 1000), (ISO, 3, 100)])).expect("a file");
    for (entries, part) in [
        (vec![(EXPOSURE_TIME, 5, 4000)], "the ISO sensitivity"),
        (vec![(EXPOSURE_TIME, 5, 4000), (ISO, 3, 100), (FLASH, 3, 1)], "the flash"),
    ] {
        std::fs::write(&photo, jpeg(&scene(8.0, 0), &entries)).expect("a file");
        let mut arguments = import(folder.path(), &other);
        arguments.push(text(&photo).into());
        refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), part);
    }
}

#[test]
fn measured_exposures_replace_wrong_stated_exposures() {
    let folder = tempfile::tempdir().expect("a folder");
    // The disc is clipped in the longer exposure, so that its radiance is measured in the shorter exposure.
    for (file, factor) in [("a.png", 8.0), ("b.png", 16.0)] {
        scene(factor, 0).save(folder.path().join(file)).expect("a picture");
    }
    // The ratio of the stated times is 4, the ratio in the pixels is 2.
    std::fs::write(folder.path().join("burst.toml"), burst_toml(&[("a.png", 0.0025), ("b.png", 0.01)]))
        .expect("a file");
    let (stated, measured) =
        (replay(folder.path(), &[]), replay(folder.path(), &["--exposures", "measured"]));
    let advice = |more: &[&str]| {
        let output = sim(&[&["replay", "--burst", text(folder.path())], more].concat());
        String::from_utf8_lossy(&output.stderr).contains("use --exposures measured")
    };
    assert!(advice(&[]), "the wrong times are reported");
    std::fs::write(folder.path().join("burst.toml"), burst_toml(&[("a.png", 0.005), ("b.png", 0.01)]))
        .expect("a file");
    let right = flux(&replay(folder.path(), &[]));
    assert!(!advice(&[]), "the right times are not reported");
    assert!((flux(&measured) / right - 1.0).abs() < 0.01, "{} {right}", flux(&measured));
    assert!((flux(&stated) / right - 1.0).abs() > 0.05, "{} {right}", flux(&stated));
}

#[test]
fn measured_exposures_keep_a_frame_whose_stated_time_is_out_of_order() {
    let folder = tempfile::tempdir().expect("a folder");
    for (file, factor) in [("a.png", 4.0), ("b.png", 8.0), ("c.png", 16.0)] {
        scene(factor, 0).save(folder.path().join(file)).expect("a picture");
    }
    let replayed = |times: [f64; 3], more: &[&str]| {
        let frames = [("a.png", times[0]), ("b.png", times[1]), ("c.png", times[2])];
        std::fs::write(folder.path().join("burst.toml"), burst_toml(&frames)).expect("a file");
        replay(folder.path(), more)
    };
    let right = flux(&replayed([0.0025, 0.005, 0.01], &[]));
    for lies in [[0.0025, 0.00005, 0.01], [0.5, 0.005, 0.01], [0.0025, 0.005, 0.0001]] {
        let set = replayed(lies, &["--exposures", "measured"]);
        assert!(set["frames_left_out"].as_array().is_none_or(Vec::is_empty), "{lies:?}: {set}");
        assert!((flux(&set) / right - 1.0).abs() < 0.01, "{lies:?}: {} {right}", flux(&set));
    }
    RgbImage::new(64, 64).save(folder.path().join("b.png")).expect("a picture");
    let set = replayed([0.0025, 0.005, 0.01], &["--exposures", "measured"]);
    assert_eq!(set["frames_left_out"][0]["why"], "black", "{set}");
    assert!((flux(&set) / right - 1.0).abs() < 0.03, "{} {right}", flux(&set));
}

#[test]
fn jpeg_files_with_damaged_blocks_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = jpeg(&scene(8.0, 0), &[]);
    std::fs::write(folder.path().join("burst.toml"), burst_toml(&[("a.jpg", 0.01)])).expect("a file");
    let burst = ["replay", "--burst", text(folder.path())];
    let write = |bytes: &[u8]| std::fs::write(folder.path().join("a.jpg"), bytes).expect("a file");
    write(&whole);
    replay(folder.path(), &[]);
    let scan = whole.windows(2).position(|w| w == [0xff, 0xda]).expect("a scan") + 14;
    // The file lacks the second half of the blocks and has its end marker.
    let half = (scan + whole.len()) / 2;
    write(&[&whole[..half], &[0xff, 0xd9]].concat());
    refused(&burst, "damaged blocks");
    let mut zeroed = whole.clone();
    zeroed[half..whole.len() - 2].fill(0);
    write(&zeroed);
    refused(&burst, "damaged blocks");
    // The frame header contains height and width.
    let mut huge = whole.clone();
    let frame = whole.windows(2).position(|w| w == [0xff, 0xc0]).expect("a frame");
    huge[frame + 5..frame + 9].fill(0xfe);
    write(&huge);
    refused(&burst, "65278 x 65278 pixels in a file of");
    huge[frame + 1] = 0xc2;
    write(&huge);
    refused(&burst, "65278 x 65278 pixels in a file of");
}

#[test]
fn headers_with_more_pixels_than_the_file_can_hold_are_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let map = folder.path().join("map");
    for (name, bytes) in [
        ("hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 80000\n".to_vec()),
        ("pfm", b"PF\n80000 40000\n-1.0\n".to_vec()),
        (
            "old runs",
            [b"#?RADIANCE\n\n-Y 1 +X 4000000000\n".to_vec(), [[9, 9, 9, 128], [1, 1, 1, 255]].concat()]
                .concat(),
        ),
    ] {
        std::fs::write(&map, bytes).expect(name);
        refused(&["decompose", "--env", text(&map)], "--max-pixels");
    }
    std::fs::write(folder.path().join("burst.toml"), burst_toml(&[("a.pgm", 0.01)])).expect("a file");
    std::fs::write(folder.path().join("a.pgm"), b"P5\n60000 60000\n65535\n").expect("a file");
    refused(&["replay", "--burst", text(folder.path())], "at most");
}

#[test]
fn opencv_calibration_files_are_accepted_as_lens_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let (opencv, lens) = (folder.path().join("lens.yml"), folder.path().join("lens.toml"));
    std::fs::write(&opencv, "%YAML:1.0\n---\nimage_width: 64\nimage_height: 64\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 20., 0., 31.5, 0., 20., 31.5, 0., 0., 1. ]\nD: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ 0., 0., 0., 0. ]\n").expect("a file");
    std::fs::write(&lens, LENS.replace("88.0", "90.0")).expect("a file");
    let record = |lens: &Path, out: &str| {
        let out = folder.path().join(out);
        sim_ok(&["burst", "--env", "scene:room", "--lens", text(lens), "--out", text(&out)]);
        std::fs::read(out.join("frame-1.png")).expect("a frame")
    };
    assert_eq!(record(&opencv, "a"), record(&lens, "b"), "equal bursts");
    refused(
        &[
            "burst",
            "--env",
            "scene:room",
            "--lens",
            text(&folder.path().join("a/frame-0.png")),
            "--out",
            "/dev/null/x",
        ],
        "frame-0.png",
    );
}
