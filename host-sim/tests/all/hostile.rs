//! Invalid input files: one line with the path on standard error, exit status 1, no panic.

use crate::common::{sim, text};
use std::path::Path;

const LENS: &str =
    "[lens]\nmodel = \"equidistant\"\ncentre = [7.5, 7.5]\nfocal = [5.0, 5.0]\nmax_angle_deg = 80.0\n";
const FRAME: &str = "[[frame]]\nfile = \"a.png\"\nexposure_s = 0.01\n";

/// Returns the text of a burst.toml in which `replace` replaces `what`.
fn manifest(what: &str, replace: &str) -> String {
    let sound = format!("version = 1\n{LENS}{FRAME}");
    assert!(sound.contains(what), "{what:?} is not in the manifest");
    sound.replace(what, replace)
}

fn png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(width, height, image::Rgb([90, 80, 70]))
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("a picture");
    bytes.into_inner()
}

fn half(bytes: &[u8]) -> Vec<u8> {
    bytes[..bytes.len() / 2].to_vec()
}

/// Runs a command, which must end with the exit status 1 and one line on standard error that contains `name`.
fn refused(case: &str, arguments: &[&str], name: &str) {
    let output = sim(arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{case}: {told}");
    assert_eq!(told.lines().count(), 1, "{case}: {told}");
    assert!(told.contains(name) && told.contains("found") && told.contains("expected"), "{case}: {told}");
    assert!(output.stdout.is_empty(), "{case}: standard output is not empty");
}

#[test]
fn valid_burst_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("burst.toml"), manifest(LENS, LENS)).expect("a file");
    std::fs::write(folder.path().join("a.png"), png(16, 16)).expect("a file");
    let output = sim(&["replay", "--burst", text(folder.path()), "--lights", "16"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn invalid_manifests_are_refused() {
    let cases: &[(&str, String)] = &[
        ("empty", String::new()),
        ("not TOML", "version = = 1".into()),
        ("binary", "\u{0}\u{1}\u{2}".into()),
        ("another version", manifest("version = 1", "version = 2")),
        ("no version", manifest("version = 1\n", "")),
        ("no lens", manifest(LENS, "")),
        ("unknown lens model", manifest("equidistant", "fisheye")),
        ("unknown key", manifest("max_angle_deg", "max_angel_deg = 3\nmax_angle_deg")),
        ("k on a lens without", manifest("max_angle_deg", "k = [0.1]\nmax_angle_deg")),
        ("too few k", manifest("\"equidistant\"", "\"kannala-brandt\"\nk = [0.1]")),
        ("radial beyond its range", manifest("\"equidistant\"", "\"radial\"\nk = [-0.3, 0.0]")),
        ("max angle 0", manifest("80.0", "0.0")),
        ("max angle 200", manifest("80.0", "200.0")),
        ("focal 0", manifest("[5.0, 5.0]", "[0.0, 5.0]")),
        ("focal nan", manifest("[5.0, 5.0]", "[nan, 5.0]")),
        ("circle off the sensor", manifest("[7.5, 7.5]", "[7000.0, 7.5]")),
        ("no frames", manifest(FRAME, "")),
        ("a path for a name", manifest("a.png", "../a.png")),
        ("an absolute path", manifest("a.png", "/a.png")),
        ("a folder for a name", manifest("a.png", "..")),
        ("exposure 0", manifest("0.01", "0.0")),
        ("exposure negative", manifest("0.01", "-1.0")),
        ("exposure infinite", manifest("0.01", "inf")),
        ("exposure a string", manifest("0.01", "\"0.01\"")),
        ("gain 0", manifest("0.01", "0.01\ngain = 0.0")),
        ("known wrongly", manifest("0.01", "0.01\nknown = \"guessed\"")),
        ("thirteen frames", manifest(FRAME, &FRAME.repeat(13))),
        ("another size", manifest("max_angle_deg", "size = [17, 16]\nmax_angle_deg")),
        ("white below black", manifest(LENS, &format!("{LENS}[sensor]\nblack = 20\nwhite = 10\n"))),
        ("white beyond the samples", manifest(LENS, &format!("{LENS}[sensor]\nwhite = 1023\n"))),
        ("unknown response", manifest(LENS, &format!("{LENS}[response]\nmodel = \"log\"\n"))),
        (
            "polynomial without channels",
            manifest(LENS, &format!("{LENS}[response]\nmodel = \"polynomial\"\n")),
        ),
        ("scale 0", manifest(LENS, &format!("{LENS}[response]\nmodel = \"linear\"\nscale = 0.0\n"))),
        ("vignetting that turns dark", manifest("max_angle_deg", "vignetting = [1.0, -1.0]\nmax_angle_deg")),
        ("exposures far apart", manifest(FRAME, &format!("{FRAME}{}", FRAME.replace("0.01", "1e9")))),
    ];
    for (case, toml) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("burst.toml"), toml).expect("a file");
        std::fs::write(folder.path().join("a.png"), png(16, 16)).expect("a file");
        let output = sim(&["replay", "--burst", text(folder.path()), "--lights", "16"]);
        let told = String::from_utf8_lossy(&output.stderr);
        let last = told.lines().last().unwrap_or_default();
        assert_eq!(output.status.code(), Some(1), "{case}: {told}");
        assert!(last.contains("found") && last.contains("expected"), "{case}: {told}");
        assert!(!told.contains("panicked") && output.stdout.is_empty(), "{case}: {told}");
    }
}

