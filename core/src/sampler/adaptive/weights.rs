//! Weights that light receivers with random occluders best.
//!
//! Let K(d, d') be the mean over receivers of what a unit light from d and one from d' give together: over normals and occluding caps as
//! `metrics.md` draws them it depends on the angle between d and d' alone. The expected squared error of lights w_i at l_i in the
//! place of a map mu is then |mu - sum w_i delta(l_i)|^2 in the norm of K, and least where K w = K mu. Starting from the energies of
//! the leaves, the correction x solves (K + R) x = r with r_i = sum over sources s of y_s (K(l_i, s) - K(l_i, l_owner(s))), under
//! sum x = 0. R, a ridge in proportion to 1 / energy, keeps dim lights from paying for bright ones. Cholesky, in place.
//!
//! The minimisation is that of optimally weighted quadrature in a reproducing kernel space; K near 0 is linear in the angle, which makes
//! it the energy distance of Szekely and Rizzo. The kernel and its use for lights are ours.

use super::FITTED;
use super::gather::nearest;
use super::tree::{Leaf, Nodes, Tree};
use crate::arena::Buffer;
use crate::light::Light;
use crate::pyramid::{PyramidView, Quad};
use glam::Vec3;

/// K over K(0) at sin(angle / 2) = i / 32: the arc-cosine kernel (sin g + (pi - g) cos g) / (6 pi) times the probability that a cap of
/// half-angle 10 to 60 degrees hides neither. `adaptive_kernel` recomputes it.
#[rustfmt::skip]
const KERNEL: [f32; 33] = [
    1.000_000, 0.991_924, 0.980_178, 0.964_998, 0.946_614, 0.925_257, 0.901_165, 0.874_573, 0.845_691, 0.814_721, 0.781_861,
    0.747_303, 0.711_238, 0.673_853, 0.635_334, 0.595_865, 0.555_630, 0.514_815, 0.473_606, 0.432_196, 0.390_780, 0.349_562,
    0.308_758, 0.268_597, 0.229_327, 0.191_227, 0.154_610, 0.119_846, 0.087_385, 0.057_818, 0.032_047, 0.011_533, 0.000_000,
];

/// The ridge of a light of mean energy, over K(0).
const RIDGE: f32 = 0.01;

/// Levels below a leaf at which its light is looked at: eight sources per light.
const SOURCE_LEVELS: u8 = 3;

/// Order of the sources of gathered lights.
const SOURCE_ORDER: u8 = 3;

/// Largest change of a light's energy, as a factor: beyond it the fit would trade lights against each other.
const MOST: f32 = 2.0;

/// K between two unit vectors, linear between table entries.
fn kernel(a: Vec3, b: Vec3) -> f32 {
    let half_chord = libm::sqrtf((0.5 - 0.5 * a.dot(b)).clamp(0.0, 1.0));
    let x = half_chord * (KERNEL.len() - 1) as f32;
    let i = (x as usize).min(KERNEL.len() - 2);
    KERNEL[i] + (x - i as f32) * (KERNEL[i + 1] - KERNEL[i])
}

/// Scratch memory of the fit.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    matrix: [[f32; FITTED]; FITTED],
    residual: [f32; FITTED],
    ones: [f32; FITTED],
}

impl Fit {
    pub(super) const fn new() -> Self {
        Self { matrix: [[0.0; FITTED]; FITTED], residual: [0.0; FITTED], ones: [0.0; FITTED] }
    }

    /// Scales the lights, which are those of the tree's leaves, or gathered ones.
    pub(super) fn run<B: Buffer<u8>, H: Buffer<Leaf>>(
        &mut self,
        map: &PyramidView<'_>,
        tree: &Tree<B, H>,
        lights: &mut [Light],
        gathered: bool,
    ) {
        let n = lights.len().min(FITTED);
        let lights = &mut lights[..n];
        self.prepare(lights);
        if gathered {
            for quad in map.quads_of(SOURCE_ORDER).iter().filter(|q| q.y() > 0.0) {
                self.source(lights, nearest(lights, quad), quad);
            }
        } else {
            let nodes = Nodes::new(map);
            for (owner, leaf) in tree.leaves().iter().enumerate().take(n) {
                let down = SOURCE_LEVELS.min(nodes.last() - leaf.level);
                for index in leaf.index << down..(leaf.index + 1) << down {
                    self.source(lights, owner, &nodes.quad(leaf.level + down, index));
                }
            }
        }
        if self.solve(n) {
            scale(lights, &self.residual);
        }
    }

    /// Fills the matrix and clears the residual.
    fn prepare(&mut self, lights: &[Light]) {
        let mean = lights.iter().map(energy).sum::<f32>() / lights.len() as f32;
        for (i, light) in lights.iter().enumerate() {
            for (j, other) in lights.iter().enumerate().take(i) {
                self.matrix[i][j] = kernel(light.direction, other.direction);
            }
            self.matrix[i][i] = 1.0 + RIDGE * mean / energy(light).max(1e-6 * mean);
            self.residual[i] = 0.0;
            self.ones[i] = 1.0;
        }
    }

    /// Adds what a source's own place changes against that of the light that stands for it.
    fn source(&mut self, lights: &[Light], owner: usize, quad: &Quad) {
        let Some(at) = quad.first_moment().try_normalize() else { return };
        let stands = lights[owner].direction;
        for (r, light) in self.residual.iter_mut().zip(lights) {
            *r += quad.y() * (kernel(light.direction, at) - kernel(light.direction, stands));
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
                } else if rest > 0.0 {
                    self.matrix[i][i] = libm::sqrtf(rest);
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
fn scale(lights: &mut [Light], corrections: &[f32]) {
    for (light, x) in lights.iter_mut().zip(corrections) {
        let y = energy(light);
        let factor = if y > 0.0 { (1.0 + x / y).clamp(1.0 / MOST, MOST) } else { 1.0 };
        light.irradiance = light.irradiance.map(|v| v * factor);
    }
}
