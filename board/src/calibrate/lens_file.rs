//! Writing of lens files: the lens, its accuracy and its origin.

use super::{Calibrated, CircleLens, FittedResponse, FittedVignetting, Kind};
use crate::replacement;
use hemilux_core::lens::Model;
use std::io::Write;
use std::path::Path;
use toml_edit::{Array, DocumentMut, Item, Table, value};

/// Reasons why a lens file is not written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileRefusal {
    /// The existing file is better than the new lens, or its accuracy is unknown.
    #[error("{path}: found {found}, expected a worse lens or none: use --force to overwrite it")]
    Better {
        /// Path of the lens file.
        path: String,
        /// Description of the lens in the existing file.
        found: String,
    },
    /// The file cannot be written or read.
    #[error("{path}: found {found}, expected a file that can be written")]
    Io {
        /// Path of the lens file.
        path: String,
        /// Description of the error in the file.
        found: String,
    },
}

/// Largest size of a lens file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Properties of the calibration pictures that the user states.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stated {
    /// Side of a square of the board, millimetres.
    pub square_mm: Option<f64>,
    /// Left edge, top edge, columns and rows of the part of the sensor that the pictures cover, sensor pixels.
    pub crop: Option<[u32; 4]>,
    /// Number of sensor pixels per picture pixel, along rows and columns.
    pub binning: Option<[u32; 2]>,
}

/// Writes the lens to the file at `path`; the tables `[response]` and `[sensor]` and the vignetting of an existing file are kept.
///
/// # Errors
/// [`FileRefusal`]: without `force`, an existing file is kept if it states a smaller uncertainty, a larger covered field, or no accuracy.
pub fn write(path: &Path, calibrated: &Calibrated, stated: &Stated, force: bool) -> Result<(), FileRefusal> {
    let mut document = read(path, force)?;
    let new = Accuracy { typical_deg: typical(calibrated), covered_deg: calibrated.covered_deg };
    if let (Some(found), false) = (better(&document, new), force) {
        return Err(FileRefusal::Better { path: path.display().to_string(), found });
    }
    fill(&mut document, calibrated, stated);
    save(path, &document.to_string())
}

pub(super) fn failed(path: &Path, found: &dyn std::fmt::Display) -> FileRefusal {
    let found = found.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    FileRefusal::Io { path: path.display().to_string(), found }
}

/// Reads the lens file at `path`; returns an empty document if there is none. A file of another kind is replaced only with `force`.
pub(super) fn read(path: &Path, force: bool) -> Result<DocumentMut, FileRefusal> {
    use std::io::Read;
    let file = match std::fs::File::open(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(DocumentMut::new()),
        opened => opened.map_err(|e| failed(path, &e))?,
    };
    let mut text = String::new();
    let read = file.take(MOST_BYTES).read_to_string(&mut text).map_err(|e| failed(path, &e));
    match (read.map(|_| text.parse::<DocumentMut>()), force) {
        (Ok(Ok(document)), _) => Ok(document),
        (_, true) => Ok(DocumentMut::new()),
        _ => Err(FileRefusal::Better {
            path: path.display().to_string(),
            found: "a file that is not a lens file of hemilux".into(),
        }),
    }
}

/// The accuracy of a lens, as the table `[calibration]` of a lens file states it.
#[derive(Clone, Copy, Debug)]
struct Accuracy {
    /// Mean uncertainty of directions over the angles from the axis, degrees.
    typical_deg: f64,
    covered_deg: f64,
}

/// Returns the reason why `new` must not replace the lens in `document`; `None` if it may.
fn better(document: &DocumentMut, new: Accuracy) -> Option<String> {
    document.get("lens")?;
    let number =
        |name: &str| document.get("calibration").and_then(|table| table.get(name)).and_then(Item::as_float);
    let (Some(uncertainty), Some(covered)) = (number("typical_uncertainty_deg"), number("covered_deg"))
    else {
        return Some("a lens that does not state its uncertainty".into());
    };
    let Accuracy { typical_deg, covered_deg } = new;
    if uncertainty < 0.95 * typical_deg {
        return Some(format!(
            "a lens of {uncertainty:.3} degrees uncertainty, smaller than the new one's {typical_deg:.3}"
        ));
    }
    // The field of a lens from an image circle is a statement of the user, not an angle that pictures of a board cover.
    let is_measured = number("circle_px").is_none();
    let larger = is_measured && covered > covered_deg + 3.0;
    larger
        .then(|| format!("a lens that covers {covered:.1} degrees, more than the new one's {covered_deg:.1}"))
}

