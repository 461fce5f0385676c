//! Functions that several tests of `hemilux-sim` use.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs `hemilux-sim` and returns its output and exit status.
pub fn sim(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hemilux-sim")).args(arguments).output().expect("the command runs")
}

/// Runs `hemilux-sim`, which must succeed, and returns its standard output.
pub fn sim_ok(arguments: &[&str]) -> String {
    let output = sim(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).expect("UTF-8 on standard output")
}

/// Returns the path of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns the path of a folder of real data in `../shared/data`; prints a message and returns `None` if the folder does not exist.
pub fn shared(folder: &str) -> Option<PathBuf> {
    let path = root().join("../shared/data").join(folder);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("SKIPPED: no {folder} beside the workspace");
    None
}

/// Returns a path as a command-line argument.
pub fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// Writes an OpenEXR map of 256 x 128 texels of a room: walls, a window and a lamp, with a contrast of at most 200 : 1.
pub fn write_room(path: &Path) {
    let (width, height) = (256, 128);
    let pixel = |at: exr::math::Vec2<usize>| {
        let [x, y, z] = hemilux_sim::env::direction(width, height, at.y(), at.x());
        let wall = 0.3 + 0.2 * z + 0.1 * (3.0 * x).sin() * (2.0 * y).cos();
        let lamp = if x * 0.4 + y * 0.3 + z * 0.866 > 0.985 { 30.0 } else { 0.0 };
        let window = if (z - 0.3).abs() < 0.25 && x < -0.6 { 4.0 } else { 0.0 };
        (
            (wall + lamp + window) as f32,
            (wall + 0.9 * lamp + 1.1 * window) as f32,
            (0.8 * wall + 0.7 * lamp + 1.4 * window) as f32,
        )
    };
    use exr::prelude::WritableImage;
    let channels = exr::prelude::SpecificChannels::rgb(pixel);
    exr::prelude::Image::from_channels((width, height), channels)
        .write()
        .to_file(path)
        .expect("the map is written");
}
