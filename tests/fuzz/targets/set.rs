//! Fuzz target: light sets in the JSON form, as `score` and `render` read it, and in the binary form.

#![no_main]

use hemilux_core::wire::BinarySet;
use hemilux_sim::score::read_set;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir_in("/dev/shm").expect("a folder in memory"));

fuzz_target!(|bytes: &[u8]| {
    if let Ok(set) = BinarySet::try_new(bytes) {
        let head = set.head();
        let numbers = set.lights().flat_map(|light| light.irradiance).chain(head.scalar_flux);
        assert!(numbers.into_iter().all(|v| v.is_finite() && v >= 0.0), "an irradiance out of range");
    }
    let path = FOLDER.path().join("set.json");
    std::fs::write(&path, bytes).expect("a file in memory");
    if let Ok(set) = read_set(&path) {
        assert!(set.lights.iter().flat_map(|light| light.irradiance).all(|v| v >= 0.0), "a negative irradiance");
    }
});