/// Writes the lens of an image circle to the file at `path`; the tables and the vignetting of an existing file are kept.
///
/// # Errors
/// [`FileRefusal`]: without `force`, an existing file is kept if it states a smaller uncertainty or none.
pub fn write_circle(path: &Path, new: &CircleLens, force: bool) -> Result<(), FileRefusal> {
    let mut document = read(path, force)?;
    let typical_deg = new.spread.iter().map(|[_, u]| u).sum::<f64>() / new.spread.len().max(1) as f64;
    let covered_deg = new.lens.intrinsics().max_theta.to_degrees();
    if let (Some(found), false) = (better(&document, Accuracy { typical_deg, covered_deg }), force) {
        return Err(FileRefusal::Better { path: path.display().to_string(), found });
    }
    let p = new.lens.intrinsics();
    let mut lens = Table::new();
    lens["model"] = value("equidistant");
    lens["size"] = value(new.size.iter().map(|n| *n as i64).collect::<Array>());
    lens["centre"] = array(p.centre_px.to_array().map(|v| rounded(v, 4)));
    lens["focal"] = array(p.focal_px.to_array().map(|v| rounded(v, 4)));
    lens["max_angle_deg"] = value(rounded(covered_deg, 2));
    let mut statement = Table::new();
    statement["method"] = value("circle");
    statement["covered_deg"] = value(rounded(covered_deg, 2));
    statement["circle_px"] = value(rounded(new.circle.radius, 3));
    statement["circle_deviation_px"] = value(rounded(new.circle.deviation_px, 3));
    statement["typical_uncertainty_deg"] = value(rounded(typical_deg, 5));
    statement["angle_deg"] = array(new.spread.iter().map(|[angle, _]| rounded(*angle, 2)));
    statement["uncertainty_deg"] = array(new.spread.iter().map(|[_, u]| rounded(*u, 5)));
    replace(&mut document, lens, statement);
    save(path, &document.to_string())
}

/// Replaces the lens in the document and the statement of its accuracy; the vignetting is kept.
fn replace(document: &mut DocumentMut, mut lens: Table, statement: Table) {
    if document.get("version").is_none() {
        document["version"] = value(1);
    }
    if let Some(kept) = document.get("lens").and_then(|lens| lens.get("vignetting")).cloned() {
        lens.insert("vignetting", kept);
    }
    document["lens"] = Item::Table(lens);
    document["calibration"] = Item::Table(statement);
}

/// Returns the mean uncertainty of directions over the angles from the axis, degrees.
#[must_use]
fn typical(calibrated: &Calibrated) -> f64 {
    let count = calibrated.spread.len().max(1) as f64;
    calibrated.spread.iter().map(|s| s.uncertainty_deg).sum::<f64>() / count
}

fn fill(document: &mut DocumentMut, calibrated: &Calibrated, stated: &Stated) {
    let mut lens = lens_table(calibrated);
    let whole = |values: &[u32]| value(values.iter().map(|n| i64::from(*n)).collect::<Array>());
    if let Some(crop) = stated.crop {
        lens.insert("crop", whole(&crop));
    }
    if let Some(binning) = stated.binning {
        lens.insert("binning", whole(&binning));
    }
    replace(document, lens, statement(calibrated, stated.square_mm));
}

/// Writes the `[response]` table into an existing lens file.
///
/// # Errors
/// [`FileRefusal`] if the file has no lens or, without `force`, has a response already.
pub fn write_response(path: &Path, fitted: &FittedResponse, force: bool) -> Result<(), FileRefusal> {
    let mut document = read(path, false)?;
    if document.get("lens").is_none() {
        return Err(failed(path, &"no [lens] table: compute the lens first"));
    }
    if document.get("response").is_some() && !force {
        return Err(FileRefusal::Better { path: path.display().to_string(), found: "a [response]".into() });
    }
    document["response"] = Item::Table(response_table(fitted));
    save(path, &document.to_string())
}

/// Writes the vignetting into the `[lens]` table of an existing lens file.
///
/// # Errors
/// [`FileRefusal`] if the file has no lens or, without `force`, has a vignetting already.
pub fn write_vignetting(path: &Path, fitted: &FittedVignetting, force: bool) -> Result<(), FileRefusal> {
    let mut document = read(path, false)?;
    let Some(lens) = document.get_mut("lens").and_then(Item::as_table_like_mut) else {
        return Err(failed(path, &"no [lens] table: compute the lens first"));
    };
    if lens.contains_key("vignetting") && !force {
        return Err(FileRefusal::Better { path: path.display().to_string(), found: "a vignetting".into() });
    }
    lens.insert("vignetting", array(fitted.coefficients.map(|v| rounded(v, 9))));
    if document.get("calibration").is_none() {
        document["calibration"] = Item::Table(Table::new());
    }
    let statement = &mut document["calibration"];
    statement["vignetting_rms"] = value(rounded(fitted.rms, 5));
    statement["vignetting_covered_deg"] = value(rounded(fitted.covered.to_degrees(), 2));
    save(path, &document.to_string())
}