#[test]
fn invalid_frames_are_refused() {
    let sound = png(16, 16);
    let mut broken = sound.clone();
    let middle = broken.len() / 2;
    broken[middle] ^= 0xff;
    let cases: &[(&str, Option<Vec<u8>>)] = &[
        ("missing", None),
        ("empty", Some(Vec::new())),
        ("truncated", Some(half(&sound))),
        ("a byte changed", Some(broken)),
        ("text", Some(b"hello".to_vec())),
        ("a GIF", Some(b"GIF89a\x01\x00\x01\x00\x00\x00\x00;".to_vec())),
        ("a truncated PPM", Some(b"P6 16 16 255\nabc".to_vec())),
        ("a huge PPM", Some(b"P6 99999999 99999999 255\n".to_vec())),
        ("a truncated JPEG", Some(vec![0xff, 0xd8, 0xff, 0xe0, 0, 16])),
    ];
    for (case, bytes) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("burst.toml"), manifest(LENS, LENS)).expect("a file");
        if let Some(bytes) = bytes {
            std::fs::write(folder.path().join("a.png"), bytes).expect("a file");
        }
        refused(case, &["replay", "--burst", text(folder.path())], "a.png");
    }
}

#[test]
fn frames_of_two_sizes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let second = FRAME.replace("a.png", "b.png").replace("0.01", "0.1");
    std::fs::write(folder.path().join("burst.toml"), manifest(FRAME, &format!("{FRAME}{second}")))
        .expect("a file");
    std::fs::write(folder.path().join("a.png"), png(16, 16)).expect("a file");
    std::fs::write(folder.path().join("b.png"), png(16, 17)).expect("a file");
    refused("two sizes", &["replay", "--burst", text(folder.path())], "b.png");
}

#[test]
fn invalid_maps_and_sets_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let room = at("room.exr");
    crate::common::write_room(&room);
    let whole = std::fs::read(&room).expect("a map");
    let write = |name: &str, bytes: &[u8]| std::fs::write(at(name), bytes).expect("a file");
    write("empty.exr", b"");
    write("half.exr", &half(&whole));
    write("text.exr", b"not a map");
    write("half.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\nab");
    for name in ["empty.exr", "half.exr", "text.exr", "half.hdr", "missing.exr"] {
        let path = at(name);
        refused_map(name, &path);
    }
    write("empty.json", b"");
    write("other.json", b"{\"lights\": 3}");
    write(
        "nan.json",
        b"{\"version\":1,\"lights\":[{\"id\":1,\"direction\":[0,0,0],\"irradiance\":[1,1,1]}]}",
    );
    for name in ["empty.json", "other.json", "nan.json", "missing.json"] {
        refused(name, &["score", "--env", text(&room), "--set", text(&at(name))], name);
    }
    write("lens.toml", b"[lens]\nmodel = \"equidistant\"\n");
    let (lens, out) = (at("lens.toml"), at("out"));
    let arguments = ["burst", "--env", text(&room), "--lens", text(&lens), "--out", text(&out)];
    refused("half a lens", &arguments, "lens.toml");
}

fn refused_map(case: &str, path: &Path) {
    let output = sim(&["decompose", "--env", text(path)]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{case}: {told}");
    assert_eq!(told.lines().count(), 1, "{case}: {told}");
    assert!(told.contains(case) && !told.contains("panicked"), "{case}: {told}");
}

#[test]
fn wrong_usage_ends_with_status_2() {
    for arguments in [
        &["decompose", "--env", "x.exr", "--sampler", "magic"][..],
        &["decompose"],
        &["decompose", "--env", "x.exr", "--lights", "many"],
        &["burst", "--env", "x.exr", "--lens", "l.toml", "--out", "o", "--exposures", "0"],
        &["frobnicate"],
    ] {
        let output = sim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(!output.stderr.is_empty(), "{arguments:?}: no line on standard error");
    }
}
