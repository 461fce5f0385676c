//! The files `burst.toml` and `sequence.toml` of a recording.

use super::lens_table::LensTable;
use super::sensor_table::SensorTable;
use super::shown::Shown;
use super::{BurstFolder, MAX_MANIFEST_BYTES, RecordedError};
use crate::calibration::Calibration;
use hemilux_core::format::{Format, Layout, Matrix, Yuv};
use hemilux_core::{Exposure, MAX_EXPOSURES};
use hemilux_core::{Levels, Response};
use serde::Deserialize;
use std::io::Read;
use std::path::{Component, Path};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    version: i64,
    lens: LensTable,
    response: Option<ResponseTable>,
    #[serde(default)]
    sensor: SensorTable,
    format: Option<FormatTable>,
    #[serde(default)]
    pub(super) frame: Vec<FrameTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ResponseTable {
    model: String,
    red: Option<Vec<f64>>,
    green: Option<Vec<f64>>,
    blue: Option<Vec<f64>>,
    #[serde(default = "one")]
    scale: f64,
}

fn one() -> f64 {
    1.0
}

/// Packing of raw frames: the `[format]` table.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FormatTable {
    width: u32,
    height: u32,
    fourcc: String,
    bytes_per_line: Option<usize>,
    range: Option<String>,
    matrix: Option<String>,
    /// Number of colour quads along both sides that are combined into one while raw frames are read.
    #[serde(default = "one_quad")]
    bin: u32,
    /// True if the camera had compressed the recorded frames.
    #[serde(default)]
    compressed: bool,
}

const fn one_quad() -> u32 {
    1
}

