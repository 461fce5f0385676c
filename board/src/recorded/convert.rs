//! Conversion of lens files for hemilux, OpenCV and ROS.

use super::{LensFile, RecordedError, read_lens};
use hemilux_core::lens::Model;
use std::path::Path;
use toml::{Table, Value};

/// The program for which a lens file is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A `[lens]` table of hemilux.
    Hemilux,
    /// YAML of OpenCV's `cv::FileStorage`.
    Opencv,
    /// The YAML of ROS `camera_info_manager`.
    Ros,
}

/// A converted lens file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Converted {
    /// The text of the converted file.
    pub text: String,
    /// Notes about values that were fitted or omitted in the conversion.
    pub notes: Vec<String>,
}

/// Reads the lens file `path` of any supported program, and returns the text of the same lens in the format of `target`.
///
/// # Errors
/// [`RecordedError`] for a file that is not a lens file, or a lens for which the other program has no model.
pub fn convert(path: &Path, target: Target) -> Result<Converted, RecordedError> {
    let file = read_lens(path)?;
    let mut notes = file.notes.clone();
    let text = match target {
        Target::Hemilux => hemilux(&file),
        Target::Opencv | Target::Ros => {
            let camera = Yaml::of(&file).map_err(|found| {
                RecordedError::new(
                    path,
                    found,
                    "a kannala-brandt, equidistant or radial lens without vignetting",
                )
            })?;
            if camera.has_response {
                notes.push("the response and the levels are left out".into());
            }
            notes.push("the field of view is left out".into());
            if target == Target::Opencv { camera.opencv() } else { camera.ros() }
        }
    };
    Ok(Converted { text, notes })
}

fn hemilux(file: &LensFile) -> String {
    let mut all = Table::from_iter([("lens".to_string(), Value::Table(file.lens_table.clone()))]);
    if let Some(response) = &file.response_table {
        all.insert("response".into(), Value::Table(response.clone()));
    }
    if let Some(levels) = file.levels {
        let sensor =
            [("black", levels.black), ("white", levels.white)].map(|(k, v)| (k.to_string(), Value::from(v)));
        all.insert("sensor".into(), Value::Table(Table::from_iter(sensor)));
    }
    all.to_string()
}

/// A lens in the parameters of the YAML files of OpenCV and ROS.
struct Yaml {
    size: [u32; 2],
    matrix: [f64; 9],
    k: Vec<f64>,
    is_fisheye: bool,
    has_response: bool,
}

impl Yaml {
    fn of(file: &LensFile) -> Result<Self, String> {
        let p = file.lens.intrinsics();
        let (is_fisheye, k) = match p.model {
            Model::Equidistant => (true, vec![0.0; 4]),
            Model::KannalaBrandt(k) => (true, k.to_vec()),
            Model::Radial([k1, k2]) => (false, vec![k1, k2, 0.0, 0.0, 0.0]),
            other => return Err(format!("a lens of the model {}", other.name())),
        };
        if p.vignetting[1..].iter().any(|v| *v != 0.0) {
            return Err("a lens with vignetting".into());
        }
        let (f, c) = (p.focal_px, p.centre_px);
        let matrix = [f.x, p.skew_px, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0];
        let has_response = file.response_table.is_some() || file.levels.is_some();
        Ok(Self { size: file.size, matrix, k, is_fisheye, has_response })
    }

    fn opencv(&self) -> String {
        let [width, height] = self.size;
        let matrix = |name: &str, rows: usize, cols: usize, data: &[f64]| {
            format!(
                "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]\n",
                joined(data)
            )
        };
        format!(
            "%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\nfisheye_model: {}\n{}{}",
            u8::from(self.is_fisheye),
            matrix("camera_matrix", 3, 3, &self.matrix),
            matrix("distortion_coefficients", self.k.len(), 1, &self.k)
        )
    }

    fn ros(&self) -> String {
        let [width, height] = self.size;
        let m = self.matrix;
        let projection = [m[0], m[1], m[2], 0.0, 0.0, m[4], m[5], 0.0, 0.0, 0.0, 1.0, 0.0];
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let matrix = |name: &str, rows: usize, cols: usize, data: &[f64]| {
            format!("{name}:\n  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", joined(data))
        };
        format!(
            "image_width: {width}\nimage_height: {height}\ncamera_name: hemilux\n{}distortion_model: {}\n{}{}{}",
            matrix("camera_matrix", 3, 3, &m),
            if self.is_fisheye { "equidistant" } else { "plumb_bob" },
            matrix("distortion_coefficients", 1, self.k.len(), &self.k),
            matrix("rectification_matrix", 3, 3, &identity),
            matrix("projection_matrix", 3, 4, &projection)
        )
    }
}

/// Joins numbers to a list in which each has a decimal point or an exponent, without which OpenCV reads them as integers.
fn joined(data: &[f64]) -> String {
    data.iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ")
}
