//! Lens files with what is known of how they came about.

use super::{Calibrated, FittedResponse, FittedVignetting};
use hemilux_core::lens::Model;
use std::io::Write;
use std::path::Path;
use toml_edit::{Array, DocumentMut, Item, Table, value};

/// Why a lens file was not written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FileRefusal {
    /// The existing file is better than the new lens, or not known to be worse.
    #[error("{path}: found {found}, expected a worse lens or none: use --force to overwrite it")]
    Better {
        /// The file.
        path: String,
        /// What is there.
        found: String,
    },
    /// The file cannot be written or read.
    #[error("{path}: found {found}, expected a file that can be written")]
    Io {
        /// The file.
        path: String,
        /// What went wrong.
        found: String,
    },
}

/// Largest lens file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Writes the lens to a file; the tables `[response]` and `[sensor]` and the vignetting of a file that is there are kept.
///
/// # Errors
/// [`FileRefusal`]: without `force`, a file that states a smaller uncertainty or a larger covered field, or none, is not overwritten.
pub fn write(
    path: &Path,
    calibrated: &Calibrated,
    square_mm: Option<f64>,
    force: bool,
) -> Result<(), FileRefusal> {
    let mut document = read(path, force)?;
    if let (Some(found), false) = (better(&document, calibrated), force) {
        return Err(FileRefusal::Better { path: path.display().to_string(), found });
    }
    fill(&mut document, calibrated, square_mm);
    save(path, &document.to_string())
}

fn failed(path: &Path, found: &dyn std::fmt::Display) -> FileRefusal {
    let found = found.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    FileRefusal::Io { path: path.display().to_string(), found }
}

/// The file that is there, or an empty one. A file that is no lens file of hemilux is replaced by `force` alone.
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
            found: "a file that is no lens file of hemilux".into(),
        }),
    }
}

/// Why the lens in `document` must not be replaced by `new`, as a phrase for people; `None` where it may be replaced.
fn better(document: &DocumentMut, new: &Calibrated) -> Option<String> {
    document.get("lens")?;
    let number =
        |name: &str| document.get("calibration").and_then(|table| table.get(name)).and_then(Item::as_float);
    let (Some(uncertainty), Some(covered)) = (number("typical_uncertainty_deg"), number("covered_deg"))
    else {
        return Some("a lens that does not state its uncertainty".into());
    };
    if uncertainty < 0.95 * typical(new) {
        return Some(format!(
            "a lens of {uncertainty:.3} degrees uncertainty, smaller than the new one's {:.3}",
            typical(new)
        ));
    }
    let larger = covered > new.covered_deg + 3.0;
    larger.then(|| {
        format!("a lens that covers {covered:.1} degrees, more than the new one's {:.1}", new.covered_deg)
    })
}

/// The mean uncertainty over the angles.
#[must_use]
fn typical(calibrated: &Calibrated) -> f64 {
    let count = calibrated.spread.len().max(1) as f64;
    calibrated.spread.iter().map(|s| s.uncertainty_deg).sum::<f64>() / count
}

fn fill(document: &mut DocumentMut, calibrated: &Calibrated, square_mm: Option<f64>) {
    if document.get("version").is_none() {
        document["version"] = value(1);
    }
    let kept = document.get("lens").and_then(|lens| lens.get("vignetting")).cloned();
    let mut lens = lens_table(calibrated);
    if let Some(kept) = kept.filter(|_| calibrated.lens.intrinsics().max_theta > 0.0) {
        lens.insert("vignetting", kept);
    }
    document["lens"] = Item::Table(lens);
    document["calibration"] = Item::Table(statement(calibrated, square_mm));
}

/// Writes the `[response]` table of a lens file that exists.
///
/// # Errors
/// [`FileRefusal`]: no lens file, or, without `force`, one that has a response.
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

/// Writes the vignetting into the `[lens]` table of a lens file that exists.
///
/// # Errors
/// [`FileRefusal`]: no lens file, or, without `force`, one that has a vignetting.
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

/// The `[response]` table as text.
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

/// A number with `places` decimals: more say nothing.
fn rounded(v: f64, places: i32) -> f64 {
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
    table["method"] = value("chessboard");
    table["board"] = value(calibrated.board.to_string());
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

/// Writes a file whole: a reader sees the old or the new one.
pub(super) fn save(path: &Path, text: &str) -> Result<(), FileRefusal> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(|e| failed(path, &e))?;
    file.write_all(text.as_bytes()).map_err(|e| failed(path, &e))?;
    set_readable(&file).map_err(|e| failed(path, &e))?;
    file.persist(path).map(|_| ()).map_err(|e| failed(path, &e.error))
}

/// A temporary file is its owner's alone; a lens file may be read by all.
fn set_readable(file: &tempfile::NamedTempFile) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))
}
