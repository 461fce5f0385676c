//! Reference samplers for comparisons: methods from the literature.
//!
//! All samplers are deterministic and keep the map's energy in every channel up to rounding. They read texels or a reduced map whose cells
//! have exact energies and centroids ([`cells`]). A black map has no lights; a map with fewer lit cells than requested lights has fewer
//! lights. The documentation of a type states whether it is a reconstruction because the publication is incomplete.
//!
//! | name | method | ids |
//! |---|---|---|
//! | `median-cut` | [`Stateless::MEDIAN_CUT`] | index |
//! | `variance-min` | [`Stateless::VARIANCE_MIN`] | index |
//! | `structured` | [`Stateless::STRUCTURED`] | index |
//! | `lloyd`, `lloyd-warm` | [`Lloyd`] | point; persistent in `lloyd-warm` |
//! | `rank-threshold` | [`Stateless::RANK_THRESHOLD`] | candidate |
//! | NAME`+v` | any of these and a Voronoi gather ([`Gathered`]) | the sampler's |
//! | (offline) | [`volume()`], a whole sequence at once | box |
//! | (offline) | [`sg_mixture()`], lobes in the place of lights | none |

pub mod cells;
mod gather;
mod lloyd;
mod median_cut;
mod rank_threshold;
mod sat;
mod sg_mixture;
mod structured;
mod variance_min;
mod volume;

pub use gather::{Gathered, gather};
pub use lloyd::Lloyd;
pub use sg_mixture::{Lobe, sg_mixture};
pub use volume::volume;

use crate::env::EnvMap;
use crate::metrics::{Domain, Lit};

/// A sampler: decomposes a map into at most a given number of lights.
pub trait Baseline {
    /// Name of the method in charts and reports.
    fn name(&self) -> &'static str;

    /// Decomposes one map; samplers with state continue from the previous map.
    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit>;
}

/// A sampler without state.
#[derive(Clone, Copy, Debug)]
pub struct Stateless {
    name: &'static str,
    decompose: fn(&EnvMap, Domain, usize) -> Vec<Lit>,
}

impl Stateless {
    /// The sampler of Debevec 2005: regions of equal energy.
    pub const MEDIAN_CUT: Self = Self { name: "median-cut", decompose: median_cut::decompose };
    /// The sampler of Viriyothai and Debevec 2009: regions of least variance.
    pub const VARIANCE_MIN: Self = Self { name: "variance-min", decompose: variance_min::decompose };
    /// The sampler of Ostromoukhov et al. 2004: ranked candidates whose rank is below their importance.
    pub const RANK_THRESHOLD: Self = Self { name: "rank-threshold", decompose: rank_threshold::decompose };
    /// The sampler of Agarwal et al. 2003: threshold layers, farthest-first points.
    pub const STRUCTURED: Self = Self { name: "structured", decompose: structured::decompose };
}

impl Baseline for Stateless {
    fn name(&self) -> &'static str {
        self.name
    }

    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
        (self.decompose)(map, domain, lights)
    }
}

/// Returns every sampler for single maps, raw and gathered, each in its initial state.
#[must_use]
pub fn all() -> Vec<Box<dyn Baseline>> {
    vec![
        Box::new(Stateless::MEDIAN_CUT),
        Box::new(Gathered::new(Stateless::MEDIAN_CUT, "median-cut+v")),
        Box::new(Stateless::VARIANCE_MIN),
        Box::new(Gathered::new(Stateless::VARIANCE_MIN, "variance-min+v")),
        Box::new(Stateless::STRUCTURED),
        Box::new(Gathered::new(Stateless::STRUCTURED, "structured+v")),
        Box::new(Lloyd::cold()),
        Box::new(Gathered::new(Lloyd::cold(), "lloyd+v")),
        Box::new(Lloyd::warm()),
        Box::new(Gathered::new(Lloyd::warm(), "lloyd-warm+v")),
        Box::new(Stateless::RANK_THRESHOLD),
        Box::new(Gathered::new(Stateless::RANK_THRESHOLD, "rank-threshold+v")),
    ]
}

#[cfg(test)]
mod tests;
