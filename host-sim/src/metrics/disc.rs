//! Irradiance of receivers under uniform discs, for scores of lights with disc shape.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::receiver::Receiver;
use super::vector::{dot, tangents};

/// Number of quadrature points of a disc that an occluding cone hides in part.
pub const POINTS: usize = 192;

/// Shape that the scores assign to the lights of a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reading {
    /// Lights are read as directions without extent.
    #[default]
    Points,
    /// Lights are uniform discs of their angular radius.
    Discs,
}

/// Returns the mean of max(0, n . d) over the uniform disc of angular radius `radius` (at most pi / 2), in closed form; `cos` is the
/// cosine of the angle between the normal and the disc's centre.
///
/// Above the horizon it is cos (1 + cos r) / 2; for a disc that the horizon cuts it is the irradiance of the visible part of a spherical
/// cap (J. M. Snyder, "Area Light Sources for Real-Time Graphics", 1996).
#[must_use]
pub fn cosine(cos: f64, radius: f64) -> f64 {
    let (sin_r, cos_r) = radius.sin_cos();
    if cos >= sin_r {
        return cos * (1.0 + cos_r) / 2.0;
    }
    if cos <= -sin_r {
        return 0.0;
    }
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let x = cos_r / sin_r;
    let y = (-x * cos / sin).clamp(-1.0, 1.0);
    let edge = sin * (1.0 - y * y).sqrt();
    let cut = (cos * y.acos() - x * edge) * sin_r * sin_r + edge.atan2(x);
    cut.max(0.0) / (TAU * (1.0 - cos_r))
}

/// A uniform disc on the sphere: centre, angular radius, and quadrature points that are evenly spread inside of the disc.
#[derive(Clone, Debug)]
pub struct Disc {
    centre: [f64; 3],
    radius: f64,
    points: Vec<[f64; 3]>,
}

impl Disc {
    /// Creates a disc of `radius` radians, at most pi / 2, with `POINTS` points.
    #[must_use]
    pub fn new(centre: [f64; 3], radius: f64) -> Self {
        Self::of_points(centre, radius, POINTS)
    }

    /// Creates a disc with `count` points: a spherical Fibonacci lattice that ends at the disc's edge.
    #[must_use]
    pub fn of_points(centre: [f64; 3], radius: f64, count: usize) -> Self {
        let radius = if radius.is_finite() { radius.clamp(0.0, FRAC_PI_2) } else { 0.0 };
        let [across, up] = tangents(centre);
        let height = 1.0 - radius.cos();
        let point = |k: usize| {
            let z = 1.0 - height * (k as f64 + 0.5) / count as f64;
            let (sin, cos) = (TAU * (k as f64 * 0.618_033_988_749_894_9).fract()).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            std::array::from_fn(|i| z * centre[i] + r * (cos * across[i] + sin * up[i]))
        };
        Self { centre, radius, points: (0..count).map(point).collect() }
    }

    /// Returns the mean of max(0, n . d) V(d) over the directions d of the disc, with the normal n and the visibility V of `probe`.
    #[must_use]
    pub fn weight(&self, probe: &Receiver) -> f64 {
        let cos = dot(probe.normal, self.centre);
        if cos <= -self.radius.sin() {
            return 0.0;
        }
        let away = dot(probe.axis, self.centre).clamp(-1.0, 1.0).acos();
        let cone = if probe.cos_half_angle > 1.0 { -TAU } else { probe.cos_half_angle.acos() };
        if away >= cone + self.radius {
            return if self.radius > 0.0 { cosine(cos, self.radius) } else { cos.max(0.0) };
        }
        if away + self.radius < cone {
            return 0.0;
        }
        self.points.iter().map(|d| probe.weight(*d)).sum::<f64>() / self.points.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::receiver::{fib, open, shadowed};

    #[test]
    fn the_closed_form_equals_the_numerical_integral() {
        for radius_deg in [0.5f64, 5.0, 20.0, 60.0, 90.0] {
            for k in 0..40 {
                let probe = open(19 * k);
                let disc = Disc::of_points([0.0, 0.0, 1.0], radius_deg.to_radians(), 200_000);
                let sum: f64 = disc.points.iter().map(|d| probe.weight(*d)).sum();
                let closed = cosine(probe.normal[2], radius_deg.to_radians());
                assert!((sum / 200_000.0 - closed).abs() < 2e-5, "{radius_deg} degrees, {:?}", probe.normal);
            }
        }
    }

    #[test]
    fn quadrature_agrees_with_20000_points() {
        let (mut off, mut whole) = (0.0, 0.0);
        for k in 0..60 {
            let (centre, radius) = (fib(k, 60), (3.0 + 1.4 * k as f64).to_radians());
            let [coarse, fine] = [POINTS, 20_000].map(|n| Disc::of_points(centre, radius, n));
            for probe in (0..64).map(|p| shadowed(8 * p)) {
                let [a, b] = [&coarse, &fine].map(|disc| disc.weight(&probe));
                assert!((a - b).abs() < 0.02, "{centre:?}, {radius}: {a}, finer {b}");
                off += (a - b) * (a - b);
                whole += b * b;
            }
        }
        assert!((off / whole).sqrt() < 0.01, "{}", (off / whole).sqrt());
    }

    #[test]
    fn a_disc_of_radius_0_equals_a_point() {
        for k in 0..64 {
            let (probe, d) = (shadowed(8 * k), fib(k, 64));
            assert_eq!(Disc::new(d, 0.0).weight(&probe), probe.weight(d));
        }
    }
}
