//! Uncertainty of the directions that a fitted camera assigns to pixels.

use super::camera::{Camera, KEPT};
use super::fit::Fit;
use super::solve::{Covariances, Model, covariances};
use nalgebra::{Matrix3x2, SMatrix, Vector3};
use std::f64::consts::TAU;

/// Number of azimuths over which the uncertainty at an angle from the axis is averaged.
const AZIMUTHS: u32 = 24;

/// Uncertainty of the directions at one angle from the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Angle between the direction and the axis of the lens, degrees.
    pub angle_deg: f64,
    /// Standard deviation of a direction, degrees. It combines `law_deg` with the larger of two figures: the effect of the noise of the
    /// corners, and half of `halves_deg`.
    pub uncertainty_deg: f64,
    /// Difference at the angle between the lenses computed from two halves of the pictures, degrees; `None` with fewer than six boards.
    pub halves_deg: Option<f64>,
    /// Difference at the angle from a lens whose radial law has two more coefficients, degrees.
    pub law_deg: f64,
}

/// Standard deviations of the parameters of a camera.
pub(super) type Deviations = [f64; KEPT];

/// Covariance of the parameters of a camera.
type Covariance = SMatrix<f64, KEPT, KEPT>;

/// Returns the covariances of the camera's parameters, scaled to the error of the corners.
pub(super) fn of_parameters(fit: &Fit) -> Option<Covariances> {
    let unknowns = KEPT + 6 * fit.views.len();
    let free = (2 * fit.corners()).saturating_sub(unknowns).max(1);
    let squares: f64 = fit.rms().powi(2) * fit.corners() as f64;
    let Covariances { independent, by_view } = covariances(&fit.model, &fit.views)?;
    Some(Covariances { independent: independent * (squares / free as f64), by_view })
}

/// Returns the standard deviations of the camera's parameters.
pub(super) fn deviations(covariances: &Covariances) -> Deviations {
    let variance = |i: usize| covariances.independent[(i, i)].max(covariances.by_view[(i, i)]);
    std::array::from_fn(|i| variance(i).max(0.0).sqrt())
}

/// Returns unit directions at all azimuths at the angle `theta` from the axis.
fn ring(theta: f64) -> impl Iterator<Item = Vector3<f64>> {
    (0..AZIMUTHS).map(move |i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(AZIMUTHS)).sin_cos();
        Vector3::new(theta.sin() * cos, theta.sin() * sin, theta.cos())
    })
}

/// Returns the root mean square of angles whose squares are `squares`, in square radians, converted to degrees.
fn degrees(squares: impl Iterator<Item = f64>) -> f64 {
    (squares.sum::<f64>() / f64::from(AZIMUTHS)).sqrt().to_degrees()
}

/// Returns the uncertainty of directions every ten degrees from the axis and at the edge of the covered field.
pub(super) fn by_angle(fit: &Fit, covariances: &Covariances, covered: f64) -> Vec<Spread> {
    let halves = halves(fit);
    let tens =
        (0..18).map(|i| f64::from(i) * 10f64.to_radians()).take_while(|theta| *theta < covered - 0.035);
    let rich = rich(fit);
    let spread = |theta: f64| {
        let noise = |of: &Covariance| degrees(ring(theta).map(|d| variance(&fit.model.camera, of, &d)));
        let noise_deg = noise(&covariances.independent).max(noise(&covariances.by_view));
        let apart = |pair: &[Camera; 2]| degrees(ring(theta).map(|d| apart(&fit.model.camera, pair, &d)));
        let halves_deg = halves.as_ref().map(apart);
        let law_deg = apart(&[fit.model.camera, rich]);
        let uncertainty_deg = noise_deg.max(0.5 * halves_deg.unwrap_or(0.0)).hypot(law_deg);
        Spread { angle_deg: theta.to_degrees(), uncertainty_deg, halves_deg, law_deg }
    };
    tens.chain([covered]).map(spread).collect()
}

/// Returns the variance of the direction of the pixel that shows `direction`, square radians.
fn variance(camera: &Camera, covariance: &Covariance, direction: &Vector3<f64>) -> f64 {
    let p = camera.project(direction);
    let first =
        direction.cross(&if direction.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() }).normalize();
    let tangents = Matrix3x2::from_columns(&[first, direction.cross(&first)]);
    let Some(inverse) = (p.by_point * tangents).try_inverse() else { return f64::INFINITY };
    let by_parameters = inverse * p.by_intrinsics.fixed_columns::<KEPT>(0);
    (by_parameters * covariance * by_parameters.transpose()).trace().max(0.0)
}

/// Returns two cameras, fitted to every second picture and to the others; `None` for fewer than six pictures.
fn halves(fit: &Fit) -> Option<[Camera; 2]> {
    let half = |parity: usize| {
        let views = fit.views.iter().skip(parity).step_by(2).cloned().collect();
        let mut half = Fit { model: fit.model, views, pictures: Vec::new() };
        half.polish();
        half.model.camera
    };
    (fit.views.len() >= 6).then(|| [half(0), half(1)])
}

/// Returns the fitted camera with two more coefficients of the radial law; a difference from the camera of `fit` shows that four
/// coefficients do not describe the lens.
fn rich(fit: &Fit) -> Camera {
    let mut rich =
        Fit { model: Model { rich: true, ..fit.model }, views: fit.views.clone(), pictures: Vec::new() };
    rich.polish();
    rich.model.camera
}

/// Returns the squared angle between the directions that the two cameras of `pair` assign to the pixel at which `camera` shows `direction`,
/// square radians.
fn apart(camera: &Camera, pair: &[Camera; 2], direction: &Vector3<f64>) -> f64 {
    let pixel = camera.pixel(direction);
    let [a, b] = pair.each_ref().map(|other| other.direction(pixel));
    a.cross(&b).norm().atan2(a.dot(&b)).powi(2)
}
