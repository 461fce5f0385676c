//! Sources: a coarse approximation of the map by discs, used to fit weights and to estimate errors.
//!
//! Each source is a part of a leaf, so that a bright small region and a dim large region get equal numbers of sources.

use super::GATHERED;
use super::nodes::{Leaf, Nodes};
use crate::light::Light;
use crate::pyramid::Quad;
use crate::root;
use core::ops::RangeInclusive;
use glam::Vec3;

/// Largest number of sources that approximate a map.
pub(super) const SOURCES: usize = 1024;

/// Largest number of sources of a set whose weights are fitted.
pub(super) const FITTED_SOURCES: usize = SOURCES / 4;

/// Numbers of lights with which each light has fewer sources as a disc than as a point: in this range, more sources do not make discs more
/// accurate.
const HALVED: RangeInclusive<usize> = GATHERED + 1..=16;

/// Returns the number of levels of the tree between a leaf and its sources: 256 sources in all for sets with fitted weights, whose cost
/// grows with them, 128 for a few discs, and up to [`SOURCES`] for larger sets.
fn levels(lights: usize, soft: bool) -> u8 {
    let most = match lights {
        _ if soft && HALVED.contains(&lights) => SOURCES / 8,
        ..=super::FITTED => FITTED_SOURCES,
        _ => SOURCES,
    };
    (most / lights.max(1)).checked_ilog2().unwrap_or(0) as u8
}

/// A descendant in the tree of a leaf.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Index of the leaf from which the piece descends.
    pub(super) leaf: usize,
    pub(super) quad: Quad,
}

/// Returns the pieces of the leaves of `lights` lights, which are fitted as discs if they are `soft`.
pub(super) fn pieces<'a>(
    nodes: &'a Nodes<'a>,
    leaves: &'a [Leaf],
    lights: usize,
    soft: bool,
) -> impl Iterator<Item = Piece> {
    let down = levels(lights, soft);
    leaves.iter().enumerate().take(lights).flat_map(move |(owner, leaf)| {
        let down = down.min(nodes.last() - leaf.level);
        let under = leaf.index << down..(leaf.index + 1) << down;
        under.map(move |index| Piece { leaf: owner, quad: nodes.quad(leaf.level + down, index) })
    })
}

/// A piece of a light's region, approximated by a disc.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Source {
    /// Unit vector to the energy centroid of the piece.
    pub(super) at: Vec3,
    /// Radius of the uniform disc with the mean resultant length of the piece, radians.
    pub(super) radius: f32,
    /// Luminance energy of the source.
    pub(super) y: f32,
    /// Index of the light that represents the source.
    pub(super) owner: u16,
}

/// The sources that approximate the map of one frame.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    all: heapless::Vec<Source, SOURCES>,
}

impl Sources {
    pub(super) const fn new() -> Self {
        Self { all: heapless::Vec::new() }
    }

    pub(super) fn as_slice(&self) -> &[Source] {
        &self.all
    }

    /// Replaces the sources by the sources of `lights`, whose regions are `leaves` or, for few lights, gathered; empty for more than [`SOURCES`]
    /// lights. The fit of `soft` lights does not use the owners, which are the leaves' indices then.
    pub(super) fn fill(&mut self, nodes: &Nodes<'_>, leaves: &[Leaf], lights: &[Light], soft: bool) {
        self.all.clear();
        if lights.len() > SOURCES {
            return;
        }
        for Piece { leaf, quad } in pieces(nodes, leaves, lights.len(), soft) {
            let owner = if lights.len() <= GATHERED && !soft { nearest(lights, &quad) } else { leaf };
            if let Some(at) = root::unit(quad.mean_direction()) {
                let radius = disc(quad.variance());
                // There are at most `SOURCES` pieces; further ones would be ignored.
                let _ = self.all.push(Source { at, radius, y: quad.y(), owner: owner as u16 });
            }
        }
    }
}

/// Returns the radius in radians of the uniform disc whose angular variance, radius^2 / 4, is `variance`.
fn disc(variance: f32) -> f32 {
    2.0 * root::root(variance.max(1e-12))
}

/// Returns the index of the light whose direction is nearest to the quad's centroid.
pub(super) fn nearest(lights: &[Light], quad: &Quad) -> usize {
    let moment = quad.first_moment();
    let mut best = (f32::NEG_INFINITY, 0);
    for (i, light) in lights.iter().enumerate() {
        let near = light.direction.dot(moment);
        if near > best.0 {
            best = (near, i);
        }
    }
    best.1
}
