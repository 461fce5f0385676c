//! COLMAP's `cameras.txt`: identifier, model, columns, rows, parameters. The centre of the first pixel is at 0.5.

use super::model::{Distortion, ForeignCamera, Model};
use super::{Refusal, refuse};

const MODELS: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, FOV, SIMPLE_RADIAL_FISHEYE or \
                      RADIAL_FISHEYE";

/// Returns the fields of each line that describes a camera; comments are left out.
fn cameras(text: &str) -> impl Iterator<Item = Vec<&str>> {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.map(|line| line.split_whitespace().collect())
}

pub(super) fn is(text: &str) -> bool {
    let is_name = |name: &str| {
        !name.is_empty() && name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_')
    };
    let first = cameras(text).next();
    first.is_some_and(|f| {
        f.len() >= 5
            && f[0].parse::<u32>().is_ok()
            && is_name(f[1])
            && f[2..].iter().all(|v| v.parse::<f64>().is_ok())
    })
}

pub(super) fn parse(text: &str, notes: &mut Vec<String>) -> Result<ForeignCamera, Refusal> {
    let all: Vec<_> = cameras(text).collect();
    if all.len() > 1 {
        notes.push(format!("the first of {} cameras is used", all.len()));
    }
    let fields = &all[0];
    let numbers = fields[2..]
        .iter()
        .map(|v| v.parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect::<Option<Vec<_>>>();
    let Some([width, height, p @ ..]) = numbers.as_deref() else {
        return refuse("a camera without numbers", "columns, rows and parameters");
    };
    let pinhole = |k: &[f64]| Distortion::from_opencv(k).map(Model::Pinhole);
    let (focal, centre, model) = match (fields[1], p) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], pinhole(&[])),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy], [x, y], pinhole(&[])),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], pinhole(&[k, 0.0, 0.0, 0.0])),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f], [x, y], pinhole(&[k1, k2, 0.0, 0.0])),
        ("OPENCV", &[fx, fy, x, y, ref k @ ..]) if k.len() == 4 => ([fx, fy], [x, y], pinhole(k)),
        ("FULL_OPENCV", &[fx, fy, x, y, ref k @ ..]) if k.len() == 8 => ([fx, fy], [x, y], pinhole(k)),
        ("OPENCV_FISHEYE", &[fx, fy, x, y, k1, k2, k3, k4]) => {
            ([fx, fy], [x, y], Some(Model::KannalaBrandt([k1, k2, k3, k4])))
        }
        ("FOV", &[fx, fy, x, y, w]) => ([fx, fy], [x, y], Some(Model::FieldOfView(w))),
        ("SIMPLE_RADIAL_FISHEYE", &[f, x, y, k]) => {
            ([f, f], [x, y], Some(Model::KannalaBrandt([k, 0.0, 0.0, 0.0])))
        }
        ("RADIAL_FISHEYE", &[f, x, y, k1, k2]) => {
            ([f, f], [x, y], Some(Model::KannalaBrandt([k1, k2, 0.0, 0.0])))
        }
        (name, p) => return refuse(format!("the model {name} with {} parameters", p.len()), MODELS),
    };
    let model = model.ok_or_else(|| ("distortion coefficients".to_string(), MODELS.to_string()))?;
    let size = [*width, *height].map(|v| v as u32);
    Ok(ForeignCamera { model, size, focal, centre: centre.map(|v| v - 0.5), skew: 0.0 })
}
