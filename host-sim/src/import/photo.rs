//! Reader of the EXIF data that determine the exposure of a photograph.

use super::function::Transfer;
use super::transfer;
use crate::error::SimError;
use exif::{Exif, In, Tag, Value};
use std::io::BufReader;
use std::path::{Path, PathBuf};

const EXPECTED: &str = "a JPEG or PNG photograph with EXIF data";

/// Exposure, transfer function and camera settings of a photograph, from its EXIF data.
pub(super) struct Photo {
    pub path: PathBuf,
    /// Exposure time of the photograph, seconds.
    pub seconds: f64,
    /// ISO sensitivity of the photograph, if stated.
    pub iso: Option<f64>,
    /// Aperture of the photograph as f-number, if stated.
    pub aperture: Option<f64>,
    pub transfer: Transfer,
    /// EXIF fields whose values must be equal in all photographs of a burst.
    pub same: Vec<CommonField>,
}

/// An EXIF field whose value must be equal in all photographs of a burst.
#[derive(PartialEq)]
pub(super) struct CommonField {
    pub name: &'static str,
    pub value: Option<String>,
}

impl CommonField {
    /// Returns the value of the field, or "none".
    pub fn shown(&self) -> String {
        self.value.clone().unwrap_or_else(|| "none".into())
    }
}

impl Photo {
    /// Reads the EXIF data of a file; with `ignores_profile`, stated colour spaces are ignored.
    pub fn read(path: &Path, ignores_profile: bool) -> Result<Self, SimError> {
        let refused = |found: String| SimError::at(path, found, EXPECTED);
        let transfer = transfer::read(path, ignores_profile)?;
        let file = std::fs::File::open(path).map_err(|e| refused(e.to_string()))?;
        let mut reader = exif::Reader::new();
        // Many programs write blocks in which one field is invalid and the others are valid; an invalid required field is reported as
        // missing.
        reader.continue_on_error(true);
        let exif = reader.read_from_container(&mut BufReader::new(file));
        let exif = exif.or_else(|e| e.distill_partial_result(|_| {}));
        let exif = exif.map_err(|e| refused(format!("no EXIF data ({e})")))?;
        let apex =
            |tag| apex(&exif, tag).map_err(|found| SimError::at(path, found, "an APEX value of -64 to 64"));
        let seconds = number(&exif, Tag::ExposureTime).filter(|s| *s > 0.0);
        let seconds = seconds.or(apex(Tag::ShutterSpeedValue)?.map(f64::recip));
        let seconds = seconds.ok_or_else(|| {
            SimError::at(path, "EXIF data without an exposure time", "ExposureTime, positive seconds")
        })?;
        let aperture = number(&exif, Tag::FNumber).filter(|n| *n > 0.0);
        let aperture = aperture.or(apex(Tag::ApertureValue)?.map(f64::sqrt));
        if let Some(space) = other_colour_space(&exif).filter(|_| !ignores_profile) {
            return Err(SimError::at(path, space, transfer::EXPECTED));
        }
        let text = |tag| exif.get_field(tag, In::PRIMARY).map(|f| f.display_value().to_string());
        let iso = sensitivity(&exif).map_err(|found| SimError::at(path, found, "an ISO sensitivity"))?;
        let stated = |name, is: bool| CommonField { name, value: is.then(|| "stated".into()) };
        let camera = [Tag::Make, Tag::Model].into_iter().filter_map(text).collect::<Vec<_>>().join(" ");
        let same = vec![
            CommonField { name: "the camera", value: Some(camera).filter(|c| !c.is_empty()) },
            CommonField { name: "the lens", value: text(Tag::LensModel) },
            CommonField { name: "the focal length", value: text(Tag::FocalLength) },
            CommonField { name: "the white balance", value: text(Tag::WhiteBalance) },
            CommonField { name: "the light source", value: text(Tag::LightSource) },
            CommonField { name: "the flash", value: text(Tag::Flash) },
            CommonField { name: "the digital zoom", value: text(Tag::DigitalZoomRatio) },
            stated("the ISO sensitivity", iso.is_some()),
            stated("the f-number", aperture.is_some()),
        ];
        Ok(Self { path: path.into(), seconds, iso, aperture, transfer, same })
    }

    /// Returns the file name of the photograph.
    pub fn file(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Returns the gain of the photograph: the ISO sensitivity over 100, divided by the square of the f-number; without a stated value, 100
    /// and 1 are used.
    pub fn gain(&self) -> f64 {
        self.iso.unwrap_or(100.0) / 100.0 / self.aperture.unwrap_or(1.0).powi(2)
    }

    /// Returns the exposure of the photograph: the exposure time in seconds times the gain.
    pub fn light(&self) -> f64 {
        self.seconds * self.gain()
    }
}

/// Returns the ISO sensitivity. The 16-bit field of EXIF contains 65535 for larger values, which other fields contain.
fn sensitivity(exif: &Exif) -> Result<Option<f64>, String> {
    let positive = |tag| number(exif, tag).filter(|v| *v > 0.0);
    let iso = positive(Tag::PhotographicSensitivity);
    if iso != Some(65535.0) {
        return Ok(iso);
    }
    let larger = [Tag::RecommendedExposureIndex, Tag::StandardOutputSensitivity, Tag::ISOSpeed];
    let found = larger.into_iter().find_map(positive);
    found
        .map(Some)
        .ok_or_else(|| "PhotographicSensitivity 65535 without a field for the larger number".into())
}

/// Returns the name of a stated colour space other than sRGB. Cameras state Adobe RGB by the interoperability index R03, some by ColorSpace 2.
fn other_colour_space(exif: &Exif) -> Option<String> {
    let index =
        exif.get_field(Tag::InteroperabilityIndex, In::PRIMARY).map(|f| f.display_value().to_string());
    let is_adobe = index.is_some_and(|i| i.contains("R03")) || number(exif, Tag::ColorSpace) == Some(2.0);
    is_adobe.then(|| "the EXIF colour space Adobe RGB".into())
}

/// Returns two to the power of a field's APEX value: the reciprocal of an exposure time in seconds, or the square of an f-number.
fn apex(exif: &Exif, tag: Tag) -> Result<Option<f64>, String> {
    let Some(value) = number(exif, tag) else { return Ok(None) };
    if value.abs() > 64.0 { Err(format!("{tag} {value}")) } else { Ok(Some(value.exp2())) }
}

/// Returns the first number of a field; `None` if the field is missing or not finite.
fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let value = match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => v.first()?.to_f64(),
        Value::SRational(v) => v.first()?.to_f64(),
        other => f64::from(other.get_uint(0)?),
    };
    Some(value).filter(|v| v.is_finite())
}
