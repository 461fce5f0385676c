//! Decomposition of a map into a mixture of spherical Gaussians, fitted by expectation-maximisation.

use std::f64::consts::TAU;

use super::cells::{Cells, Flux, voronoi};
use super::{Baseline, Lloyd};
use crate::env::EnvMap;
use crate::metrics::vector::{dot, tangents};
use crate::metrics::{Domain, luminance};

/// Largest number of columns of the map's cells; energies and centroids of the cells are exact.
const WIDTH: usize = 256;
/// Largest number of iterations of the fit.
const ITERATIONS: usize = 300;
/// Gain of the mean logarithmic likelihood by an iteration below which the iterations end.
const LEAST_GAIN: f64 = 1e-6;
/// Least and greatest concentration of a lobe: a lobe over nearly the whole sphere, and a lobe of 0.06 degrees.
const CONCENTRATIONS: (f64, f64) = (1e-3, 1e6);
/// Number of directions of equal energy that represent a lobe in the scores.
const POINTS: usize = 192;

/// A spherical Gaussian (von Mises-Fisher lobe): radiance in proportion to exp(concentration (axis . d - 1)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Unit vector towards the lobe's peak.
    pub axis: [f64; 3],
    /// Concentration kappa of the lobe, above 0.
    pub concentration: f64,
    /// Integral of the lobe's radiance over the sphere, RGB.
    pub flux: [f64; 3],
}

impl Lobe {
    /// Returns directions of equal luminous energy that represent the lobe, each with its energy: quantiles of the angle from the axis, at azimuths
    /// a golden angle apart.
    pub fn points(&self) -> impl Iterator<Item = ([f64; 3], f64)> + '_ {
        let [across, up] = tangents(self.axis);
        let energy = luminance(self.flux) / POINTS as f64;
        let tail = (-2.0 * self.concentration).exp();
        (0..POINTS).map(move |k| {
            let part = (k as f64 + 0.5) / POINTS as f64;
            let z = 1.0 + (tail + (1.0 - tail) * (1.0 - part)).ln() / self.concentration;
            let (sin, cos) = (TAU * (k as f64 * 0.618_033_988_749_894_9).fract()).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            (std::array::from_fn(|i| z * self.axis[i] + r * (cos * across[i] + sin * up[i])), energy)
        })
    }

    fn of(sum: &Flux, fallback: [f64; 3]) -> Self {
        let length = 1.0 - sum.spread() / sum.luminance.max(f64::MIN_POSITIVE);
        Self { axis: sum.centroid().unwrap_or(fallback), concentration: concentration(length), flux: sum.rgb }
    }

    /// Returns the mean logarithm of the lobe's density, times the lobe's share of the energy `whole`, over a cell with the mean vector `mean`.
    fn log_density(&self, mean: [f64; 3], whole: f64) -> f64 {
        let kappa = self.concentration;
        let share = luminance(self.flux) / whole;
        let peak = kappa / (TAU * -(-2.0 * kappa).exp_m1());
        (share * peak).max(f64::MIN_POSITIVE).ln() + kappa * (dot(mean, self.axis) - 1.0)
    }
}

/// Returns the concentration of a lobe with the mean resultant length `length`: the inverse of the function coth k - 1 / k.
fn concentration(length: f64) -> f64 {
    let (least, most) = CONCENTRATIONS;
    let r = length.clamp(0.0, 1.0 - 1e-12);
    // The first estimate is the formula of A. Banerjee et al. (2005), with an error of at most 5 %.
    let mut kappa = (r * (3.0 - r * r) / (1.0 - r * r)).clamp(least, most);
    for _ in 0..4 {
        let (mean, slope) = if kappa < 0.01 {
            (kappa / 3.0, 1.0 / 3.0)
        } else {
            (1.0 / kappa.tanh() - 1.0 / kappa, 1.0 / (kappa * kappa) - kappa.sinh().powi(-2))
        };
        kappa = (kappa + (r - mean) / slope).clamp(least, most);
    }
    kappa
}

