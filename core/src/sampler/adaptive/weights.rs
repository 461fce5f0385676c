//! Weights of least expected error over receivers with random occluders.
//!
//! Let K(d, d') be the mean over receivers of what a unit light from d and one from d' give together: over normals and occluding caps as
//! `host-sim/METRICS.md` draws them it depends on the angle between d and d' alone. The expected squared error of lights w_i at l_i in the
//! place of a map mu is then |mu - sum w_i delta(l_i)|^2 in the norm of K, and least where K w = K mu. Starting from the energies of
//! the leaves, the correction x solves (K + R) x = r with r_i = sum over sources s of y_s (K(l_i, s) - K(l_i, l_owner(s))), under
//! sum x = 0. R, a ridge in proportion to 1 / energy, keeps dim lights from paying for bright ones. Cholesky, in place.
//!
//! The minimisation is that of optimally weighted quadrature in a reproducing kernel space; K near 0 is linear in the angle, which makes it
//! the energy distance of Szekely and Rizzo. The kernel K and its use for weights of lights are new here.

use super::source::Source;
use super::{FITTED, discs};
use crate::light::Light;
use crate::root::root;
use glam::Vec3;

/// K over K(0) as a polynomial in h = sin(angle / 2), constant first: a least-squares fit within 0.004 of the arc-cosine kernel
/// (sin g + (pi - g) cos g) / (6 pi) times the probability that a cap of half-angle 10 to 60 degrees hides neither direction. The fit only
/// decides how energy is shared out, so its error moves the optimum by less than a light's noise; the test `adaptive_kernel`
/// recomputes it.
pub(crate) const KERNEL: [f32; 6] = [1.0, -0.171_987, -2.301_984, 2.484_897, -1.960_409, 0.945_683];

/// The ridge of a light of mean energy, over K(0).
const RIDGE: f32 = 0.01;

/// Largest change of a light's energy, as a factor: beyond it the fit would trade lights against each other.
const MOST: f32 = 2.0;

/// [`RIDGE`] for discs, whose kernels overlap more.
const DISC_RIDGE: f32 = 0.1;

/// [`MOST`] for discs.
const DISC_MOST: f32 = 4.0;

/// K between unit vectors of which `squared` is the squared sine of half their angle, (1 - cos) / 2.
#[inline(always)]
pub(super) fn kernel(squared: f32) -> f32 {
    let h = coarse_root(squared);
    KERNEL.iter().rev().fold(0.0, |sum, c| sum * h + c)
}

/// The derivative of K over K(0) by the cosine of the angle; finite at 0.
#[inline(always)]
pub(super) fn slope(squared: f32) -> f32 {
    let squared = squared.max(LEAST_SQUARED);
    let per_root = coarse_inverse_root(squared);
    let h = squared * per_root;
    let mut by_root = 0.0;
    for i in (1..KERNEL.len()).rev() {
        by_root = by_root * h + i as f32 * KERNEL[i];
    }
    // With x the cosine, h^2 = (1 - x) / 2.
    by_root * per_root * -0.25
}

/// Least argument of [`slope`].
const LEAST_SQUARED: f32 = 1e-6;

/// Square root within 7e-4, of [`LEAST`] for what is less: a Newton step whose constants halve the error of the usual ones, which
/// would cost the fit as much again. They are Jan Kadlec's (2010).
#[inline(always)]
fn coarse_root(v: f32) -> f32 {
    // As an integer a negative number is small as well.
    let bits = (v.to_bits() as i32).max(LEAST.to_bits() as i32) as u32;
    let (v, r) = (f32::from_bits(bits), f32::from_bits(0x5f1f_fff9 - (bits >> 1)));
    v * r * (0.703_952_3 * (2.389_244_6 - v * r * r))
}

/// 1 / square root of a positive number, within 7e-4 of it.
#[inline(always)]
fn coarse_inverse_root(v: f32) -> f32 {
    let r = f32::from_bits(0x5f1f_fff9u32.wrapping_sub(v.to_bits() >> 1));
    r * (0.703_952_3 * (2.389_244_6 - v * r * r))
}

/// Smallest argument of the square root: the squared sine of a millionth of a radian.
const LEAST: f32 = 1e-12;

/// Scratch memory of the fit.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// K between lights; then its Cholesky factor in the lower triangle.
    matrix: [[f32; FITTED]; FITTED],
    /// Directions, one coordinate a row.
    axes: [[f32; FITTED]; 3],
    residual: [f32; FITTED],
    ones: [f32; FITTED],
}

impl Fit {
    pub(super) const fn new() -> Self {
        let row = [0.0; FITTED];
        Self { matrix: [row; FITTED], axes: [row; 3], residual: row, ones: row }
    }

