//! Sources: a coarse approximation of the map by discs, used to fit weights and to estimate errors.
//!
//! Each source is a part of a leaf, so that a bright small region and a dim large region get equal numbers of sources.

use super::nodes::{Leaf, Nodes};
use super::{GATHERED_DISCS, GATHERED_POINTS};
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
pub(super) const HALVED: RangeInclusive<usize> = GATHERED_POINTS + 1..=GATHERED_DISCS;

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

/// Number of levels between the leaves of a set and their pieces.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    levels: u8,
    /// Level of the texels, below which there are no pieces.
    last: u8,
}

impl Depth {
    /// Returns the depth of the pieces of `lights` lights, which are fitted as discs if they are `soft`.
    pub(super) fn of(nodes: &Nodes<'_>, lights: usize, soft: bool) -> Self {
        Self { levels: levels(lights, soft), last: nodes.last() }
    }

    /// Returns the number of levels between `leaf` and its pieces; the number of its pieces is 2 to this power.
    pub(super) fn below(&self, leaf: &Leaf) -> u8 {
        self.levels.min(self.last.saturating_sub(leaf.level))
    }
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
    let depth = Depth::of(nodes, lights, soft);
    leaves.iter().enumerate().take(lights).flat_map(move |(owner, leaf)| {
        let down = depth.below(leaf);
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

    /// Replaces the sources by the `pieces` of `lights`; empty for more than [`SOURCES`] lights. If `nearest`, the owner of a source is the
    /// nearest light instead of that of its leaf.
    pub(super) fn fill(&mut self, pieces: impl Iterator<Item = Piece>, lights: &[Light], nearest: bool) {
        self.all.clear();
        if lights.len() > SOURCES {
            return;
        }
        for Piece { leaf, quad } in pieces {
            let owner = if nearest { nearest_light(lights, &quad) } else { leaf };
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
fn nearest_light(lights: &[Light], quad: &Quad) -> usize {
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
