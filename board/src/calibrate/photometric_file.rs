//! The `[photometric]` table of a lens file: readings by class of light source, and the factor of each class.

use super::factor::{Factor, Verdict, combine};
use super::lens_file::{FileRefusal, array_of, failed, read, rounded, save};
use super::photometric::FactorReading;
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, value};

/// Reasons why a photometric reading is not stored.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum KeepRefusal {
    /// The lens file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileRefusal),
    /// The reading differs too much from the earlier readings of its class.
    #[error(
        "{path}: found a factor {percent:.0} % off that of the earlier readings of the class {class:?}, expected at most 25 %: measure again, \
         name another --class for another kind of light, or --fresh to drop the earlier readings"
    )]
    Far {
        /// Path of the lens file.
        path: String,
        /// Class of the light source.
        class: String,
        /// Difference from the factor of the earlier readings, per cent.
        percent: f64,
    },
    /// The stored readings were made with other settings of the camera than the new one.
    #[error(
        "{path}: found readings by another response, level or vignetting than the source has, expected readings of one camera: --fresh drops them"
    )]
    OtherCamera {
        /// Path of the lens file.
        path: String,
    },
}

/// A photometric reading and the values that are stored with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept<'a> {
    /// The measured factor, which is added to the file.
    pub reading: &'a FactorReading,
    /// Class of the light source.
    pub class: &'a str,
    /// Value of [`crate::recorded::radiometry`] for the camera of the reading.
    pub camera: &'a str,
}

/// The readings of one class of light source in a lens file.
#[derive(Clone, Debug)]
pub struct KeptReadings {
    /// The photometric factor that results from the readings.
    pub factor: Factor,
    /// Number of readings of the class in the file.
    pub count: usize,
}

/// Adds a reading to the lens file at `path`, which need not exist, and writes the factor that results from the readings of its class. With
/// `fresh`, earlier readings of the class and all readings of another camera are dropped.
///
/// # Errors
/// [`KeepRefusal`] if the reading contradicts the stored ones or the file cannot be written.
pub fn keep_reading(path: &Path, kept: &Kept<'_>, fresh: bool) -> Result<KeptReadings, KeepRefusal> {
    let mut document = read(path, false)?;
    let name = || path.display().to_string();
    let is_other = camera(&document).is_some_and(|camera| camera != kept.camera);
    if is_other && !fresh {
        return Err(KeepRefusal::OtherCamera { path: name() });
    }
    if is_other {
        document.remove("photometric");
    }
    let mut readings = if fresh { Vec::new() } else { earlier(&document, kept.class) };
    if let Some(before) = combine(&readings) {
        let off = kept.reading.factor / before.factor - 1.0;
        if Verdict::of(off) == Verdict::Reject {
            let class = kept.class.to_owned();
            return Err(KeepRefusal::Far { path: name(), class, percent: 100.0 * off.abs() });
        }
    }
    readings.push(kept.reading.clone());
    let factor = combine(&readings).ok_or_else(|| failed(path, &"readings without a factor"))?;
    fill(&mut document, kept, &readings, &factor);
    save(path, &document.to_string())?;
    Ok(KeptReadings { factor, count: readings.len() })
}

/// Returns the factor that results from the readings of `class` in the lens file at `path`.
///
/// # Errors
/// [`FileRefusal`] if the lens file cannot be read.
pub fn kept_factor(path: &Path, class: &str) -> Result<Option<Factor>, FileRefusal> {
    Ok(combine(&earlier(&read(path, false)?, class)))
}

fn camera(document: &DocumentMut) -> Option<&str> {
    document.get("photometric")?.get("camera")?.as_str()
}

fn earlier(document: &DocumentMut, class: &str) -> Vec<FactorReading> {
    let table = document.get("photometric").and_then(|t| t.get("class")).and_then(|t| t.get(class));
    let tables = table.and_then(|t| t.get("reading")).and_then(Item::as_array_of_tables);
    let reading = |table: &Table| {
        let number = |key: &str| table.get(key).and_then(Item::as_float);
        Some(FactorReading {
            method: table.get("method")?.as_str()?.to_owned(),
            factor: number("factor").filter(|v| *v > 0.0)?,
            own: number("own").filter(|v| *v >= 0.0)?,
            shared: number("shared").filter(|v| *v >= 0.0)?,
            unseen: number("unseen")?,
        })
    };
    tables.into_iter().flatten().filter_map(reading).collect()
}

fn fill(document: &mut DocumentMut, kept: &Kept<'_>, readings: &[FactorReading], factor: &Factor) {
    if document.get("version").is_none() {
        document["version"] = value(1);
    }
    let implicit = || {
        let mut table = Table::new();
        table.set_implicit(true);
        Item::Table(table)
    };
    let photometric = document.entry("photometric").or_insert_with(|| Item::Table(Table::new()));
    photometric["camera"] = value(kept.camera);
    if photometric.get("class").is_none() {
        photometric["class"] = implicit();
    }
    let mut class = Table::new();
    class["factor"] = value(significant(factor.factor));
    class["uncertainty"] = value(rounded(factor.uncertainty, 5));
    class["reading"] = array_of(readings.iter().map(table));
    photometric["class"][kept.class] = Item::Table(class);
}

fn table(reading: &FactorReading) -> Table {
    let mut table = Table::new();
    table["method"] = value(reading.method.as_str());
    table["factor"] = value(significant(reading.factor));
    for (name, v) in [("own", reading.own), ("shared", reading.shared), ("unseen", reading.unseen)] {
        table[name] = value(rounded(v, 5));
    }
    table
}

/// Rounds a number to seven significant digits.
fn significant(v: f64) -> f64 {
    format!("{v:.6e}").parse().unwrap_or(v)
}
