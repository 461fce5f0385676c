//! Irradiance of the receivers of the scores under maps, discs and ambient light.

use std::sync::LazyLock;

use super::receiver::{OPEN, Receiver, SHADOWED, open, shadowed};
use super::{Disc, sh};

/// Receivers of one kind, one array per component so that the sums over a map run in vector registers.
#[derive(Debug)]
pub(super) struct ReceiverSet {
    receivers: Vec<Receiver>,
    normal: [Vec<f64>; 3],
    axis: [Vec<f64>; 3],
    cos_half_angle: Vec<f64>,
}

/// The open receivers of the scores.
pub(super) static OPEN_SET: LazyLock<ReceiverSet> =
    LazyLock::new(|| ReceiverSet::new((0..OPEN).map(open).collect()));
/// The shadowed receivers of the scores.
pub(super) static SHADOWED_SET: LazyLock<ReceiverSet> =
    LazyLock::new(|| ReceiverSet::new((0..SHADOWED).map(shadowed).collect()));

impl ReceiverSet {
    fn new(receivers: Vec<Receiver>) -> Self {
        let component = |of: fn(&Receiver) -> [f64; 3]| {
            std::array::from_fn(|axis| receivers.iter().map(|p| of(p)[axis]).collect())
        };
        let normal = component(|p| p.normal);
        let axis = component(|p| p.axis);
        let cos_half_angle = receivers.iter().map(|p| p.cos_half_angle).collect();
        Self { receivers, normal, axis, cos_half_angle }
    }

    /// Returns, for every receiver k, the sum over the texels of flux max(0, n_k . d) V_k(d).
    pub(super) fn irradiance(&self, texels: impl Iterator<Item = ([f64; 3], f64)>) -> Vec<f64> {
        let mut sums = vec![0.0; self.receivers.len()];
        if self.receivers.iter().all(|receiver| receiver.cos_half_angle > 1.0) {
            texels.for_each(|(d, flux)| self.add_open(d, flux, &mut sums));
        } else {
            texels.for_each(|(d, flux)| self.add(d, flux, &mut sums));
        }
        sums
    }

    /// Returns the irradiance of every receiver under discs (centre, radius in radians, flux).
    pub(super) fn irradiance_of_discs(&self, discs: impl Iterator<Item = ([f64; 3], f64, f64)>) -> Vec<f64> {
        let mut sums = vec![0.0; self.receivers.len()];
        for (centre, radius, flux) in discs {
            let disc = Disc::new(centre, radius);
            sums.iter_mut()
                .zip(&self.receivers)
                .for_each(|(sum, receiver)| *sum += flux * disc.weight(receiver));
        }
        sums
    }

    /// Adds one texel to the sums of receivers without cones.
    fn add_open(&self, d: [f64; 3], flux: f64, sums: &mut [f64]) {
        // Slices of equal length allow the compiler to remove the bounds checks.
        let count = sums.len();
        let [nx, ny, nz] = [&self.normal[0][..count], &self.normal[1][..count], &self.normal[2][..count]];
        for k in 0..count {
            let cosine = nx[k] * d[0] + ny[k] * d[1] + nz[k] * d[2];
            sums[k] += flux * cosine.max(0.0);
        }
    }

    /// Adds one texel to the sums of all receivers.
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

    /// Returns, for every receiver k and each function i of the ambient basis, the sum over the texels of basis_i(d) dOmega max(0, n_k . d)
    /// V_k(d).
    fn ambient(&self, texels: impl Iterator<Item = Texel>) -> Vec<[f64; 9]> {
        let mut sums = vec![[0.0; 9]; self.receivers.len()];
        for Texel { direction: d, solid_angle } in texels {
            let functions = sh::basis(d).map(|y| y * solid_angle);
            for (receiver, sums) in self.receivers.iter().zip(&mut sums) {
                let weight = receiver.weight(d);
                if weight > 0.0 {
                    sums.iter_mut().zip(functions).for_each(|(sum, y)| *sum += weight * y);
                }
            }
        }
        sums
    }
}

/// A texel of a map: its direction, a unit vector, and its solid angle in steradians.
#[derive(Clone, Copy, Debug)]
pub(super) struct Texel {
    pub(super) direction: [f64; 3],
    pub(super) solid_angle: f64,
}

/// Irradiance of each receiver under each function of the ambient basis, summed over texels.
#[derive(Debug)]
pub(super) struct AmbientResponse {
    pub(super) open: Vec<[f64; 9]>,
    pub(super) shadowed: Vec<[f64; 9]>,
    /// Sum over the texels of each basis function times the solid angle.
    pub(super) total: [f64; 9],
}

impl AmbientResponse {
    pub(super) fn new(texels: impl Iterator<Item = Texel> + Clone) -> Self {
        let mut total = [0.0; 9];
        for Texel { direction, solid_angle } in texels.clone() {
            let functions = sh::basis(direction);
            total.iter_mut().zip(functions).for_each(|(sum, y)| *sum += y * solid_angle);
        }
        Self { open: OPEN_SET.ambient(texels.clone()), shadowed: SHADOWED_SET.ambient(texels), total }
    }
}