    /// Scales the lights that stand for `sources`.
    pub(super) fn run(&mut self, sources: &[Source], lights: &mut [Light]) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.prepare(lights.iter().map(|light| light.direction));
        sources.iter().for_each(|source| self.source(n, source));
        self.finish(lights, RIDGE, MOST);
    }

    /// Scales the discs that stand for `sources`, which count as discs too.
    pub(super) fn run_discs(&mut self, sources: &[Source], lights: &mut [Light]) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.prepare(lights.iter().map(discs::vector_of));
        for source in sources {
            let mut own = [0.0; FITTED];
            kernels(&self.axes, discs::mean_vector(source.at, source.radius), &mut own[..n]);
            self.residual[..n].iter_mut().zip(&own[..n]).for_each(|(r, k)| *r += source.y * k);
        }
        for (row, light) in self.matrix.iter().zip(lights.iter()) {
            let y = energy(light);
            self.residual[..n].iter_mut().zip(&row[..n]).for_each(|(r, k)| *r -= y * k);
        }
        self.finish(lights, DISC_RIDGE, DISC_MOST);
    }

    /// Solves for the corrections and applies them.
    fn finish(&mut self, lights: &mut [Light], ridge: f32, most: f32) {
        let n = lights.len();
        let mean = lights.iter().map(energy).sum::<f32>() / n as f32;
        for (i, light) in lights.iter().enumerate() {
            self.matrix[i][i] += ridge * mean / energy(light).max(1e-6 * mean);
        }
        if self.solve(n) {
            scale(lights, &self.residual, most);
        }
    }

    /// Fills the matrix and clears the residual.
    fn prepare(&mut self, vectors: impl Iterator<Item = Vec3> + Clone) {
        self.residual = [0.0; FITTED];
        self.ones = [1.0; FITTED];
        for (i, vector) in vectors.clone().enumerate().take(FITTED) {
            for (axis, v) in self.axes.iter_mut().zip(vector.to_array()) {
                axis[i] = v;
            }
        }
        for (i, vector) in vectors.enumerate().take(FITTED) {
            kernels(&self.axes, vector, &mut self.matrix[i][..=i]);
            for j in 0..i {
                self.matrix[j][i] = self.matrix[i][j];
            }
        }
    }

    /// Adds to the residual the difference between a source at its own direction and at the direction of its light.
    fn source(&mut self, n: usize, source: &Source) {
        let Some(stands) = self.matrix[..n].get(usize::from(source.owner)) else { return };
        let mut own = [0.0; FITTED];
        kernels(&self.axes, source.at, &mut own[..n]);
        for ((r, own), stands) in self.residual[..n].iter_mut().zip(&own[..n]).zip(&stands[..n]) {
            *r += source.y * (own - stands);
        }
    }

    /// Solves for the correction under a sum of 0 into `residual`; false where the matrix is not positive definite.
    fn solve(&mut self, n: usize) -> bool {
        for i in 0..n {
            for j in 0..=i {
                let (before, row) = self.matrix.split_at(i);
                let other = if j < i { &before[j] } else { &row[0] };
                let dot: f32 = row[0][..j].iter().zip(&other[..j]).map(|(a, b)| a * b).sum();
                let rest = self.matrix[i][j] - dot;
                if j < i {
                    self.matrix[i][j] = rest / self.matrix[j][j];
                } else if rest > f32::MIN_POSITIVE {
                    self.matrix[i][i] = root(rest);
                } else {
                    return false;
                }
            }
        }
        substitute(&self.matrix, &mut self.residual[..n]);
        substitute(&self.matrix, &mut self.ones[..n]);
        let (sum, unit) = (self.residual[..n].iter().sum::<f32>(), self.ones[..n].iter().sum::<f32>());
        for (x, one) in self.residual[..n].iter_mut().zip(&self.ones[..n]) {
            *x -= one * sum / unit;
        }
        true
    }
}

/// K between `at` and each of the lights whose directions are `axes`.
fn kernels(axes: &[[f32; FITTED]; 3], at: Vec3, out: &mut [f32]) {
    let ([x, y, z], half) = (axes, at * 0.5);
    for (((out, x), y), z) in out.iter_mut().zip(x).zip(y).zip(z) {
        *out = kernel(0.5 - (x * half.x + y * half.y + z * half.z));
    }
}

/// Solves L L' x = b in place.
fn substitute(l: &[[f32; FITTED]; FITTED], x: &mut [f32]) {
    let n = x.len();
    for i in 0..n {
        let dot: f32 = l[i][..i].iter().zip(&x[..i]).map(|(a, b)| a * b).sum();
        x[i] = (x[i] - dot) / l[i][i];
    }
    for i in (0..n).rev() {
        x[i] /= l[i][i];
        let xi = x[i];
        for (other, a) in x[..i].iter_mut().zip(&l[i][..i]) {
            *other -= a * xi;
        }
    }
}

fn energy(light: &Light) -> f32 {
    crate::color::luminance(light.irradiance)
}

/// Adds the corrections to the lights' luminance, their colour kept.
fn scale(lights: &mut [Light], corrections: &[f32], most: f32) {
    for (light, x) in lights.iter_mut().zip(corrections) {
        let y = energy(light);
        let factor = if y > 0.0 { (1.0 + x / y).clamp(1.0 / most, most) } else { 1.0 };
        light.irradiance = light.irradiance.map(|v| v * factor);
    }
}

#[cfg(test)]
mod tests {
    use super::kernel;
    use core::f64::consts::PI;

    /// Part of the sphere within `a` of both ends of an arc of length `g`, by rings round one end.
    fn lens(a: f64, g: f64) -> f64 {
        const RINGS: u32 = 400;
        let ring = |i: u32| {
            let t = a * (f64::from(i) + 0.5) / f64::from(RINGS);
            let cos = (libm::cos(a) - libm::cos(t) * libm::cos(g)) / (libm::sin(t) * libm::sin(g));
            2.0 * libm::acos(cos.clamp(-1.0, 1.0)) * libm::sin(t) * a / f64::from(RINGS)
        };
        if g < 1e-9 { (1.0 - libm::cos(a)) / 2.0 } else { (0..RINGS).map(ring).sum::<f64>() / (4.0 * PI) }
    }

    /// The mean over receivers of the product of the irradiances of two unit lights `g` radians apart, integrated numerically.
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
    fn adaptive_kernel() {
        let whole = twin(0.0);
        for i in 0..=90 {
            let g = PI * f64::from(i) / 90.0;
            let off = f64::from(kernel((0.5 - 0.5 * libm::cos(g)) as f32)) - twin(g) / whole;
            assert!(libm::fabs(off) < 0.005, "at {g}: off by {off}");
        }
    }
}
