//! Lens files of other programs: OpenCV (YAML, JSON, XML), Kalibr camchains, ROS `camera_info`, COLMAP `cameras.txt` and OCamCalib
//! text.
//!
//! Models that [`hemilux_core::lens`] has are used unchanged; other models are fitted by a Kannala-Brandt polynomial, and the largest
//! deviation is noted in degrees. None of these files states a field of view: the lens covers the image up to `MAX_ANGLE_DEG` off axis.

mod colmap;
mod fit;
mod keys;
mod model;
mod ocam;
#[cfg(test)]
mod tests;
mod tree;

use super::RecordedError;
use hemilux_core::lens::Lens;
use model::ForeignCamera;
use std::path::Path;

/// Largest angle off axis of a lens whose file states no field of view: a probe uses the upper hemisphere alone.
const MAX_ANGLE_DEG: f64 = 90.0;

const EXPECTED: &str = "a [lens] table, or a lens file of OpenCV, Kalibr, ROS, COLMAP or OCamCalib";

/// Descriptions of the content that was found in a lens file and of the content that was expected.
type Refusal = (String, String);

fn refuse<T>(found: impl Into<String>, expected: impl Into<String>) -> Result<T, Refusal> {
    Err((found.into(), expected.into()))
}

/// The contents of a lens file of another program.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ForeignLens {
    /// Lens model that the file states.
    pub(super) lens: Lens,
    /// Columns and rows of the camera's image.
    pub(super) size: [u32; 2],
    /// Notes about values that were fitted or assumed.
    pub(super) notes: Vec<String>,
}

/// Reads a lens file in the format of another program.
pub(super) fn read(path: &Path, text: &str) -> Result<ForeignLens, RecordedError> {
    parse(text).map_err(|(found, expected)| RecordedError::new(path, found, expected))
}

fn parse(text: &str) -> Result<ForeignLens, Refusal> {
    let mut notes = Vec::new();
    let camera = camera(text, &mut notes)?;
    let fitted = fit::lens(&camera)?;
    if let Some(degrees) = fitted.deviation_deg {
        notes.push(format!(
            "{} fitted by kannala-brandt, off by at most {degrees:.4} degrees",
            camera.model.name()
        ));
    }
    let degrees = fitted.lens.intrinsics().max_theta.to_degrees();
    notes.push(format!("the file states no field of view: {degrees:.2} degrees off axis are assumed"));
    Ok(ForeignLens { lens: fitted.lens, size: camera.size, notes })
}

/// Returns the camera that the text of a lens file describes; the kind of file follows from its contents.
fn camera(text: &str, notes: &mut Vec<String>) -> Result<ForeignCamera, Refusal> {
    let begin = text.trim_start_matches('\u{feff}').trim_start();
    if ocam::is(begin) {
        return ocam::parse(text);
    }
    if colmap::is(begin) {
        return colmap::parse(text, notes);
    }
    let tree = if begin.starts_with('<') { tree::from_xml(text)? } else { tree::from_yaml(text)? };
    keys::camera(&tree, notes)
}
