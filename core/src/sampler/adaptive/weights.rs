//! Weights of least expected error over receivers with random occluders.
//!
//! Let K(d, d') be the mean over receivers of the product of the irradiances of unit lights from d and d'. Over the normals and occluding
//! caps that `host-sim/METRICS.md` defines, it depends on the angle between d and d' alone. The expected squared error of lights w_i at l_i
//! in place of a map mu is |mu - sum w_i delta(l_i)|^2 in the norm of K, and least for K w = K mu. Starting from the energies of the
//! leaves, the correction x solves (K + R) x = r with r_i = sum over sources s of y_s (K(l_i, s) - K(l_i, l_owner(s))), under sum x = 0. R,
//! a ridge proportional to 1 / energy, limits changes of bright lights in favour of dim ones. The system is solved by Cholesky
//! decomposition in place. The residual r is computed in fixed point ([`super::points`]), the matrix in single precision.
//!
//! The minimisation equals optimally weighted quadrature in a reproducing kernel space; since K near 0 is linear in the angle, it is
//! related to the energy distance of Szekely and Rizzo. The kernel K and its use for weights of lights are new here.

use super::kernel::{MeanVector, Vectors};
use super::points::{self, Kernels, Point, Points};
use super::source::{FITTED_SOURCES, Source};
use super::{FITTED, step};
use crate::light::Light;
use crate::root::root;
use glam::Vec3;

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
    vectors: Vectors,
    /// The sources with their energies, and the lights with the energies of which the fit computes the residual.
    sources: Points<FITTED_SOURCES>,
    lights: Points<FITTED>,
    /// The kernel between one light and each source, and between one light and each light.
    to_sources: Kernels<FITTED_SOURCES>,
    to_lights: Kernels<FITTED>,
    /// Luminance of each source.
    energies: [f32; FITTED_SOURCES],
    /// Luminance of all sources, the unit of the energies of `sources` and `lights`.
    total: f32,
    /// The residual, later the corrections.
    corrections: [f32; FITTED],
    ones: [f32; FITTED],
    /// Gradients of the error with respect to the lights' mean vectors.
    pulls: [Vec3; FITTED],
}

impl Fit {
    pub(super) const fn new() -> Self {
        let row = [0.0; FITTED];
        Self {
            matrix: [row; FITTED],
            vectors: Vectors::new(),
            sources: Points::new(),
            lights: Points::new(),
            to_sources: Kernels::new(),
            to_lights: Kernels::new(),
            energies: [0.0; FITTED_SOURCES],
            total: 0.0,
            corrections: row,
            ones: row,
            pulls: [Vec3::ZERO; FITTED],
        }
    }

