//! What one photograph states about its exposure.

use super::transfer::{self, Transfer};
use crate::error::SimError;
use exif::{Exif, In, Tag, Value};
use std::io::BufReader;
use std::path::{Path, PathBuf};

const EXPECTED: &str = "a JPEG or PNG photograph with EXIF data";

/// A photograph.
pub(super) struct Photo {
    pub path: PathBuf,
    /// Exposure time, seconds.
    pub seconds: f64,
    pub iso: Option<f64>,
    /// The f-number.
    pub aperture: Option<f64>,
    pub transfer: Transfer,
    /// Statements that are the same in all photographs of a burst.
    pub same: Vec<Same>,
}

/// A statement that all photographs of a burst share.
#[derive(PartialEq)]
pub(super) struct Same {
    pub name: &'static str,
    pub value: Option<String>,
}

impl Same {
    pub fn shown(&self) -> String {
        self.value.clone().unwrap_or_else(|| "none".into())
    }
}

impl Photo {
    /// Reads the EXIF data.
    pub fn read(path: &Path) -> Result<Self, SimError> {
        let refused = |found: String| SimError::at(path, found, EXPECTED);
        let transfer = transfer::read(path)?;
        let file = std::fs::File::open(path).map_err(|e| refused(e.to_string()))?;
        let exif = exif::Reader::new().read_from_container(&mut BufReader::new(file));
        let exif = exif.map_err(|e| refused(format!("no EXIF data ({e})")))?;
        let seconds = number(&exif, Tag::ExposureTime).filter(|s| *s > 0.0);
        let seconds = seconds.ok_or_else(|| {
            SimError::at(path, "EXIF data without an exposure time", "ExposureTime, positive seconds")
        })?;
        let positive = |tag| number(&exif, tag).filter(|v| *v > 0.0);
        let text = |tag| exif.get_field(tag, In::PRIMARY).map(|f| f.display_value().to_string());
        let camera = [Tag::Make, Tag::Model].into_iter().filter_map(text).collect::<Vec<_>>().join(" ");
        let same = vec![
            Same { name: "the camera", value: Some(camera).filter(|c| !c.is_empty()) },
            Same { name: "the lens", value: text(Tag::LensModel) },
            Same { name: "the focal length", value: text(Tag::FocalLength) },
            Same { name: "the white balance", value: text(Tag::WhiteBalance) },
        ];
        Ok(Self {
            path: path.into(),
            seconds,
            iso: positive(Tag::PhotographicSensitivity),
            aperture: positive(Tag::FNumber),
            transfer,
            same,
        })
    }

    /// The name of the file.
    pub fn file(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Sensitivity over the area of the f-number's square; 100 and 1 where not stated.
    pub fn gain(&self) -> f64 {
        self.iso.unwrap_or(100.0) / 100.0 / self.aperture.unwrap_or(1.0).powi(2)
    }

    /// Relative exposure of one radiance.
    pub fn light(&self) -> f64 {
        self.seconds * self.gain()
    }
}

/// The first number of a field.
fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let value = match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => v.first()?.to_f64(),
        other => f64::from(other.get_uint(0)?),
    };
    Some(value).filter(|v| v.is_finite())
}
