//! Recorded bursts: folders with a `burst.toml` and one image per exposure, as `board/FORMATS.md` defines them.
//!
//! Files are untrusted: sizes are bounded, file names have no folder part, and every error is one line.

#[cfg(feature = "foreign-lenses")]
mod convert;
#[cfg(feature = "foreign-lenses")]
mod foreign;
mod images;
mod jpeg;
mod lens;
mod lens_table;
mod manifest;
mod photometric;
mod sensor_table;
mod shown;

use crate::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux_core::format::Layout;
use manifest::Manifest;
use std::fmt::Display;
use std::path::{Path, PathBuf};

#[cfg(feature = "foreign-lenses")]
pub use convert::{Converted, Target, convert};
pub use hemilux_core::Levels;
#[cfg(feature = "v4l2")]
pub(crate) use jpeg::{SEAL, is_whole as is_whole_jpeg};
pub use lens::{LensFile, lens_table, parse_lens, read_lens};
pub use manifest::read_shown;
pub use photometric::{
    ANY_CLASS, Photometric, parse_photometric, photometric_camera, radiometry, read_photometric,
};
pub use shown::Shown;

/// Largest accepted `burst.toml`, `sequence.toml` or lens file, bytes.
const MAX_MANIFEST_BYTES: u64 = 1 << 20;

/// An error in a recorded burst: one line with the file, the value that was found and the value that was expected.
#[derive(Debug, thiserror::Error)]
#[error("{path}: found {found}, expected {expected}")]
pub struct RecordedError {
    /// The file or folder with the fault.
    pub path: PathBuf,
    /// Description of the value that the file or folder contains.
    pub found: String,
    /// Description of the values that were expected in its place.
    pub expected: String,
}

impl RecordedError {
    pub(crate) fn new(path: &Path, found: impl Display, expected: impl Display) -> Self {
        // A parser's message may have several lines, which are joined.
        let one_line = |v: String| v.split_whitespace().collect::<Vec<_>>().join(" ");
        Self {
            path: path.into(),
            found: one_line(found.to_string()),
            expected: one_line(expected.to_string()),
        }
    }
}

/// Limits on the size of a recorded burst, which are checked before memory is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadLimits {
    /// Largest accepted number of pixels of one image; `None` for [`ReadLimits::MAX_PIXELS`] and a limit by the file's length.
    pub max_pixels: Option<u64>,
    /// Largest accepted memory of the samples of a burst, bytes.
    pub max_burst_bytes: u64,
}

impl ReadLimits {
    /// Default limit on the number of pixels of one image: 134 million.
    pub const MAX_PIXELS: u64 = 1 << 27;
}

impl Default for ReadLimits {
    fn default() -> Self {
        Self { max_pixels: None, max_burst_bytes: 1 << 30 }
    }
}

/// Reads the recorded burst in `folder`, with its frames in ascending order of exposure.
///
/// # Errors
/// [`RecordedError`] for files that are missing, truncated, of another type or contradictory.
pub fn read_burst(folder: &Path) -> Result<RecordedBurst, RecordedError> {
    read_recorded(folder, &ReadLimits::default())
}

/// A recorded burst with the names of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedBurst {
    /// The calibration of the camera that took the burst.
    pub calibration: Calibration,
    /// The burst, with its frames in ascending order of exposure.
    pub burst: Burst,
    /// File name of each frame, in the order of the frames.
    pub files: Vec<String>,
    /// The time of each frame, nanoseconds; 0 where unknown.
    pub times_ns: Vec<u64>,
}

/// Reads the recorded burst in `folder` within `limits`.
///
/// # Errors
/// [`RecordedError`] for files that are missing, truncated, of another type, contradictory, or above the limits.
pub fn read_recorded(folder: &Path, limits: &ReadLimits) -> Result<RecordedBurst, RecordedError> {
    let path = folder.join("burst.toml");
    read_manifest(folder, &path, &manifest::read(&path)?, limits)
}

/// Reads the burst in `folder` that `text`, the contents of a `burst.toml`, describes.
///
/// # Errors
/// [`RecordedError`] for files that are missing, truncated, of another type, contradictory, or above the limits.
pub fn read_described(
    folder: &Path,
    text: &str,
    limits: &ReadLimits,
) -> Result<RecordedBurst, RecordedError> {
    read_manifest(folder, folder, &manifest::parse(folder, text)?, limits)
}

