//! Reference samplers for comparisons: methods from the literature.
//!
//! All are deterministic and keep the map's energy in every channel (to rounding). They work on texels or
//! on a reduced map whose cells carry exact energies and centroids ([`cells`]). An all-black map has no
//! lights; a map with fewer lit cells than lights asked for gives fewer. Where a published method is not
//! fully known its type says that it is a reconstruction.
//!
//! | name | method | ids |
//! |---|---|---|
//! | `median-cut` | [`MedianCut`] | index |
//! | `variance-min` | [`VarianceMin`] | index |
//! | `structured` | [`Structured`] | index |
//! | `lloyd`, `lloyd-warm` | [`Lloyd`] | point; live on in `lloyd-warm` |
//! | `rank-threshold` | [`RankThreshold`] | candidate |
//! | NAME`+v` | any of these and a Voronoi gather ([`Gathered`]) | the sampler's |
//! | (offline) | [`volume()`], a whole sequence at once | box |

pub mod cells;
mod gather;
mod lloyd;
mod median_cut;
mod rank_threshold;
mod sat;
mod structured;
mod variance_min;
mod volume;

pub use gather::{Gathered, gather};
pub use lloyd::Lloyd;
pub use median_cut::MedianCut;
pub use rank_threshold::RankThreshold;
pub use structured::Structured;
pub use variance_min::VarianceMin;
pub use volume::volume;

use crate::env::EnvMap;
use crate::metrics::{Domain, Lit};

/// A sampler: decomposes a map into at most a given number of lights.
pub trait Baseline {
    /// Its name in charts and reports.
    fn name(&self) -> &'static str;

    /// Decomposes one map; samplers with a memory continue from the map before.
    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit>;
}

/// Every sampler that works map by map, raw and gathered, each in its first state.
#[must_use]
pub fn all() -> Vec<Box<dyn Baseline>> {
    vec![
        Box::new(MedianCut),
        Box::new(Gathered::new(MedianCut, "median-cut+v")),
        Box::new(VarianceMin),
        Box::new(Gathered::new(VarianceMin, "variance-min+v")),
        Box::new(Structured),
        Box::new(Gathered::new(Structured, "structured+v")),
        Box::new(Lloyd::cold()),
        Box::new(Gathered::new(Lloyd::cold(), "lloyd+v")),
        Box::new(Lloyd::warm()),
        Box::new(Gathered::new(Lloyd::warm(), "lloyd-warm+v")),
        Box::new(RankThreshold),
        Box::new(Gathered::new(RankThreshold, "rank-threshold+v")),
    ]
}

#[cfg(test)]
mod tests;