    /// Changes the energies of the lights that represent `sources` to the least expected error.
    pub(super) fn run(&mut self, sources: &[Source], lights: &mut [Light]) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.represent(sources.iter().map(|source| (MeanVector::of_point(source.at), source.y)));
        self.place(lights, |light| MeanVector::of_point(light.direction));
        // The residual is that of lights with the energies of the sources that they represent.
        let own = &mut self.corrections[..n];
        own.fill(0.0);
        for source in sources {
            if let Some(own) = own.get_mut(usize::from(source.owner)) {
                *own += source.y;
            }
        }
        self.lights.set_shares(own.iter().map(|y| y / self.total));
        self.residual(n, false);
        self.finish(lights, RIDGE, MOST);
    }

    /// Changes the energies of the discs that represent `sources`, of which `group` together count as one disc, to the least expected error.
    pub(super) fn run_discs(&mut self, sources: &[Source], group: usize, lights: &mut [Light]) {
        self.represent_discs(sources, group);
        self.fit_discs(lights, false);
    }

    /// Moves the discs that represent `sources`, of which `group` together count as one disc, by `steps` steps down the gradient of the error in the
    /// norm of the kernel, each with the energies of least expected error.
    pub(super) fn move_discs(
        &mut self,
        sources: &[Source],
        group: usize,
        lights: &mut [Light],
        steps: usize,
    ) {
        self.represent_discs(sources, group);
        for _ in 0..steps {
            self.fit_discs(lights, true);
            for (light, pull) in lights.iter_mut().zip(&self.pulls) {
                light.direction = step::stepped(light, *pull);
            }
        }
    }

    /// Changes the energies of discs; with `pulls`, computes the gradients of their errors.
    fn fit_discs(&mut self, lights: &mut [Light], pulls: bool) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.place(lights, MeanVector::of_light);
        self.lights.set_shares(lights.iter().map(|light| energy(light) / self.total));
        self.residual(n, pulls);
        self.finish(lights, DISC_RIDGE, DISC_MOST);
        if pulls {
            self.lights.set_shares(lights.iter().map(|light| energy(light) / self.total));
            for (i, pull) in self.pulls.iter_mut().enumerate().take(n) {
                let at = self.lights.point(i);
                self.lights.look_up(&at, &mut self.to_lights);
                *pull -= points::pull_sum(self.lights.pull(&at, &self.to_lights)) * self.total;
            }
        }
    }

    /// Replaces the sources by `sources`, of which `group` of the same leaf together count as one disc.
    fn represent_discs(&mut self, sources: &[Source], group: usize) {
        let groups =
            sources.chunk_by(|a, b| a.owner == b.owner).flat_map(move |own| own.chunks(group.max(1)));
        self.represent(groups.map(|group| {
            let mut discs = group.iter().map(|s| (MeanVector::of_disc(s.at, s.radius), s.y));
            let first = discs.next().unwrap_or_default();
            discs.fold(first, |(a, y), (b, more)| (a.mixed(&b, more / (y + more)), y + more))
        }));
    }

    /// Replaces the sources by those with the mean vectors and energies in `sources`.
    fn represent(&mut self, sources: impl Iterator<Item = (MeanVector, f32)>) {
        self.sources.clear();
        let mut n = 0;
        for ((vector, y), energy) in sources.zip(&mut self.energies) {
            self.sources.push(&Point::new(&vector));
            *energy = y;
            n += 1;
        }
        let energies = &self.energies[..n];
        self.total = energies.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        self.sources.set_shares(energies.iter().map(|y| y / self.total));
    }

    /// Replaces the lights and computes the matrix; `vector` returns the mean vector of a light.
    fn place(&mut self, lights: &[Light], vector: impl Fn(&Light) -> MeanVector) {
        self.ones = [1.0; FITTED];
        self.lights.clear();
        for (i, light) in lights.iter().enumerate().take(FITTED) {
            let vector = vector(light);
            self.lights.push(&Point::new(&vector));
            self.vectors.set(i, &vector);
            self.vectors.kernels(&vector, &mut self.matrix[i][..=i]);
        }
    }

    /// Computes the residual of the first `n` lights and, with `pulls`, the gradients due to the sources.
    fn residual(&mut self, n: usize, pulls: bool) {
        for i in 0..n.min(FITTED) {
            let at = self.lights.point(i);
            self.sources.look_up(&at, &mut self.to_sources);
            self.lights.look_up(&at, &mut self.to_lights);
            let sum = self.sources.kernel(&self.to_sources).wrapping_sub(self.lights.kernel(&self.to_lights));
            self.corrections[i] = points::kernel_sum(sum) * self.total;
            if pulls {
                self.pulls[i] = points::pull_sum(self.sources.pull(&at, &self.to_sources)) * self.total;
            }
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
            scale(lights, &self.corrections, most);
        }
    }

    /// Solves for the correction under a sum of 0 into `corrections`; returns false if the matrix is not positive definite.
    fn solve(&mut self, n: usize) -> bool {
        for i in 0..n {
            for j in 0..=i {
                let (before, row) = self.matrix.split_at(i);
                let other = if j < i { &before[j] } else { &row[0] };
                let rest = self.matrix[i][j] - dot(&row[0][..j], &other[..j]);
                if j < i {
                    self.matrix[i][j] = rest / self.matrix[j][j];
                } else if rest > f32::MIN_POSITIVE {
                    self.matrix[i][i] = root(rest);
                } else {
                    return false;
                }
            }
        }
        substitute(&self.matrix, &mut self.corrections[..n]);
        substitute(&self.matrix, &mut self.ones[..n]);
        let x = &mut self.corrections[..n];
        let (sum, unit) = (x.iter().sum::<f32>(), self.ones[..n].iter().sum::<f32>());
        for (x, one) in x.iter_mut().zip(&self.ones[..n]) {
            *x -= one * sum / unit;
        }
        true
    }
}

/// Returns the sum of the products of `a` and `b`, which have equal lengths, in four partial sums.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Solves L L' x = b, where `x` contains b at first and the solution at the end.
fn substitute(l: &[[f32; FITTED]; FITTED], x: &mut [f32]) {
    let n = x.len();
    for i in 0..n {
        x[i] = (x[i] - dot(&l[i][..i], &x[..i])) / l[i][i];
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
