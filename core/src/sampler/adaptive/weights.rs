//! Weights of least expected error over receivers with random occluders.
//!
//! Let K(d, d') be the mean over receivers of the product of the irradiances of unit lights from d and d'. Over the normals and occluding
//! caps that `host-sim/METRICS.md` defines, it depends on the angle between d and d' alone. The expected squared error of lights w_i at l_i
//! in place of a map mu is |mu - sum w_i delta(l_i)|^2 in the norm of K, and least for K w = K mu. Starting from the energies of the
//! leaves, the correction x solves (K + R) x = r with r_i = sum over sources s of y_s (K(l_i, s) - K(l_i, l_owner(s))), under sum x = 0. R,
//! a ridge proportional to 1 / energy, limits changes of bright lights in favour of dim ones. The system is solved by Cholesky
//! decomposition in place.
//!
//! The minimisation equals optimally weighted quadrature in a reproducing kernel space; since K near 0 is linear in the angle, it is
//! related to the energy distance of Szekely and Rizzo. The kernel K and its use for weights of lights are new here.

use super::kernel::{KernelSums, MeanVector, Vectors};
use super::source::Source;
use super::{FITTED, step};
use crate::light::Light;
use crate::root::root;

/// The ridge for a light of mean energy, relative to K(0).
const RIDGE: f32 = 0.01;

/// Largest factor by which the fit changes a light's energy; without the limit, the fit would exchange energy between lights.
const MOST: f32 = 2.0;

/// The value of [`RIDGE`] for discs, whose kernels overlap more.
const DISC_RIDGE: f32 = 0.1;

/// Value in place of [`MOST`] for lights that are fitted as discs.
const DISC_MOST: f32 = 4.0;

/// Working memory of the fit of the weights.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// The kernel K between the lights; later its Cholesky factor in the lower triangle.
    matrix: [[f32; FITTED]; FITTED],
    lights: Vectors,
    /// In `kernels` the residual, later the corrections; in `pulls` the gradients, for discs.
    sums: KernelSums,
    /// The kernel K between one source and each of the lights.
    own: [f32; FITTED],
    ones: [f32; FITTED],
}

impl Fit {
    pub(super) const fn new() -> Self {
        let row = [0.0; FITTED];
        Self { matrix: [row; FITTED], lights: Vectors::new(), sums: KernelSums::new(), own: row, ones: row }
    }

