//! Baselines: methods from the literature for comparison with the core's samplers.
//!
//! All baselines are deterministic and preserve the map's energy in every channel except for rounding errors. They read texels, or cells of
//! texels with exact energies and centroids ([`cells`]). A black map has no lights; a map with fewer lit cells than requested lights has one
//! light per lit cell. The documentation of each method states whether it is a reconstruction from an incomplete publication.
//!
//! | name | method | ids |
//! |---|---|---|
//! | `median-cut` | [`Stateless::MEDIAN_CUT`] | index |
//! | `variance-min` | [`Stateless::VARIANCE_MIN`] | index |
//! | `structured` | [`Stateless::STRUCTURED`] | index |
//! | `lloyd`, `lloyd-warm` | [`Lloyd`] | point; persistent in `lloyd-warm` |
//! | `rank-threshold` | [`Stateless::RANK_THRESHOLD`] | candidate |
//! | NAME`+v` | the method NAME, followed by a Voronoi gather ([`Gathered`]) | the method's |
//! | (offline) | [`volume()`], whose input is a whole sequence | box |
//! | (offline) | [`sg_mixture()`], whose output is lobes in place of lights | none |

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

/// A method of the literature that decomposes a map into at most the requested number of lights.
pub trait Baseline {
    /// Returns the name of the method in charts and reports.
    fn name(&self) -> &'static str;

    /// Decomposes one map into at most `lights` lights; methods with state start from the result for the previous map.
    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit>;
}

/// A method for comparison that decomposes each map without the state of earlier maps.
#[derive(Clone, Copy, Debug)]
pub struct Stateless {
    name: &'static str,
    decompose: fn(&EnvMap, Domain, usize) -> Vec<Lit>,
}

impl Stateless {
    /// Method of Debevec 2005: regions of equal energy.
    pub const MEDIAN_CUT: Self = Self { name: "median-cut", decompose: median_cut::decompose };
    /// Method of Viriyothai and Debevec 2009: regions of least variance.
    pub const VARIANCE_MIN: Self = Self { name: "variance-min", decompose: variance_min::decompose };
    /// Method in the manner of Ostromoukhov et al. 2004: ranked candidates whose rank is below their importance.
    pub const RANK_THRESHOLD: Self = Self { name: "rank-threshold", decompose: rank_threshold::decompose };
    /// Method of Agarwal et al. 2003: threshold layers of luminance, farthest-first points.
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

/// Returns every baseline for single maps, each without and with Voronoi gather, in its initial state.
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