impl FormatTable {
    fn layout(&self, path: &Path) -> Result<Layout, RecordedError> {
        let refuse = |found: String, expected: &str| RecordedError::new(path, found, expected);
        let limited = match self.range.as_deref() {
            None | Some("full") => false,
            Some("limited") => true,
            Some(other) => return Err(refuse(format!("range = {other:?}"), "full or limited")),
        };
        let matrix = match self.matrix.as_deref() {
            None | Some("bt601") => Matrix::Bt601,
            Some("bt709") => Matrix::Bt709,
            Some(other) => return Err(refuse(format!("matrix = {other:?}"), "bt601 or bt709")),
        };
        let fourcc = <[u8; 4]>::try_from(self.fourcc.as_bytes()).ok();
        let format = fourcc.and_then(|f| Format::from_fourcc(f, Yuv { limited, matrix }));
        let expected = "RGB3, BGR3, YUYV, NV12, GREY or a Bayer format of 8, 10, 12, 14 or 16 bits";
        let format = format.ok_or_else(|| refuse(format!("fourcc = {:?}", self.fourcc), expected))?;
        let line = self.bytes_per_line.unwrap_or_else(|| format.line_bytes(self.width));
        let layout = Layout::try_new(format, self.width, self.height, line);
        let layout = layout.map_err(|e| {
            refuse(format!("[format] with {e}"), "a size and bytes_per_line that fit the fourcc")
        })?;
        if self.bin == 1 {
            return Ok(layout);
        }
        let binned = layout.binned(self.bin);
        binned.map_err(|e| {
            refuse(format!("[format] bin = {} with {e}", self.bin), "1, or 2, 4 or 8 of a Bayer format")
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrameTable {
    pub(super) file: String,
    exposure_s: f64,
    #[serde(default = "one")]
    gain: f64,
    #[allow(dead_code, reason = "checked for its type; used once exposures are verified")]
    sequence: Option<u64>,
    pub(super) timestamp_ns: Option<u64>,
    known: Option<String>,
}

impl FrameTable {
    pub(super) fn exposure(&self) -> Exposure {
        Exposure { seconds: self.exposure_s, gain: self.gain }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SequenceFile {
    version: i64,
    #[serde(default)]
    burst: Vec<SequenceEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SequenceEntry {
    folder: String,
    #[serde(default)]
    timestamp_ns: u64,
}

/// Reads and parses a TOML file of bounded size.
pub(super) fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, RecordedError> {
    parse(path, &read_text(path)?)
}

/// Reads from the `burst.toml` in `folder` the part of the sensor that the pictures show; `None` if the file does not state it.
///
/// # Errors
/// [`RecordedError`] for a `burst.toml` that cannot be read.
pub fn read_shown(folder: &Path) -> Result<Option<Shown>, RecordedError> {
    let path = folder.join("burst.toml");
    let manifest: Manifest = read(&path)?;
    manifest.lens.shown(&path)
}

/// Reads a text file of bounded size.
pub(super) fn read_text(path: &Path) -> Result<String, RecordedError> {
    let what = "a readable text file";
    let file = std::fs::File::open(path).map_err(|e| RecordedError::new(path, e, what))?;
    let mut text = String::new();
    file.take(MAX_MANIFEST_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(|e| RecordedError::new(path, e, what))?;
    if text.len() as u64 > MAX_MANIFEST_BYTES {
        return Err(RecordedError::new(path, "more than a megabyte", what));
    }
    Ok(text)
}

/// Parses the text of a TOML file.
pub(super) fn parse<T: for<'de> Deserialize<'de>>(path: &Path, text: &str) -> Result<T, RecordedError> {
    toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(0, |s| text[..s.start.min(text.len())].matches('\n').count() + 1);
        RecordedError::new(
            path,
            format!("{} (line {line})", e.message()),
            "the keys of \"Recorded burst\" in board/FORMATS.md",
        )
    })
}

pub(super) fn check_version(path: &Path, version: i64) -> Result<(), RecordedError> {
    if version == 1 {
        Ok(())
    } else {
        Err(RecordedError::new(path, format!("version {version}"), "version 1"))
    }
}

/// Returns true if `name` is a file name without a folder part.
fn is_bare(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) && !name.contains(['/', '\\'])
}

impl Manifest {
    /// Checks versions, counts, names and numbers of a `burst.toml` before any image is read.
    pub(super) fn check(&self, path: &Path) -> Result<(), RecordedError> {
        let refuse = |found: String, expected: &str| Err(RecordedError::new(path, found, expected));
        check_version(path, self.version)?;
        if !(1..=MAX_EXPOSURES).contains(&self.frame.len()) {
            return refuse(
                format!("{} [[frame]] tables", self.frame.len()),
                &format!("1 to {MAX_EXPOSURES}"),
            );
        }
        for frame in &self.frame {
            if !is_bare(&frame.file) {
                return refuse(format!("file = {:?}", frame.file), "a bare name in the folder");
            }
            for (name, value) in [("exposure_s", frame.exposure_s), ("gain", frame.gain)] {
                if !(value > 0.0 && value.is_finite()) {
                    return refuse(format!("{name} = {value} of {:?}", frame.file), "a positive number");
                }
            }
            if let Some(known) = frame.known.as_deref()
                && !["reported", "predicted", "verified", "measured", "unknown"].contains(&known)
            {
                return refuse(
                    format!("known = {known:?}"),
                    "reported, predicted, verified, measured or unknown",
                );
            }
        }
        Ok(())
    }

    /// Returns the timestamp of the frame with the shortest exposure, nanoseconds; `None` where the file has none.
    pub(super) fn shortest_ns(&self) -> Option<u64> {
        let light = |frame: &FrameTable| frame.exposure_s * frame.gain;
        self.frame.iter().min_by(|a, b| light(a).total_cmp(&light(b)))?.timestamp_ns
    }

    /// Returns the packing of the burst's raw frames; `None` if its frames are images.
    pub(super) fn layout(&self, path: &Path) -> Result<Option<Layout>, RecordedError> {
        self.format.as_ref().map(|table| table.layout(path)).transpose()
    }

    pub(super) fn calibration(
        &self,
        path: &Path,
        layout: &Layout,
        white: Option<f64>,
    ) -> Result<Calibration, RecordedError> {
        let (width, height) = (layout.width(), layout.height());
        if let Some(size) = self.lens.size.filter(|s| *s != [width, height]) {
            let found = format!("[lens] size = [{}, {}] and images of {width} x {height}", size[0], size[1]);
            return Err(RecordedError::new(path, found, "the same size"));
        }
        let response = self.response.as_ref();
        self.lens.shown(path)?;
        let mut calibration = calibration(path, &self.lens, response, &self.sensor, layout, white)?;
        calibration.compressed = self.format.as_ref().is_some_and(|f| f.compressed);
        Ok(calibration)
    }
}

fn calibration(
    path: &Path,
    lens: &LensTable,
    response: Option<&ResponseTable>,
    sensor: &SensorTable,
    layout: &Layout,
    stated_white: Option<f64>,
) -> Result<Calibration, RecordedError> {
    let black = sensor.black.unwrap_or(0.0);
    let most = stated_white.unwrap_or(f64::from(layout.format().max_code()));
    let white = sensor.white.unwrap_or(most);
    if !(black >= 0.0 && black < white && white <= most) {
        let found = format!("[sensor] black = {black}, white = {white}");
        let expected = format!("0 <= black < white <= {most}");
        return Err(RecordedError::new(path, found, expected));
    }
    sensor.noise(path)?;
    let white_balance = sensor.white_balance.unwrap_or([1.0; 3]);
    if !white_balance.iter().all(|w| *w > 0.0 && w.is_finite()) {
        return Err(RecordedError::new(
            path,
            format!("white_balance = {white_balance:?}"),
            "three positive numbers",
        ));
    }
    let scale = response.map_or(1.0, |r| r.scale);
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(RecordedError::new(path, format!("scale = {scale}"), "a positive number"));
    }
    let response = response.map_or(Ok(Response::Linear), |r| r.response(path))?;
    let mut calibration = Calibration::new(lens.lens(path)?, *layout);
    calibration.response = response;
    calibration.levels = Levels { black, white };
    calibration.scale = scale;
    calibration.white_balance = white_balance;
    Ok(calibration)
}

/// Returns `values` as nine coefficients of a monotone curve; `None` if they are not nine ascending numbers from 0 to 1.
fn nine_ascending(values: Option<&[f64]>) -> Option<[f64; 9]> {
    let nine = <[f64; 9]>::try_from(values?).ok()?;
    (nine.is_sorted() && nine[0] >= 0.0 && nine[8] <= 1.0).then_some(nine)
}

impl ResponseTable {
    pub(super) fn response(&self, path: &Path) -> Result<Response, RecordedError> {
        let channels = [("red", &self.red), ("green", &self.green), ("blue", &self.blue)];
        match self.model.as_str() {
            "linear" => Ok(Response::Linear),
            "srgb" => Ok(Response::Srgb),
            "polynomial" => {
                let mut polynomial = [[0.0; 5]; 3];
                for (row, (name, values)) in polynomial.iter_mut().zip(channels) {
                    let found = values.as_ref().map_or(0, Vec::len);
                    let five = values.as_deref().and_then(|v| <[f64; 5]>::try_from(v).ok());
                    let refused =
                        || RecordedError::new(path, format!("{found} coefficients of {name}"), "five");
                    *row = five.ok_or_else(refused)?;
                }
                Ok(Response::Polynomial(polynomial))
            }
            "bernstein" => {
                let mut rows = [[0.0; 9]; 3];
                for (row, (name, values)) in rows.iter_mut().zip(channels) {
                    *row = nine_ascending(values.as_deref()).ok_or_else(|| {
                        RecordedError::new(
                            path,
                            format!("the coefficients of {name}"),
                            "nine that ascend from 0 to 1",
                        )
                    })?;
                }
                Ok(Response::Bernstein(rows))
            }
            other => {
                let expected = "linear, srgb, polynomial or bernstein";
                Err(RecordedError::new(path, format!("the response model {other:?}"), expected))
            }
        }
    }
}

/// Reads the bursts that the `sequence.toml` at `path` lists.
pub(super) fn read_sequence(path: &Path, folder: &Path) -> Result<Vec<BurstFolder>, RecordedError> {
    let file: SequenceFile = read(path)?;
    check_version(path, file.version)?;
    if file.burst.is_empty() {
        return Err(RecordedError::new(path, "no [[burst]] tables", "at least one"));
    }
    if let Some(entry) = file.burst.iter().find(|b| !is_bare(&b.folder)) {
        return Err(RecordedError::new(
            path,
            format!("folder = {:?}", entry.folder),
            "a bare name in the folder",
        ));
    }
    if !file.burst.is_sorted_by_key(|b| b.timestamp_ns) {
        return Err(RecordedError::new(path, "timestamps that go back", "ascending timestamp_ns"));
    }
    let at = |b: SequenceEntry| BurstFolder { folder: folder.join(b.folder), timestamp_ns: b.timestamp_ns };
    Ok(file.burst.into_iter().map(at).collect())
}
