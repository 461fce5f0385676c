//! Voronoi gather: the energy of each texel is added to the nearest light.

use super::Baseline;
use super::cells::{Cells, voronoi};
use crate::env::EnvMap;
use crate::metrics::{Domain, Lit};

/// Assigns each texel's energy to the nearest light and moves each light to the centroid of its energy. Ids are kept; lights without energy are
/// dropped. The result for an empty set is empty.
#[must_use]
pub fn gather(map: &EnvMap, domain: Domain, lights: &[Lit]) -> Vec<Lit> {
    let centres: Vec<[f64; 3]> = lights.iter().map(|light| light.direction).collect();
    let sums = voronoi(&Cells::texels(map, domain), &centres);
    let lit = lights.iter().zip(sums).filter(|(_, flux)| flux.luminance > 0.0);
    lit.map(|(light, flux)| flux.lit(light.direction, light.id)).collect()
}

/// A baseline followed by [`gather`]; its name is that of the baseline with the suffix `+v`.
#[derive(Debug)]
pub struct Gathered<B> {
    inner: B,
    name: &'static str,
}

impl<B: Baseline> Gathered<B> {
    /// Combines a baseline with a gather; `name` must be the baseline's name followed by "+v".
    #[must_use]
    pub fn new(inner: B, name: &'static str) -> Self {
        debug_assert!(
            name.strip_suffix("+v") == Some(inner.name()),
            "the name is the baseline's name and +v"
        );
        Self { inner, name }
    }
}

impl<B: Baseline> Baseline for Gathered<B> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
        let chosen = self.inner.decompose(map, domain, lights);
        gather(map, domain, &chosen)
    }
}