/// Fits `count` lobes to a map by expectation-maximisation, which starts at the points of [`Lloyd`] relaxation; a map with fewer lit cells has one
/// lobe per lit cell. The sum of the lobes has the map's energy in every channel.
///
/// A cell is represented by its energy and its mean vector, since the logarithm of a lobe's density is a linear function of the direction.
///
/// # References
/// A. Banerjee, I. S. Dhillon, J. Ghosh, S. Sra, "Clustering on the unit hypersphere using von Mises-Fisher distributions", JMLR 2005;
/// Y.-T. Tsai, Z.-C. Shih, "All-frequency precomputed radiance transfer using spherical radial basis functions and clustered tensor
/// approximation", SIGGRAPH 2006, for lighting by such lobes.
#[must_use]
pub fn sg_mixture(map: &EnvMap, domain: Domain, count: usize) -> Vec<Lobe> {
    let cells = Cells::new(map, domain, WIDTH);
    let start: Vec<[f64; 3]> =
        Lloyd::cold().decompose(map, domain, count).iter().map(|lit| lit.direction).collect();
    let sums = voronoi(&cells, &start);
    let mut lobes: Vec<Lobe> = sums.iter().zip(&start).map(|(sum, at)| Lobe::of(sum, *at)).collect();
    let mut likelihood = f64::NEG_INFINITY;
    for _ in 0..ITERATIONS {
        let found = improve(&cells, &mut lobes);
        if found - likelihood < LEAST_GAIN {
            break;
        }
        likelihood = found;
    }
    lobes
}

/// Runs one iteration of the fit; returns the mean logarithmic likelihood of the lobes before the iteration.
fn improve(cells: &Cells, lobes: &mut [Lobe]) -> f64 {
    let whole = cells.total().luminance;
    let mut sums = vec![Flux::default(); lobes.len()];
    let mut likelihood = 0.0;
    let mut parts = vec![0.0; lobes.len()];
    for flux in cells.lit().map(|k| cells.flux(k)) {
        let mean = flux.moment.map(|v| v / flux.luminance);
        parts.iter_mut().zip(&*lobes).for_each(|(part, lobe)| *part = lobe.log_density(mean, whole));
        let most = parts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        parts.iter_mut().for_each(|part| *part = (*part - most).exp());
        let sum: f64 = parts.iter().sum();
        likelihood += flux.luminance / whole * (most + sum.ln());
        for (total, part) in sums.iter_mut().zip(&parts).filter(|(_, part)| **part > 1e-12 * sum) {
            let part = part / sum;
            *total += Flux {
                rgb: flux.rgb.map(|v| v * part),
                luminance: flux.luminance * part,
                moment: flux.moment.map(|v| v * part),
            };
        }
    }
    lobes.iter_mut().zip(&sums).for_each(|(lobe, sum)| *lobe = Lobe::of(sum, lobe.axis));
    likelihood
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::vector::angle_deg;

    const AXES: [([f64; 3], f64, f32); 2] = [([0.0, 0.6, 0.8], 40.0, 5.0), ([0.8, 0.0, -0.6], 8.0, 1.0)];

    /// Returns a map of two lobes with the axes, concentrations and peaks of [`AXES`].
    fn two_lobes() -> EnvMap {
        EnvMap::from_fn(256, 128, |d| {
            [AXES.iter().map(|(axis, kappa, peak)| peak * (kappa * (dot(*axis, d) - 1.0)).exp() as f32).sum();
                3]
        })
    }

    #[test]
    fn a_mixture_of_two_lobes_is_found() {
        let mut found = sg_mixture(&two_lobes(), Domain::Sphere, 2);
        found.sort_by(|a, b| b.concentration.total_cmp(&a.concentration));
        for (lobe, (axis, kappa, peak)) in found.iter().zip(AXES) {
            assert!(angle_deg(lobe.axis, axis) < 0.3, "{lobe:?}");
            assert!((lobe.concentration / kappa - 1.0).abs() < 0.03, "{lobe:?}");
            let flux = f64::from(peak) * TAU * (1.0 - (-2.0 * kappa).exp()) / kappa;
            assert!((lobe.flux[0] / flux - 1.0).abs() < 0.02, "{lobe:?}: {flux}");
        }
    }

    #[test]
    fn the_points_of_a_lobe_have_its_mean_vector() {
        for kappa in [0.01, 1.0, 20.0, 1e4] {
            let lobe = Lobe { axis: [0.0, 0.6, 0.8], concentration: kappa, flux: [1.0; 3] };
            let mean: f64 = lobe.points().map(|(d, y)| y * dot(d, lobe.axis)).sum();
            let exact = 1.0 / kappa.tanh() - 1.0 / kappa;
            assert!((mean - exact).abs() < 2e-3 * (1.0 - exact) + 1e-4, "{kappa}: {mean}, not {exact}");
            assert!((concentration(exact) / kappa - 1.0).abs() < 1e-3, "{kappa}");
        }
    }
}
