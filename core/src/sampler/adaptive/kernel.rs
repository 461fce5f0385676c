//! The kernel K between two unit lights: the mean over receivers of the product of their irradiances, normalised by K(0).
//!
//! Lights are mean vectors: a light of mean resultant length R about d is R d, and a point has R = 1. Between mean vectors m and m', K uses
//! (1 - m . m') / 2 as the squared sine of half their angle. It is computed as |m - m'|^2 / 4 plus the terms (1 - R^2) / 4 of both vectors,
//! since 1 - m . m' of two nearly equal vectors suffers from cancellation, which the kernel's root would amplify.

use super::FITTED;
use crate::light::Light;
use crate::pyramid::Quad;
use glam::Vec3;

/// Coefficients of K over K(0) as a polynomial in h = sin(angle / 2), constant first: a least-squares fit within 0.004 of the arc-cosine
/// kernel (sin g + (pi - g) cos g) / (6 pi) times the probability that a cap of half-angle 10 to 60 degrees hides neither direction. The
/// fit only decides how energy is distributed, so its error shifts the optimum by less than the noise of a light; the test
/// `polynomial_kernel_matches_the_integrated_one` recomputes it.
pub(crate) const KERNEL: [f32; 6] = [1.0, -0.171_987, -2.301_984, 2.484_897, -1.960_409, 0.945_683];

/// Returns the kernel K between two unit vectors; `squared` is the squared sine of half their angle, (1 - cos) / 2.
#[inline(always)]
pub(super) fn kernel(squared: f32) -> f32 {
    let h = coarse_root(squared);
    KERNEL.iter().rev().fold(0.0, |sum, c| sum * h + c)
}

/// Returns the square root of `v` within 7e-4, at least that of [`LEAST`]: one Newton step with constants by Jan Kadlec (2010), which halve
/// the error of the usual constants; a second step would double the cost of the fit.
#[inline(always)]
fn coarse_root(v: f32) -> f32 {
    // A negative number is small as an integer as well.
    let bits = (v.to_bits() as i32).max(LEAST.to_bits() as i32) as u32;
    let (v, r) = (f32::from_bits(bits), f32::from_bits(0x5f1f_fff9 - (bits >> 1)));
    v * r * (0.703_952_3 * (2.389_244_6 - v * r * r))
}

/// Smallest argument of the square root in the kernel: the squared sine of a millionth of a radian.
const LEAST: f32 = 1e-12;

/// Fraction of a disc's angular variance by which the disc's mean vector is shortened: a least-squares compromise between 2/3 and 1/2 of
/// the squared radius, the exact values for the mean distance to a point at the centre and to a distant point.
const SHRINK: f32 = 0.85;

/// The mean vector of a point, a disc or a region, in the form that the kernel needs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MeanVector {
    /// Half of the mean vector of the point, disc or region.
    pub(super) half: Vec3,
    /// Value of (1 - R^2) / 4 for the mean resultant length R.
    pub(super) spread: f32,
}

impl MeanVector {
    /// Returns the mean vector of a point light in direction `at`, a unit vector.
    pub(super) fn of_point(at: Vec3) -> Self {
        Self { half: at * 0.5, spread: 0.0 }
    }

    /// Returns the mean vector of a disc of `radius` radians around direction `at`, a unit vector.
    pub(super) fn of_disc(at: Vec3, radius: f32) -> Self {
        // Squared sine of half the radius, within 1e-3 up to a right angle.
        let square = radius * radius;
        Self::shorter(at, SHRINK * 0.25 * square * (1.0 + square * (square / 360.0 - 1.0 / 12.0)))
    }

    /// Returns the mean vector of `light` as a disc of its radius.
    pub(super) fn of_light(light: &Light) -> Self {
        Self::of_disc(light.direction, light.radius_deg.to_radians())
    }

    /// Returns the mean vector of the light of `quad`, whose energy is above 0.
    pub(super) fn of_quad(quad: &Quad) -> Self {
        let variance = quad.variance().max(0.0);
        Self { half: quad.first_moment() * (0.5 / quad.y()), spread: variance * (2.0 - variance) * 0.25 }
    }

    /// Returns the mean vector of the light of this mean vector and of `other`, which has the fraction `share` of the energy of both.
    pub(super) fn mixed(&self, other: &Self, share: f32) -> Self {
        let apart = other.half - self.half;
        let spread = self.spread + share * (other.spread - self.spread);
        Self {
            half: self.half + apart * share,
            spread: spread + share * (1.0 - share) * apart.length_squared(),
        }
    }

    fn shorter(at: Vec3, by: f32) -> Self {
        Self { half: at * (0.5 - 0.5 * by), spread: by * (2.0 - by) * 0.25 }
    }

