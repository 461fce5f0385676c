//! Replay of raw recordings of the form that `hemilux record` writes.

use hemilux::calibration::{Calibration, Pixels};
use hemilux_core::format::{Format, Yuv};
use hemilux_sim::bench::{Case, bursts};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// Writes the first burst of `case` as a recording with raw frames to `folder`.
fn record(case: &Case, fourcc: &str, folder: &Path) {
    let c = bursts::calibration(case);
    let mut text = manifest(&c, fourcc);
    for (i, frame) in bursts::make(case)[0].frames.iter().enumerate() {
        let Pixels::U8(bytes) = &frame.pixels else { panic!("packed frames are bytes") };
        std::fs::write(folder.join(format!("{i}.raw")), bytes).expect("written");
        let _ = write!(
            text,
            "[[frame]]\nfile = \"{i}.raw\"\nexposure_s = {}\nknown = \"verified\"\n",
            frame.exposure.seconds
        );
    }
    std::fs::write(folder.join("burst.toml"), text).expect("written");
}

fn manifest(c: &Calibration, fourcc: &str) -> String {
    let i = c.lens.intrinsics();
    let response =
        if matches!(c.layout.format(), Format::Yuyv(_) | Format::Nv12(_)) { "srgb" } else { "linear" };
    format!(
        "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [{}, {}]\ncentre = [{}, {}]\nfocal = [{}, {}]\nmax_angle_deg = 80.0\n\
         [response]\nmodel = \"{response}\"\nscale = {}\n[sensor]\nblack = {}\nwhite = {}\n\
         [format]\nwidth = {}\nheight = {}\nfourcc = \"{fourcc}\"\nbytes_per_line = {}\nrange = \"limited\"\n",
        c.layout.width(),
        c.layout.height(),
        i.centre_px.x,
        i.centre_px.y,
        i.focal_px.x,
        i.focal_px.y,
        c.scale,
        c.levels.black,
        c.levels.white,
        c.layout.width(),
        c.layout.height(),
        c.layout.bytes_per_line()
    )
}

fn replay(fourcc: &str) -> Value {
    let yuv = Yuv { limited: true, ..Yuv::default() };
    let name: [u8; 4] = fourcc.as_bytes().try_into().expect("four characters");
    let format = Format::from_fourcc(name, yuv).expect("a format that is read");
    let case = Case { size: (320, 240), ..Case::of_format(format) };
    let folder = tempfile::tempdir().expect("a folder");
    record(&case, fourcc, folder.path());
    let program = Command::new(env!("CARGO_BIN_EXE_hemilux-sim"))
        .args(["replay", "--sampler", "q2tree", "--lights", "64", "--burst"])
        .arg(folder.path())
        .output()
        .expect("it runs");
    assert!(program.status.success(), "{fourcc}: {}", String::from_utf8_lossy(&program.stderr));
    serde_json::from_slice(&program.stdout).expect("a light set")
}

fn rgb(set: &Value, name: &str) -> Vec<f64> {
    set[name].as_array().expect(name).iter().map(|v| v.as_f64().expect("a number")).collect()
}

/// The recordings have one room and one lens; they differ in the rounding of samples and in the number of columns of chroma and mosaics.
#[test]
fn light_of_recordings_agrees_between_pixel_formats() {
    let expected = replay("RGB3");
    let count = |set: &Value| set["lights"].as_array().map_or(0, Vec::len);
    assert!(count(&expected) > 32, "lights of the room: {expected}");
    for fourcc in ["YUYV", "NV12", "pBAA", "pRCC", "GB10", "RG16"] {
        let found = replay(fourcc);
        for name in ["scalar_flux", "horizontal_irradiance"] {
            for (f, e) in rgb(&found, name).into_iter().zip(rgb(&expected, name)) {
                assert!((f / e - 1.0).abs() < 0.03, "{fourcc}: {name} {f}, expected {e}");
            }
        }
        assert!(count(&found).abs_diff(count(&expected)) <= 8, "{fourcc}: {} lights", count(&found));
    }
}
