//! Lloyd steps for up to eight lights: each light takes the energy of the quads nearest to it and moves to their centroid.

use super::GATHERED;
use super::nodes::{Leaf, Nodes};
use super::source::{nearest, pieces};
use crate::light::Light;
use crate::pyramid::Quad;

/// Number of Lloyd steps per frame: from the tree's lights, the error is within 2 % of convergence after four.
const STEPS: usize = 4;

/// Moves at most [`GATHERED`] lights; the sum of their energies does not change.
pub(super) fn gather(nodes: &Nodes<'_>, leaves: &[Leaf], lights: &mut [Light]) {
    for _ in 0..STEPS {
        let mut sums = [Quad::default(); GATHERED];
        let pieces = pieces(nodes, leaves, lights.len(), false);
        for quad in pieces.map(|piece| piece.quad).filter(|quad| quad.y() > 0.0) {
            sums[nearest(lights, &quad).min(GATHERED - 1)].add(&quad);
        }
        for (light, sum) in lights.iter_mut().zip(&sums).filter(|(_, sum)| sum.y() > 0.0) {
            let Light { id, parent, direction, .. } = *light;
            *light = Light { parent, ..Light::at_centroid(id, sum, || direction) };
        }
        // A light that is nearest to no quad has no energy left.
        for (light, _) in lights.iter_mut().zip(&sums).filter(|(_, sum)| sum.y() <= 0.0) {
            light.irradiance = [0.0; 3];
        }
    }
}
