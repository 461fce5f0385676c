//! Recorded bursts: folders with a `burst.toml` and one image per exposure.

use crate::calibration::{Burst, Calibration};
use std::path::{Path, PathBuf};

/// Why a recorded burst could not be read: one line that names the file, what was found and what was expected.
#[derive(Debug, thiserror::Error)]
#[error("{path}: found {found}, expected {expected}")]
pub struct RecordedError {
    /// The file or folder.
    pub path: PathBuf,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

/// Reads one burst, its frames in ascending order of exposure.
///
/// # Errors
/// [`RecordedError`].
pub fn read_burst(_folder: &Path) -> Result<(Calibration, Burst), RecordedError> {
    unimplemented!("being written")
}

/// The bursts of a recording, in time: (timestamp in nanoseconds, folder).
///
/// # Errors
/// [`RecordedError`].
pub fn read_sequence(_folder: &Path) -> Result<Vec<(u64, PathBuf)>, RecordedError> {
    unimplemented!("being written")
}