/// Returns the `[response]` table of a lens file as TOML text.
#[must_use]
pub fn response_text(fitted: &FittedResponse) -> String {
    let mut document = DocumentMut::new();
    document["response"] = Item::Table(response_table(fitted));
    document.to_string()
}

fn response_table(fitted: &FittedResponse) -> Table {
    let mut table = Table::new();
    table["model"] = value("bernstein");
    for (name, coefficients) in ["red", "green", "blue"].into_iter().zip(fitted.coefficients) {
        table[name] = array(coefficients.map(|v| rounded(v, 9)));
    }
    table
}

fn array(values: impl IntoIterator<Item = f64>) -> Item {
    value(values.into_iter().collect::<Array>())
}

/// Returns a TOML array of `tables`.
pub(super) fn array_of(tables: impl Iterator<Item = Table>) -> Item {
    Item::ArrayOfTables(tables.collect())
}

/// Rounds a number to `places` decimals.
pub(super) fn rounded(v: f64, places: i32) -> f64 {
    let scale = 10f64.powi(places);
    (v * scale).round() / scale
}

fn lens_table(calibrated: &Calibrated) -> Table {
    let p = calibrated.lens.intrinsics();
    let k = if let Model::KannalaBrandt(k) = p.model { k } else { [0.0; 4] };
    let mut table = Table::new();
    table["model"] = value("kannala-brandt");
    table["size"] = value(calibrated.size.iter().map(|n| *n as i64).collect::<Array>());
    table["centre"] = array(p.centre_px.to_array().map(|v| rounded(v, 4)));
    table["focal"] = array(p.focal_px.to_array().map(|v| rounded(v, 4)));
    table["k"] = array(k.map(|v| rounded(v, 9)));
    table["max_angle_deg"] = value((p.max_theta.to_degrees() * 100.0).floor() / 100.0);
    table
}

fn statement(calibrated: &Calibrated, square_mm: Option<f64>) -> Table {
    let mut table = Table::new();
    let d = calibrated.deviations;
    table["method"] = value(match calibrated.board.kind {
        Kind::Chessboard => "chessboard",
        Kind::Charuco(_) => "charuco",
        Kind::AprilGrid { .. } => "aprilgrid",
    });
    table["board"] = value(calibrated.board.corners.to_string());
    if let Some(side) = square_mm {
        table["square_mm"] = value(side);
    }
    table["pictures"] = value(calibrated.used.len() as i64);
    table["boards"] = value(calibrated.boards() as i64);
    table["corners"] = value(calibrated.corners() as i64);
    table["left_out"] = value(calibrated.left_out as i64);
    table["rms_px"] = value(rounded(calibrated.rms_px, 4));
    table["largest_px"] = value(rounded(calibrated.largest_px, 4));
    table["covered_deg"] = value(rounded(calibrated.covered_deg, 2));
    table["board_bulge_squares"] = value(rounded(calibrated.bulge, 5));
    table["focal_deviation_px"] = array([d[0], d[1]].map(|v| rounded(v, 4)));
    table["centre_deviation_px"] = array([d[2], d[3]].map(|v| rounded(v, 4)));
    table["k_deviation"] = array([d[4], d[5], d[6], d[7]].map(|v| rounded(v, 9)));
    table["typical_uncertainty_deg"] = value(rounded(typical(calibrated), 5));
    table["angle_deg"] = array(calibrated.spread.iter().map(|s| rounded(s.angle_deg, 2)));
    table["uncertainty_deg"] = array(calibrated.spread.iter().map(|s| rounded(s.uncertainty_deg, 5)));
    table["law_deg"] = array(calibrated.spread.iter().map(|s| rounded(s.law_deg, 5)));
    if calibrated.spread.iter().all(|s| s.halves_deg.is_some()) {
        table["halves_deg"] =
            array(calibrated.spread.iter().filter_map(|s| s.halves_deg).map(|v| rounded(v, 5)));
    }
    table
}

/// Writes `text` to the file at `path` atomically: a reader gets the old or the new content.
pub(super) fn save(path: &Path, text: &str) -> Result<(), FileRefusal> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = replacement::create(folder).map_err(|e| failed(path, &e))?;
    file.write_all(text.as_bytes()).map_err(|e| failed(path, &e))?;
    set_readable(&file).map_err(|e| failed(path, &e))?;
    file.persist(path).map(|_| ()).map_err(|e| failed(path, &e.error))
}

/// Makes the temporary file readable for all users, since such files are created for their owner alone.
fn set_readable(file: &tempfile::NamedTempFile) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))
}
