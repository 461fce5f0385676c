//! Conversion of a camera model of another program to a lens: exactly where the core has the model, else by a least-squares fit.

use super::model::{ForeignCamera, Model};
use super::{MAX_ANGLE_DEG, Refusal, refuse};
use glam::{DVec2, DVec3};
use hemilux_core::lens::{self, Intrinsics, Lens, LensError};
use std::f64::consts::TAU;

/// Number of steps of the angle off axis over the field of view at which models are compared.
const STEPS: usize = 360;

/// Number of azimuths at each angle off axis at which models are compared.
const AZIMUTHS: usize = 24;

/// A lens, and its deviation from the camera model of the file.
pub(super) struct Fitted {
    pub lens: Lens,
    /// Largest angle between the directions of lens and model, degrees; `None` for a model that the core has.
    pub deviation_deg: Option<f64>,
}

pub(super) fn lens(camera: &ForeignCamera) -> Result<Fitted, Refusal> {
    let max_theta = field_of_view(camera)?;
    let exact = match &camera.model {
        Model::KannalaBrandt(k) => Some(lens::Model::KannalaBrandt(*k)),
        Model::Pinhole(d) if d.is_two_radial() => Some(lens::Model::Radial([d.radial[0], d.radial[1]])),
        _ => None,
    };
    if let Some(model) = exact {
        let lens = largest(intrinsics(camera, model, 1.0, max_theta))?;
        return Ok(Fitted { lens, deviation_deg: None });
    }
    let Polynomial { scale, k } = polynomial(camera, max_theta)?;
    let lens = largest(intrinsics(camera, lens::Model::KannalaBrandt(k), scale, max_theta))?;
    let deviation_deg = Some(deviation(camera, &lens).to_degrees());
    Ok(Fitted { lens, deviation_deg })
}

fn intrinsics(camera: &ForeignCamera, model: lens::Model, scale: f64, max_theta: f64) -> Intrinsics {
    Intrinsics {
        model,
        centre_px: DVec2::from_array(camera.centre),
        focal_px: DVec2::from_array(camera.focal) * scale,
        skew_px: camera.skew * scale,
        max_theta,
        vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
}

/// Returns the lens of `p` with the largest field of view, up to `max_theta`, over which the radial law increases.
fn largest(mut p: Intrinsics) -> Result<Lens, Refusal> {
    for _ in 0..2 {
        match Lens::try_new(p) {
            Ok(lens) => return Ok(lens),
            Err(LensError::NotMonotone { limit_degrees, .. }) => p.max_theta = limit_degrees.to_radians(),
            Err(e) => return refuse(e.to_string(), "a lens"),
        }
    }
    refuse("a radial law that does not increase", "a lens")
}

/// Returns the unit direction at the angle `theta` off axis and the azimuth `phi`, radians.
fn direction(theta: f64, phi: f64) -> DVec3 {
    let (sin, cos) = theta.sin_cos();
    DVec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

fn azimuths() -> impl Iterator<Item = f64> {
    (0..AZIMUTHS).map(|j| j as f64 * TAU / AZIMUTHS as f64)
}

/// Returns the largest angle off axis that the image contains and the model can project, up to [`MAX_ANGLE_DEG`], radians.
fn field_of_view(camera: &ForeignCamera) -> Result<f64, Refusal> {
    let sound = camera.focal.iter().all(|f| *f > 0.0 && f.is_finite()) && camera.size.iter().all(|s| *s > 0);
    if !sound || !camera.centre.iter().all(|c| c.is_finite()) {
        return refuse(
            format!("focal lengths {:?}, size {:?}", camera.focal, camera.size),
            "positive numbers",
        );
    }
    let [width, height] = camera.size.map(f64::from);
    let holds = |p: DVec2| p.x >= -0.5 && p.y >= -0.5 && p.x <= width - 0.5 && p.y <= height - 0.5;
    let is_seen = |theta: f64| azimuths().any(|phi| camera.pixel(direction(theta, phi)).is_some_and(holds));
    let step = MAX_ANGLE_DEG.to_radians() / STEPS as f64;
    let last = (1..=STEPS).take_while(|i| is_seen(*i as f64 * step)).last();
    last.map_or_else(
        || refuse("a camera whose image contains no direction", "a lens"),
        |i| Ok(i as f64 * step),
    )
}

/// The radial law r = scale theta (1 + k1 theta^2 + ...).
struct Polynomial {
    scale: f64,
    k: [f64; 4],
}

/// Fits five odd powers of the angle off axis to the mean radius over all azimuths by least squares.
fn polynomial(camera: &ForeignCamera, max_theta: f64) -> Result<Polynomial, Refusal> {
    let mut normal = [[0.0f64; 6]; 5];
    for i in 1..=STEPS {
        let t = i as f64 / STEPS as f64;
        let radii = azimuths().filter_map(|phi| camera.model.project(direction(t * max_theta, phi)));
        let radii: Vec<f64> = radii.map(DVec2::length).collect();
        if radii.is_empty() {
            continue;
        }
        let radius = radii.iter().sum::<f64>() / radii.len() as f64;
        let powers = [1, 3, 5, 7, 9].map(|n| t.powi(n));
        for (row, a) in normal.iter_mut().zip(powers) {
            row[..5].iter_mut().zip(powers).for_each(|(v, b)| *v += a * b);
            row[5] += a * radius;
        }
    }
    let Some(c) = solve(normal).filter(|c| c[0] > 0.0) else {
        return refuse(format!("{} that no polynomial fits", camera.model.name()), "a lens");
    };
    let over = |n: usize| c[n] / c[0] / max_theta.powi(2 * n as i32);
    Ok(Polynomial { scale: c[0] / max_theta, k: [over(1), over(2), over(3), over(4)] })
}

/// Solves five linear equations, given with their right-hand sides, by Gauss-Jordan elimination with row pivots.
fn solve(mut m: [[f64; 6]; 5]) -> Option<[f64; 5]> {
    for i in 0..5 {
        let pivot = (i..5).max_by(|a, b| m[*a][i].abs().total_cmp(&m[*b][i].abs()))?;
        m.swap(i, pivot);
        let row = m[i].map(|v| v / m[i][i]);
        if !row.iter().all(|v| v.is_finite()) {
            return None;
        }
        m[i] = row;
        for (_, other) in m.iter_mut().enumerate().filter(|(k, _)| *k != i) {
            let factor = other[i];
            other.iter_mut().zip(row).for_each(|(v, r)| *v -= factor * r);
        }
    }
    Some(m.map(|row| row[5]))
}

/// Returns the largest angle between a direction and the direction that `lens` assigns to the direction's pixel in `camera`, radians.
fn deviation(camera: &ForeignCamera, lens: &Lens) -> f64 {
    let max_theta = lens.intrinsics().max_theta;
    let thetas = (0..STEPS).map(|i| i as f64 / STEPS as f64 * max_theta);
    let directions = thetas.flat_map(|theta| azimuths().map(move |phi| direction(theta, phi)));
    let off = |d: DVec3| Some(lens.unproject(camera.pixel(d)?)?.angle_between(d));
    directions.filter_map(off).fold(0.0, f64::max)
}
