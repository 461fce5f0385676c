//! Fuzz target: a configuration file that is read without an error can be applied, saved and read again.

#![no_main]

use hemilux::config_file::ConfigFile;
use hemilux::probe::Config;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir_in("/dev/shm").expect("a folder in memory"));

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("hemilux.conf");
    std::fs::write(&path, bytes).expect("a file in memory");
    let Ok(opened) = ConfigFile::open(&path) else { return };
    opened.file.save(&Config::default()).expect("a file that was read is saved");
    ConfigFile::open(&path).expect("a file that was saved is read");
});