fn read_manifest(
    folder: &Path,
    path: &Path,
    manifest: &Manifest,
    limits: &ReadLimits,
) -> Result<RecordedBurst, RecordedError> {
    manifest.check(path)?;
    let files: Vec<PathBuf> = manifest.frame.iter().map(|f| folder.join(&f.file)).collect();
    let images = match manifest.layout(path)? {
        Some(layout) => {
            check_bytes(folder, files.len() as u64 * layout.frame_bytes() as u64, limits)?;
            files.iter().map(|file| images::read_raw(file, layout)).collect::<Result<Vec<_>, _>>()?
        }
        None => read_images(folder, &files, limits)?,
    };
    let layout = images[0].layout;
    if let Some((_, file)) = images.iter().zip(&files).find(|(image, _)| image.layout != layout) {
        return Err(RecordedError::new(file, "another sample depth", "the first frame's"));
    }
    if let Some((_, file)) = images.iter().zip(&files).find(|(image, _)| image.white != images[0].white) {
        return Err(RecordedError::new(file, "another maxval", "the first frame's"));
    }
    let calibration = manifest.calibration(path, &layout, images[0].white)?;
    let timestamp_ns = manifest.frame.iter().filter_map(|f| f.timestamp_ns).max().unwrap_or(0);
    let phase_ns = manifest.shortest_ns().unwrap_or(0);
    let frames = images.into_iter().zip(&manifest.frame);
    let mut frames: Vec<(Frame, (String, u64))> = frames
        .map(|(image, f)| {
            let frame = Frame { exposure: f.exposure(), pixels: image.pixels };
            (frame, (f.file.clone(), f.timestamp_ns.unwrap_or(0)))
        })
        .collect();
    frames.sort_by(|(a, _), (b, _)| a.light().total_cmp(&b.light()));
    let (frames, names): (_, Vec<_>) = frames.into_iter().unzip();
    let (files, times_ns) = names.into_iter().unzip();
    Ok(RecordedBurst {
        calibration,
        burst: Burst { frames, timestamp_ns, phase_ns, ..Burst::default() },
        files,
        times_ns,
    })
}

/// Reads the headers of all images of a burst, checks their total memory, then decodes the images one after the other.
fn read_images(folder: &Path, files: &[PathBuf], limits: &ReadLimits) -> Result<Vec<Image>, RecordedError> {
    let mut size = None;
    let mut bytes = 0;
    for file in files {
        let opened = images::open(file, limits)?;
        let (found, expected) = (opened.size(), *size.get_or_insert(opened.size()));
        if found != expected {
            let found = format!("{} x {} pixels", found[0], found[1]);
            let expected = format!("{} x {} as the first frame", expected[0], expected[1]);
            return Err(RecordedError::new(file, found, expected));
        }
        bytes += opened.bytes();
    }
    check_bytes(folder, bytes, limits)?;
    files.iter().map(|file| images::read(file, images::open(file, limits)?)).collect()
}

fn check_bytes(folder: &Path, bytes: u64, limits: &ReadLimits) -> Result<(), RecordedError> {
    if bytes <= limits.max_burst_bytes {
        return Ok(());
    }
    let found = format!("frames of {} MB together", bytes >> 20);
    Err(RecordedError::new(folder, found, format!("at most {} MB", limits.max_burst_bytes >> 20)))
}

/// The samples of one decoded image file.
struct Image {
    layout: Layout,
    pixels: Pixels,
    /// Code of relative exposure 1, where the image file states it.
    white: Option<f64>,
}

/// A picture as grey samples of eight bits.
#[cfg(feature = "calibrate")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    /// Number of columns of the picture.
    pub width: usize,
    /// Samples of eight bits, row after row.
    pub samples: Vec<u8>,
}

/// Returns the columns and rows of the image at `path` after its rotation to upright, from its header.
///
/// # Errors
/// [`RecordedError`] for a file that is not a complete PNG, JPEG, PGM or PPM image.
pub fn image_size(path: &Path) -> Result<[u32; 2], RecordedError> {
    Ok(images::open(path, &ReadLimits::default())?.size())
}

/// Reads the picture at `path` as grey samples of eight bits.
///
/// # Errors
/// [`RecordedError`] for a file that is not a complete PNG, JPEG, PGM or PPM image.
#[cfg(feature = "calibrate")]
pub fn read_grey(path: &Path) -> Result<GreyImage, RecordedError> {
    let image = images::read(path, images::open(path, &ReadLimits::default())?)?;
    let mean =
        |three: [u32; 3], full: u32| ((three[0] + 2 * three[1] + three[2]) * 255 / (4 * full)).min(255) as u8;
    let full = |largest: u32| image.white.map_or(largest, |white| white as u32).max(1);
    let samples = match &image.pixels {
        Pixels::U8(codes) => {
            codes.as_chunks::<3>().0.iter().map(|c| mean(c.map(u32::from), full(0xff))).collect()
        }
        Pixels::U16(codes) => {
            codes.as_chunks::<3>().0.iter().map(|c| mean(c.map(u32::from), full(0xffff))).collect()
        }
    };
    Ok(GreyImage { width: image.layout.width() as usize, samples })
}

/// A burst of a recording that has not been read yet.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct BurstFolder {
    /// Folder with the `burst.toml` of the burst.
    pub folder: PathBuf,
    /// Time of the burst in the recording's `sequence.toml`, nanoseconds; 0 where it has none.
    pub timestamp_ns: u64,
}

/// Lists the bursts of a recording in order of time.
///
/// `folder` is a burst, contains a `sequence.toml`, or contains bursts, which are then listed in order of their names.
///
/// # Errors
/// [`RecordedError`] for a folder of another kind or a wrong `sequence.toml`.
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
