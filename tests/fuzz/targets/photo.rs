//! Fuzz target: photographs as `import` reads them, with EXIF data, ICC profiles and PNG chunks that define the conversion of light to
//! codes.

#![no_main]

use hemilux_sim::import::describe;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

const LENS: &str = "[lens]\nmodel = \"equidistant\"\nsize = [16, 16]\ncentre = [7.5, 7.5]\nfocal = [5.0, 5.0]\nk = []\nmax_angle_deg = 80.0\n";

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir_in("/dev/shm").expect("a folder in memory");
    std::fs::write(folder.path().join("lens.toml"), LENS).expect("a file in memory");
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let photo = FOLDER.path().join("photo.jpg");
    std::fs::write(&photo, bytes).expect("a file in memory");
    if let Ok(text) = describe(&FOLDER.path().join("lens.toml"), &[photo], bytes.len() % 2 == 0) {
        assert!(text.contains("exposure_s"), "a burst without an exposure time");
    }
});