    /// Returns the argument of [`kernel`] between this mean vector and `other`.
    pub(super) fn apart(&self, other: &Self) -> f32 {
        (self.half - other.half).length_squared() + (self.spread + other.spread)
    }

    /// Returns the argument of [`kernel`] between this mean vector and itself.
    pub(super) fn width_squared(&self) -> f32 {
        2.0 * self.spread
    }

    /// Returns the mean vector, of which this type stores the half.
    pub(super) fn vector(&self) -> Vec3 {
        self.half * 2.0
    }
}

/// Mean vectors of at most [`FITTED`] lights, stored by coordinate.
#[derive(Clone, Debug)]
pub(super) struct Vectors {
    /// Halves of the mean vectors, one row for each coordinate.
    halves: [[f32; FITTED]; 3],
    spreads: [f32; FITTED],
}

impl Vectors {
    pub(super) const fn new() -> Self {
        Self { halves: [[0.0; FITTED]; 3], spreads: [0.0; FITTED] }
    }

    /// Sets mean vector `i` to `vector`.
    pub(super) fn set(&mut self, i: usize, vector: &MeanVector) {
        self.halves.iter_mut().zip(vector.half.to_array()).for_each(|(axis, v)| axis[i] = v);
        self.spreads[i] = vector.spread;
    }

    /// Writes to `out` the kernel K between `other` and each of the first mean vectors.
    pub(super) fn kernels(&self, other: &MeanVector, out: &mut [f32]) {
        let ([x, y, z], at) = (&self.halves, other.half);
        for ((((out, x), y), z), spread) in out.iter_mut().zip(x).zip(y).zip(z).zip(&self.spreads) {
            let (x, y, z) = (x - at.x, y - at.y, z - at.z);
            *out = kernel((x * x + y * y) + (z * z + (spread + other.spread)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    /// Returns the fraction of the sphere within the angle `a` of both ends of an arc of length `g`, summed over rings around one end.
    fn lens(a: f64, g: f64) -> f64 {
        const RINGS: u32 = 400;
        let ring = |i: u32| {
            let t = a * (f64::from(i) + 0.5) / f64::from(RINGS);
            let cos = (libm::cos(a) - libm::cos(t) * libm::cos(g)) / (libm::sin(t) * libm::sin(g));
            2.0 * libm::acos(cos.clamp(-1.0, 1.0)) * libm::sin(t) * a / f64::from(RINGS)
        };
        if g < 1e-9 { (1.0 - libm::cos(a)) / 2.0 } else { (0..RINGS).map(ring).sum::<f64>() / (4.0 * PI) }
    }

    /// Returns the mean over receivers of the product of the irradiances of two unit lights `g` radians apart, integrated numerically.
    fn twin(g: f64) -> f64 {
        const CAPS: u32 = 40;
        let open = (libm::sin(g) + (PI - g) * libm::cos(g)) / (6.0 * PI);
        let clear = |i: u32| {
            let a = (10.0 + 50.0 * (f64::from(i) + 0.5) / f64::from(CAPS)).to_radians();
            1.0 - (1.0 - libm::cos(a)) + lens(a, g)
        };
        open * (0..CAPS).map(clear).sum::<f64>() / f64::from(CAPS)
    }

    #[test]
    fn polynomial_kernel_matches_the_integrated_one() {
        let whole = twin(0.0);
        for i in 0..=90 {
            let g = PI * f64::from(i) / 90.0;
            let off = f64::from(kernel((0.5 - 0.5 * libm::cos(g)) as f32)) - twin(g) / whole;
            assert!(libm::fabs(off) < 0.005, "at {g}: off by {off}");
        }
    }

    #[test]
    fn mixed_vectors_keep_moment_and_spread() {
        let (a, b) = (MeanVector::of_disc(Vec3::Z, 0.3), MeanVector::of_disc(Vec3::X, 0.5));
        for share in [0.0, 0.25, 0.9, 1.0] {
            let mixed = a.mixed(&b, share);
            assert!(mixed.half.distance(a.half * (1.0 - share) + b.half * share) < 1e-6, "{share}");
            let expected = 0.25 - mixed.half.length_squared();
            assert!((mixed.spread - expected).abs() < 1e-6, "{share}: {}, expected {expected}", mixed.spread);
        }
    }

    /// Two points a millionth of a radian apart, whose cosine is 1 in single precision, have a non-zero distance.
    #[test]
    fn near_vectors_have_their_true_distance() {
        for angle in [1e-6f32, 1e-5, 1e-4, 1e-3, 1e-2] {
            let near = Vec3::new(angle, 0.0, 1.0);
            let found = MeanVector::of_point(Vec3::Z).apart(&MeanVector::of_point(near));
            let expected = angle * angle / 4.0;
            assert!((found / expected - 1.0).abs() < 1e-3, "{angle}: {found}, expected {expected}");
        }
    }
}
