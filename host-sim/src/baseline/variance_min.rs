//! Variance minimisation [Viriyothai2009] with the variance measured on the sphere.

use super::cells::{Cells, Flux};
use super::median_cut::regions_to_lights;
use super::sat::{Axis, Rect, Region, Sat, cut_greedily};
use crate::env::EnvMap;
use crate::metrics::{Domain, Lit};

/// Decomposes a map by cuts of the region of greatest variance, each placed where the larger of the variances of the two parts is least.
///
/// The variance of a region is 2 (S0 - |S1|), where S0 is the sum of Y dOmega and S1 the sum of Y dOmega times the direction: the energy times the
/// mean squared chord to the centroid. The published method measures the variance in the plane of the map and cuts in rounds; this
/// implementation is greedy, so that any number of lights is possible.
///
/// # References
/// K. Viriyothai, P. Debevec, "Variance minimization light probe sampling", SIGGRAPH posters 2009.
pub(super) fn decompose(map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
    let cells = Cells::texels(map, domain);
    let sat = Sat::new(&cells);
    let regions = cut_greedily(&sat, lights, Flux::spread, |region| best_cut(&sat, region));
    regions_to_lights(&cells, &regions)
}

/// Returns the cut along either axis for which the larger variance of the two parts is least; neither part may be black.
fn best_cut(sat: &Sat, region: &Region) -> Option<(Rect, Rect)> {
    let mut best: Option<(f64, (Rect, Rect))> = None;
    for axis in [Axis::Rows, Axis::Columns] {
        for at in region.rect.positions(axis) {
            let parts = region.rect.cut(axis, at);
            let (a, b) = (sat.flux(parts.0), sat.flux(parts.1));
            let worse = a.spread().max(b.spread());
            let lit = sat.is_lit(&a) && sat.is_lit(&b);
            if lit && best.is_none_or(|(least, _)| worse < least) {
                best = Some((worse, parts));
            }
        }
    }
    best.map(|(_, parts)| parts)
}
