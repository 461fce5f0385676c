//! Photometric calibrations: luminance per unit of radiance, by class of light source.

use super::RecordedError;
use super::manifest::{check_version, parse, read_text};
use crate::calibration::Calibration;
use hemilux_core::Response;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The class of light source of a calibration that states none.
pub const ANY_CLASS: &str = "any";

/// Luminance per unit of a camera's radiance, for one class of light source.
#[derive(Clone, Debug, PartialEq)]
pub struct Photometric {
    /// Class of light source: `any`, `daylight`, `led`, `warm` or another name.
    pub class: String,
    /// Candela per square metre per unit of radiance, and lux per unit of irradiance.
    pub factor: f64,
    /// Relative uncertainty of `factor` with 95 % coverage.
    pub uncertainty: f64,
    /// Value of [`radiometry`] for the camera with which the factor was measured.
    pub camera: String,
}

#[derive(Deserialize)]
struct File {
    #[serde(default = "one")]
    version: i64,
    photometric: Option<Table>,
}

fn one() -> i64 {
    1
}

/// The `[photometric]` table of a lens file, as it is stored.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    camera: String,
    class: BTreeMap<String, Class>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Class {
    factor: f64,
    uncertainty: f64,
    /// The readings that `hemilux calibrate photometric` combines to the factor of the class.
    #[allow(dead_code, reason = "checked for its type alone")]
    reading: Option<Vec<toml::Table>>,
}

/// Reads the photometric calibration of `class` from the table `[photometric]` of a lens file or of another file; without a class, that of
/// [`ANY_CLASS`] or of the only class.
///
/// # Errors
/// [`RecordedError`] for a file that cannot be read, a missing table, or an unknown class.
pub fn read_photometric(path: &Path, class: Option<&str>) -> Result<Photometric, RecordedError> {
    let found = parse_photometric(path, &read_text(path)?, class)?;
    found.ok_or_else(|| {
        let expected = "the table that hemilux calibrate photometric writes";
        RecordedError::new(path, "no [photometric] table", expected)
    })
}

/// Parses a photometric calibration from `text` like [`read_photometric`]; `None` without the table.
///
/// # Errors
/// [`RecordedError`] for wrong values or an unknown class.
pub fn parse_photometric(
    path: &Path,
    text: &str,
    class: Option<&str>,
) -> Result<Option<Photometric>, RecordedError> {
    let file: File = parse(path, text)?;
    check_version(path, file.version)?;
    let Some(table) = file.photometric else { return Ok(None) };
    let name = class.or_else(|| usual(&table.class));
    let Some((name, class)) = name.and_then(|name| table.class.get_key_value(name)) else {
        let found = class.map_or_else(|| "several classes of light".into(), |c| format!("no class {c:?}"));
        let known = table.class.into_keys().collect::<Vec<_>>().join(", ");
        return Err(RecordedError::new(path, found, format!("--light-class with one of: {known}")));
    };
    let Class { factor, uncertainty, .. } = *class;
    if !(factor > 0.0 && factor.is_finite() && (0.0..=1.0).contains(&uncertainty)) {
        let found = format!("factor = {factor}, uncertainty = {uncertainty} of the class {name:?}");
        return Err(RecordedError::new(path, found, "a positive factor and an uncertainty of 0 to 1"));
    }
    Ok(Some(Photometric { class: name.clone(), factor, uncertainty, camera: table.camera }))
}

/// Returns the digest of the camera in the `[photometric]` table; `None` without the table.
///
/// # Errors
/// [`RecordedError`] for a file that cannot be read.
pub fn photometric_camera(path: &Path) -> Result<Option<String>, RecordedError> {
    let text = read_text(path)?;
    if !text.contains("[photometric]") {
        return Ok(None);
    }
    Ok(parse::<File>(path, &text)?.photometric.map(|table| table.camera))
}

/// Returns the name of the class that is used if none is requested.
fn usual(classes: &BTreeMap<String, Class>) -> Option<&str> {
    let only = || classes.keys().next().filter(|_| classes.len() == 1).map(String::as_str);
    classes.contains_key(ANY_CLASS).then_some(ANY_CLASS).or_else(only)
}

/// Returns a digest of the conversion from a camera's codes to radiance: response, levels, scale, white balance and vignetting, without image
/// size and geometry of the lens.
#[must_use]
pub fn radiometry(calibration: &Calibration) -> String {
    let most = f64::from(calibration.layout.format().max_code());
    let levels = [calibration.levels.black / most, calibration.levels.white / most];
    let (kind, curve): (f64, &[f64]) = match &calibration.response {
        Response::Linear => (1.0, &[]),
        Response::Srgb => (2.0, &[]),
        Response::Polynomial(curve) => (3.0, curve.as_flattened()),
        Response::Bernstein(curve) => (4.0, curve.as_flattened()),
        _ => (5.0, &[]),
    };
    let balance = calibration.white_balance.map(f64::from);
    let numbers = [kind, calibration.scale].into_iter().chain(curve.iter().copied()).chain(balance);
    let numbers = numbers.chain(levels).chain(calibration.lens.intrinsics().vignetting);
    // The digest is FNV-1a over the numbers, each with seven significant digits.
    let bytes = numbers.flat_map(|v| format!("{v:.6e};").into_bytes());
    let digest = bytes
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{digest:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "version = 1\n[photometric]\ncamera = \"0\"\n[photometric.class.led]\nfactor = 120.0\nuncertainty = 0.05\n";

    fn read(text: &str, class: Option<&str>) -> Result<Option<Photometric>, RecordedError> {
        parse_photometric(Path::new("p.toml"), text, class)
    }

    #[test]
    fn the_only_class_or_the_named_class_is_used() {
        let led = read(FILE, None).expect("a file").expect("a calibration");
        assert_eq!((led.class.as_str(), led.factor, led.uncertainty), ("led", 120.0, 0.05));
        let two = format!("{FILE}[photometric.class.warm]\nfactor = 99.0\nuncertainty = 0.1\n");
        assert_eq!(read(&two, Some("warm")).expect("a file").expect("a class").factor, 99.0);
        for (class, word) in [(None, "several classes"), (Some("sun"), "\"sun\"")] {
            let line = read(&two, class).expect_err("no such class").to_string();
            assert!(line.contains(word) && line.contains("led, warm") && !line.contains('\n'), "{line}");
        }
        let any = format!("{two}[photometric.class.any]\nfactor = 1.0\nuncertainty = 0.1\n");
        assert_eq!(read(&any, None).expect("a file").expect("a class").class, ANY_CLASS);
    }

    #[test]
    fn a_missing_table_is_none_and_wrong_numbers_are_refused() {
        assert_eq!(read("version = 1\n[lens]\nmodel = \"equidistant\"\n", None).expect("a file"), None);
        for (from, to) in
            [("120.0", "-1.0"), ("120.0", "nan"), ("0.05", "2.0"), ("\"0\"", "0"), ("factor", "faktor")]
        {
            let line = read(&FILE.replace(from, to), None).expect_err(to).to_string();
            assert!(line.starts_with("p.toml: found") && !line.contains('\n'), "{line}");
        }
    }
}
