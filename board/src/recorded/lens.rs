//! Lens files: the lens, the response and the levels of a camera.

use super::RecordedError;
#[cfg(feature = "foreign-lenses")]
use super::foreign::{self, ForeignLens};
use super::lens_table::LensTable;
use super::manifest::{ResponseTable, check_version, parse, read_text};
use super::sensor_table::SensorTable;
use super::shown::Shown;
use crate::noise::Noise;
use hemilux_core::Levels;
use hemilux_core::Response;
use hemilux_core::lens::Lens;
use serde::Deserialize;
use std::path::Path;
use toml::{Table, Value};

/// A file with a `[lens]` table, such as `hemilux-sim burst --lens` reads.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LensManifest {
    #[serde(default = "version_one")]
    version: i64,
    lens: LensTable,
    response: Option<ResponseTable>,
    sensor: Option<SensorTable>,
    /// The origin and accuracy of the lens, which `hemilux calibrate lens` writes and reads.
    calibration: Option<Table>,
    /// The photometric calibration, which `hemilux calibrate photometric` writes.
    #[allow(dead_code, reason = "read by parse_photometric")]
    photometric: Option<Table>,
}

fn version_one() -> i64 {
    1
}

/// Contents of a lens file.
#[derive(Clone, Debug, PartialEq)]
pub struct LensFile {
    /// Lens model that the file states.
    pub lens: Lens,
    /// Columns and rows of the images to which the lens applies.
    pub size: [u32; 2],
    /// Response from codes to relative exposure; linear where the file has no `[response]`.
    pub response: Response,
    /// Black and white level of the camera, where the file states both.
    pub levels: Option<Levels>,
    /// Noise of a sample, where the file states it.
    pub noise: Option<Noise>,
    /// The `[lens]` table, for copying into a `burst.toml`.
    pub lens_table: Table,
    /// The `[response]` table, where the file has one.
    pub response_table: Option<Table>,
    /// The `[calibration]` table: origin and accuracy of the lens.
    pub calibration_table: Option<Table>,
    /// The part of the sensor that the images cover, where the file states it.
    pub shown: Option<Shown>,
    /// Notes about the conversion of a lens file of another program.
    pub notes: Vec<String>,
}

impl LensFile {
    /// Creates the contents of a lens file with `lens` for images of `size`, with a linear response and without tables.
    #[cfg(feature = "foreign-lenses")]
    fn of_lens(lens: Lens, size: [u32; 2]) -> Self {
        Self {
            lens,
            size,
            response: Response::Linear,
            levels: None,
            noise: None,
            lens_table: Table::new(),
            response_table: None,
            calibration_table: None,
            shown: None,
            notes: Vec::new(),
        }
    }

    /// Returns the response of the camera, where the lens file has a `[response]` table.
    #[must_use]
    pub fn told_response(&self) -> Option<Response> {
        self.response_table.as_ref().map(|_| self.response)
    }
}

/// Returns true if a text is a lens file of hemilux: it has a `[lens]` table or a `lens.` key.
#[cfg(feature = "foreign-lenses")]
fn is_ours(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim_start);
    let has_key = lines
        .any(|line| line.starts_with("[lens]") || line.starts_with("lens.") || line.starts_with("lens ="));
    has_key || text.lines().any(|line| line.trim_start().starts_with("version ="))
}

/// Reads a lens file: a `[lens]` table with its `size`, and optionally `[response]` and `[sensor]`; or, with the feature
/// `foreign-lenses`, a file of OpenCV, Kalibr, ROS, COLMAP or OCamCalib.
///
/// # Errors
/// [`RecordedError`] for a file that cannot be read or is not a lens file.
pub fn read_lens(path: &Path) -> Result<LensFile, RecordedError> {
    parse_lens(path, &read_text(path)?)
}

/// Parses a lens file like [`read_lens`] from `text`; errors name `path`.
///
/// # Errors
/// [`RecordedError`] for a text that is not a lens file.
pub fn parse_lens(path: &Path, text: &str) -> Result<LensFile, RecordedError> {
    #[cfg(feature = "foreign-lenses")]
    if !is_ours(text) {
        let ForeignLens { lens, size, notes } = foreign::read(path, text)?;
        let table = lens_table(&lens, size);
        return Ok(LensFile { lens_table: table, notes, ..LensFile::of_lens(lens, size) });
    }
    let file: LensManifest = parse(path, text)?;
    check_version(path, file.version)?;
    let Some(size) = file.lens.size.filter(|s| s[0] > 0 && s[1] > 0) else {
        return Err(RecordedError::new(path, "[lens] without a size", "size = [columns, rows]"));
    };
    let response = file.response.as_ref().map_or(Ok(Response::Linear), |r| r.response(path))?;
    let raw: Table = parse(path, text)?;
    let table = |name: &str| raw.get(name).and_then(Value::as_table).cloned();
    Ok(LensFile {
        lens: file.lens.lens(path)?,
        size,
        response,
        noise: file.sensor.as_ref().map_or(Ok(None), |sensor| sensor.noise(path))?,
        levels: file.sensor.and_then(|s| Some(Levels { black: s.black?, white: s.white? })),
        lens_table: table("lens").unwrap_or_default(),
        response_table: table("response"),
        calibration_table: file.calibration,
        shown: file.lens.shown(path)?,
        notes: Vec::new(),
    })
}

/// Returns the `[lens]` table of `lens` for images of `size`, without the vignetting.
#[must_use]
pub fn lens_table(lens: &Lens, size: [u32; 2]) -> Table {
    let p = lens.intrinsics();
    let list = |v: &[f64]| Value::from(v.to_vec());
    let k = p.model.coefficients();
    let mut table = Table::new();
    table.insert("model".into(), p.model.name().into());
    table.insert("size".into(), size.map(i64::from).to_vec().into());
    table.insert("centre".into(), list(&p.centre_px.to_array()));
    table.insert("focal".into(), list(&p.focal_px.to_array()));
    if p.skew_px != 0.0 {
        table.insert("skew".into(), p.skew_px.into());
    }
    if !k.is_empty() {
        table.insert("k".into(), list(k));
    }
    table.insert("max_angle_deg".into(), p.max_theta.to_degrees().into());
    table
}
