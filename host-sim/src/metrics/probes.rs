//! The probes of the scores: 768 open ones and 512 with an occluding cone.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use super::vector::dot;
use super::{Disc, Grid, sh};

/// How many open probes there are.
pub const OPEN: usize = 768;
/// How many shadowed probes there are.
pub const SHADOWED: usize = 512;

/// Direction `k` of the spherical Fibonacci lattice of `count` points: z = 1 - (2k + 1) / count,
/// phi = 2 pi frac(0.6180339887498949 k).
#[must_use]
pub fn fib(k: usize, count: usize) -> [f64; 3] {
    let z = 1.0 - (2 * k + 1) as f64 / count as f64;
    let phi = TAU * (k as f64 * 0.618_033_988_749_894_9).fract();
    let r = (1.0 - z * z).sqrt();
    [r * phi.cos(), r * phi.sin(), z]
}

/// A receiver: a normal and a cone of directions that contribute no light.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    /// Unit normal.
    pub normal: [f64; 3],
    /// Axis of the occluding cone.
    pub axis: [f64; 3],
    /// Cosine of the cone's half-angle; a value above 1 stands for no cone.
    pub cos_half_angle: f64,
}

impl Probe {
    /// max(0, n . d) V(d): the weight of light from the unit vector `d`.
    #[must_use]
    pub fn weight(&self, d: [f64; 3]) -> f64 {
        if dot(self.axis, d) > self.cos_half_angle { 0.0 } else { dot(self.normal, d).max(0.0) }
    }
}

/// Open probe `k` of [`OPEN`].
#[must_use]
pub fn open(k: usize) -> Probe {
    let normal = fib(k, OPEN);
    Probe { normal, axis: normal, cos_half_angle: 2.0 }
}

/// Shadowed probe `k` of [`SHADOWED`]: a cone of 10 to 60 degrees half-angle round another lattice point.
#[must_use]
pub fn shadowed(k: usize) -> Probe {
    let half_angle_deg = 10.0 + 50.0 * ((k as f64 + 0.5) * 0.754_877_666_246_692_7).fract();
    Probe {
        normal: fib(k, SHADOWED),
        axis: fib((197 * k + 101) % SHADOWED, SHADOWED),
        cos_half_angle: half_angle_deg.to_radians().cos(),
    }
}

/// Probes of one kind, one array per component so that the sums over a map run in vector registers.
#[derive(Debug)]
pub(super) struct ProbeSet {
    probes: Vec<Probe>,
    normal: [Vec<f64>; 3],
    axis: [Vec<f64>; 3],
    cos_half_angle: Vec<f64>,
}

/// The open probes.
pub(super) static OPEN_SET: LazyLock<ProbeSet> =
    LazyLock::new(|| ProbeSet::new((0..OPEN).map(open).collect()));
/// The shadowed probes.
pub(super) static SHADOWED_SET: LazyLock<ProbeSet> =
    LazyLock::new(|| ProbeSet::new((0..SHADOWED).map(shadowed).collect()));

impl ProbeSet {
    fn new(probes: Vec<Probe>) -> Self {
        let component = |of: fn(&Probe) -> [f64; 3]| {
            std::array::from_fn(|axis| probes.iter().map(|p| of(p)[axis]).collect())
        };
        let normal = component(|p| p.normal);
        let axis = component(|p| p.axis);
        let cos_half_angle = probes.iter().map(|p| p.cos_half_angle).collect();
        Self { probes, normal, axis, cos_half_angle }
    }

    /// Sum over the texels of flux max(0, n_k . d) V_k(d), for every probe k.
    pub(super) fn irradiance(&self, texels: impl Iterator<Item = ([f64; 3], f64)>) -> Vec<f64> {
        let mut sums = vec![0.0; self.probes.len()];
        if self.probes.iter().all(|probe| probe.cos_half_angle > 1.0) {
            texels.for_each(|(d, flux)| self.add_open(d, flux, &mut sums));
        } else {
            texels.for_each(|(d, flux)| self.add(d, flux, &mut sums));
        }
        sums
    }

    /// Irradiance of every probe under lights that are read as discs: (centre, radius in radians, flux).
    pub(super) fn irradiance_of_discs(&self, discs: impl Iterator<Item = ([f64; 3], f64, f64)>) -> Vec<f64> {
        let mut sums = vec![0.0; self.probes.len()];
        for (centre, radius, flux) in discs {
            let disc = Disc::new(centre, radius);
            sums.iter_mut().zip(&self.probes).for_each(|(sum, probe)| *sum += flux * disc.weight(probe));
        }
        sums
    }

    /// Adds one texel to every probe, where none has a cone.
    fn add_open(&self, d: [f64; 3], flux: f64, sums: &mut [f64]) {
        // Slices of one length let the compiler drop the bounds checks.
        let count = sums.len();
        let [nx, ny, nz] = [&self.normal[0][..count], &self.normal[1][..count], &self.normal[2][..count]];
        for k in 0..count {
            let cosine = nx[k] * d[0] + ny[k] * d[1] + nz[k] * d[2];
            sums[k] += flux * cosine.max(0.0);
        }
    }

    /// Adds one texel to every probe.
    fn add(&self, d: [f64; 3], flux: f64, sums: &mut [f64]) {
        let count = sums.len();
        let [nx, ny, nz] = [&self.normal[0][..count], &self.normal[1][..count], &self.normal[2][..count]];
        let [ax, ay, az] = [&self.axis[0][..count], &self.axis[1][..count], &self.axis[2][..count]];
        let limit = &self.cos_half_angle[..count];
        for k in 0..count {
            let cosine = nx[k] * d[0] + ny[k] * d[1] + nz[k] * d[2];
            let from_axis = ax[k] * d[0] + ay[k] * d[1] + az[k] * d[2];
            let weight = if from_axis > limit[k] { 0.0 } else { cosine.max(0.0) };
            sums[k] += flux * weight;
        }
    }

    /// Sum over the texels of basis_i(d) dOmega max(0, n_k . d) V_k(d), for every probe k and each function i of the ambient basis.
    fn ambient(&self, grid: &Grid) -> Vec<[f64; 9]> {
        let mut sums = vec![[0.0; 9]; self.probes.len()];
        for (k, d) in grid.directions().enumerate() {
            let functions = sh::basis(d).map(|y| y * grid.solid_angle(k));
            for (probe, sums) in self.probes.iter().zip(&mut sums) {
                let weight = probe.weight(d);
                if weight > 0.0 {
                    sums.iter_mut().zip(functions).for_each(|(sum, y)| *sum += weight * y);
                }
            }
        }
        sums
    }
}

/// Irradiance of each probe under each function of the ambient basis, summed over a grid's texels.
#[derive(Debug)]
pub(super) struct AmbientResponse {
    pub(super) open: Vec<[f64; 9]>,
    pub(super) shadowed: Vec<[f64; 9]>,
    /// Sum of the functions themselves.
    pub(super) total: [f64; 9],
}

impl AmbientResponse {
    pub(super) fn new(grid: &Grid) -> Self {
        let mut total = [0.0; 9];
        for (k, d) in grid.directions().enumerate() {
            let functions = sh::basis(d);
            total.iter_mut().zip(functions).for_each(|(sum, y)| *sum += y * grid.solid_angle(k));
        }
        Self { open: OPEN_SET.ambient(grid), shadowed: SHADOWED_SET.ambient(grid), total }
    }
}
