//! Recorded bursts: folders with a `burst.toml` and one image per exposure, as `board/FORMATS.md` defines them.
//!
//! Input is untrusted: sizes are bounded, file names have no folder part, and every error is one line.

mod images;
mod lens;
mod manifest;

use crate::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux_core::format::Layout;
use manifest::Manifest;
use std::fmt::Display;
use std::path::{Path, PathBuf};

pub use lens::{LensFile, Levels, read_lens};

/// Largest `burst.toml`, `sequence.toml` or lens file, bytes.
const MAX_MANIFEST_BYTES: u64 = 1 << 20;

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

impl RecordedError {
    pub(crate) fn new(path: &Path, found: impl Display, expected: impl Display) -> Self {
        // A parser's message may span lines; ours never do.
        let one_line = |v: String| v.split_whitespace().collect::<Vec<_>>().join(" ");
        Self {
            path: path.into(),
            found: one_line(found.to_string()),
            expected: one_line(expected.to_string()),
        }
    }
}

/// Reads one burst, its frames in ascending order of exposure.
///
/// # Errors
/// [`RecordedError`] for files that are missing, truncated, of another type or contradict each other.
pub fn read_burst(folder: &Path) -> Result<(Calibration, Burst), RecordedError> {
    let path = folder.join("burst.toml");
    let manifest: Manifest = manifest::read(&path)?;
    manifest.check(&path)?;
    let mut images = Vec::with_capacity(manifest.frame.len());
    let raw = manifest.layout(&path)?;
    for frame in &manifest.frame {
        let file = folder.join(&frame.file);
        images.push(raw.map_or_else(|| images::read(&file), |layout| images::read_raw(&file, layout))?);
    }
    let layout = images[0].layout;
    for (image, frame) in images.iter().zip(&manifest.frame) {
        let file = folder.join(&frame.file);
        let [found, expected] = [image.layout, layout].map(|l| (l.width(), l.height()));
        if found != expected {
            let (found, expected) = (format!("{} x {} pixels", found.0, found.1), expected);
            let expected = format!("{} x {} as the first frame", expected.0, expected.1);
            return Err(RecordedError::new(&file, found, expected));
        }
        if image.layout != layout {
            return Err(RecordedError::new(&file, "another sample depth", "the first frame's"));
        }
    }
    let calibration = manifest.calibration(&path, &layout)?;
    let timestamp_ns = manifest.frame.iter().filter_map(|f| f.timestamp_ns).max().unwrap_or(0);
    let frames = images.into_iter().zip(&manifest.frame);
    let mut frames: Vec<_> =
        frames.map(|(image, f)| Frame { exposure: f.exposure(), pixels: image.pixels }).collect();
    frames.sort_by(|a, b| light(a).total_cmp(&light(b)));
    Ok((calibration, Burst { frames, timestamp_ns, ..Burst::default() }))
}

fn light(frame: &Frame) -> f64 {
    frame.exposure.seconds * frame.exposure.gain
}

/// One decoded image.
struct Image {
    layout: Layout,
    pixels: Pixels,
}

/// One burst of a recording, before it is read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BurstFolder {
    /// The folder that holds its `burst.toml`.
    pub folder: PathBuf,
    /// Time of the burst by the recording's `sequence.toml`, nanoseconds; 0 where it has none.
    pub timestamp_ns: u64,
}

/// Lists the bursts of a recording in the order of time.
///
/// `folder` is a burst itself, holds a `sequence.toml`, or holds bursts, which are then taken in name order.
///
/// # Errors
/// [`RecordedError`].
pub fn read_sequence(folder: &Path) -> Result<Vec<BurstFolder>, RecordedError> {
    if folder.join("burst.toml").is_file() {
        return Ok(vec![BurstFolder { folder: folder.into(), timestamp_ns: 0 }]);
    }
    let list = folder.join("sequence.toml");
    if list.is_file() {
        return manifest::read_sequence(&list, folder);
    }
    let entries =
        std::fs::read_dir(folder).map_err(|e| RecordedError::new(folder, e, "a readable folder"))?;
    let mut folders: Vec<_> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("burst.toml").is_file())
        .map(|folder| BurstFolder { folder, timestamp_ns: 0 })
        .collect();
    folders.sort();
    if folders.is_empty() {
        let expected = "a burst.toml, a sequence.toml or folders that hold a burst.toml";
        return Err(RecordedError::new(folder, "none", expected));
    }
    Ok(folders)
}