    /// Changes the energies of the lights that represent `sources` to the least expected error.
    pub(super) fn run(&mut self, sources: &[Source], lights: &mut [Light]) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.prepare(lights.iter().map(|light| MeanVector::of_point(light.direction)));
        sources.iter().for_each(|source| self.source(n, source));
        self.finish(lights, RIDGE, MOST);
    }

    /// Changes the energies of the discs that represent `sources`, which count as discs too, to the least expected error.
    pub(super) fn run_discs(&mut self, sources: &[Source], lights: &mut [Light]) {
        self.fit_discs(sources, lights, false);
    }

    /// Changes the energies of the discs that represent `sources`, and moves each disc one step down the gradient of the error in the norm
    /// of the kernel.
    pub(super) fn step_discs(&mut self, sources: &[Source], lights: &mut [Light]) {
        self.fit_discs(sources, lights, true);
        for (i, light) in lights.iter_mut().enumerate().take(FITTED) {
            light.direction = step::stepped(light, &self.lights.get(i), self.sums.pull(i));
        }
    }

    /// Changes the energies of discs; with `pulls`, computes the gradients of their errors in `sums`.
    fn fit_discs(&mut self, sources: &[Source], lights: &mut [Light], pulls: bool) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.prepare(lights.iter().map(MeanVector::of_light));
        for source in sources {
            let disc = MeanVector::of_disc(source.at, source.radius);
            if pulls {
                self.lights.add_up(n, &disc, source.y, &mut self.sums);
            } else {
                self.lights.add_kernels(&disc, source.y, &mut self.sums.kernels[..n]);
            }
        }
        for (row, light) in self.matrix.iter().zip(lights.iter()) {
            let y = energy(light);
            self.sums.kernels[..n].iter_mut().zip(&row[..n]).for_each(|(r, k)| *r -= y * k);
        }
        self.finish(lights, DISC_RIDGE, DISC_MOST);
        for (i, light) in lights.iter().enumerate().filter(|_| pulls) {
            self.lights.add_up(n, &self.lights.get(i), -energy(light), &mut self.sums);
        }
    }

    /// Solves for the corrections of the energies and applies them.
    fn finish(&mut self, lights: &mut [Light], ridge: f32, most: f32) {
        let n = lights.len();
        let mean = lights.iter().map(energy).sum::<f32>() / n as f32;
        for (i, light) in lights.iter().enumerate() {
            self.matrix[i][i] += ridge * mean / energy(light).max(1e-6 * mean);
        }
        if self.solve(n) {
            scale(lights, &self.sums.kernels, most);
        }
    }

    /// Fills the matrix with the kernel between the lights' `vectors` and clears the residual.
    fn prepare(&mut self, vectors: impl Iterator<Item = MeanVector> + Clone) {
        self.sums.clear(vectors.clone().count());
        self.ones = [1.0; FITTED];
        for (i, vector) in vectors.clone().enumerate().take(FITTED) {
            self.lights.set(i, &vector);
        }
        for (i, vector) in vectors.enumerate().take(FITTED) {
            self.lights.kernels(&vector, &mut self.matrix[i][..=i]);
            for j in 0..i {
                self.matrix[j][i] = self.matrix[i][j];
            }
        }
    }

    /// Adds to the residual the difference between a source at its own direction and at the direction of its light.
    fn source(&mut self, n: usize, source: &Source) {
        let Some(stands) = self.matrix[..n].get(usize::from(source.owner)) else { return };
        self.lights.kernels(&MeanVector::of_point(source.at), &mut self.own[..n]);
        for ((r, own), stands) in self.sums.kernels[..n].iter_mut().zip(&self.own[..n]).zip(&stands[..n]) {
            *r += source.y * (own - stands);
        }
    }

    /// Solves for the correction under a sum of 0 into `sums.kernels`; returns false if the matrix is not positive definite.
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
        substitute(&self.matrix, &mut self.sums.kernels[..n]);
        substitute(&self.matrix, &mut self.ones[..n]);
        let x = &mut self.sums.kernels[..n];
        let (sum, unit) = (x.iter().sum::<f32>(), self.ones[..n].iter().sum::<f32>());
        for (x, one) in x.iter_mut().zip(&self.ones[..n]) {
            *x -= one * sum / unit;
        }
        true
    }
}

/// Solves L L' x = b, where `x` contains b at first and the solution at the end.
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

/// Adds the corrections to the luminance of the lights without changing their colour; `most` limits the factor.
fn scale(lights: &mut [Light], corrections: &[f32], most: f32) {
    for (light, x) in lights.iter_mut().zip(corrections) {
        let y = energy(light);
        let factor = if y > 0.0 { (1.0 + x / y).clamp(1.0 / most, most) } else { 1.0 };
        light.irradiance = light.irradiance.map(|v| v * factor);
    }
}

/// Scales each channel of the lights to the sum `total`.
pub(super) fn keep_energy(lights: &mut [Light], total: [f32; 3]) {
    let mut sum = [0.0f64; 3];
    for light in lights.iter() {
        for (s, v) in sum.iter_mut().zip(light.irradiance) {
            *s += f64::from(v);
        }
    }
    // A channel of which the lights have almost nothing left has a factor above the largest number.
    let factor: [f32; 3] = core::array::from_fn(|c| {
        if sum[c] > 0.0 { ((f64::from(total[c]) / sum[c]) as f32).min(f32::MAX) } else { 1.0 }
    });
    for light in lights {
        for (v, f) in light.irradiance.iter_mut().zip(factor) {
            *v *= f;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_of_almost_nothing_keeps_finite_lights() {
        let light = |irradiance| Light { irradiance, ..Light::default() };
        let mut lights = [light([1e-38, 0.5, 0.0]), light([0.0, 0.5, 1e-45])];
        keep_energy(&mut lights, [1e20, 2.0, 1e29]);
        for light in &lights {
            assert!(light.irradiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{light:?}");
            assert_eq!(light.irradiance[1], 1.0, "the channel with light has its total");
        }
    }
}
