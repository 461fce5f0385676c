//! Fuzz target: the frames of a burst in PNG, JPEG, PGM, PPM and PAM files, with EXIF data.

#![no_main]

use hemilux::recorded::{ReadLimits, read_described};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

const BURST: &str = "version = 1\n[lens]\nmodel = \"equidistant\"\ncentre = [7.5, 7.5]\nfocal = [5.0, 5.0]\nmax_angle_deg = 80.0\n\
                     [[frame]]\nfile = \"frame\"\nexposure_s = 0.01\n";

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir_in("/dev/shm").expect("a folder in memory"));

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(FOLDER.path().join("frame"), bytes).expect("a file in memory");
    let limits = ReadLimits { max_pixels: Some(1 << 14), ..ReadLimits::default() };
    let _ = read_described(FOLDER.path(), BURST, &limits);
});
