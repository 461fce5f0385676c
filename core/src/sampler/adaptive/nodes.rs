//! The nodes of the binary tree: HEALPix quads and, between two orders, halves of quads; above the base faces, groups of faces.
//!
//! Level 0 is the root. On a sphere levels 0 to 3 group the sixteen slots of the twelve faces (four slots are empty), on a hemisphere
//! levels 0 to 2 group its eight faces; below, every second level is an order of the pyramid. Node (level, index) has the children (level +
//! 1, 2 index) and (level + 1, 2 index + 1).

use super::activity::Activity;
use super::ambient::Ambient;
use crate::healpix::Domain;
use crate::pyramid::{PyramidView, Quad};

/// Base face of each slot of the tree's upper levels: each northern face is paired with the equatorial face below it, so that pairs are
/// compact.
const SLOTS: [u32; 16] = [0, 4, 1, 5, 2, 6, 3, 7, 8, EMPTY, 9, EMPTY, 10, EMPTY, 11, EMPTY];

/// Mark of a slot without a face.
const EMPTY: u32 = u32::MAX;

/// Returns the level of the tree whose nodes are the base faces.
pub(super) const fn top(domain: Domain) -> u8 {
    match domain {
        Domain::Sphere => 4,
        Domain::Hemisphere => 3,
    }
}

/// A node of the tree that may be split.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leaf {
    pub(super) importance: f32,
    pub(super) level: u8,
    pub(super) index: u32,
}

/// The light that directional lights represent: that of a map, or the excess of a map over its ambient light.
#[derive(Clone, Copy)]
pub(super) struct Nodes<'a> {
    map: PyramidView<'a>,
    ambient: Option<&'a Ambient>,
    top: u8,
}

impl<'a> Nodes<'a> {
    pub(super) fn new(map: &PyramidView<'a>, ambient: Option<&'a Ambient>) -> Self {
        Self { map: *map, ambient, top: top(map.domain()) }
    }

    /// Returns the level of the tree whose nodes are the texels.
    pub(super) fn last(&self) -> u8 {
        self.top + 2 * self.map.order().get()
    }

    /// Returns energy and first moment over quad `ipix` of `order`.
    pub(super) fn sum(&self, order: u8, ipix: u32) -> Quad {
        match self.ambient {
            None => self.map.quad(order, ipix),
            Some(ambient) => ambient.excess(&self.map, order, ipix),
        }
    }

    /// Returns energy and first moment over the node `index` of `level`.
    pub(super) fn quad(&self, level: u8, index: u32) -> Quad {
        if level < self.top {
            let under = self.top - level;
            return (index << under..(index + 1) << under).fold(Quad::default(), |mut sum, slot| {
                sum.add(&self.quad(self.top, slot));
                sum
            });
        }
        let below = level - self.top;
        if below % 2 == 1 {
            let mut sum = self.quad(level + 1, 2 * index);
            sum.add(&self.quad(level + 1, 2 * index + 1));
            return sum;
        }
        let face = SLOTS[(index >> below) as usize % SLOTS.len()];
        if face == EMPTY {
            return Quad::default();
        }
        self.sum(below / 2, (face << below) | (index & ((1 << below) - 1)))
    }

    /// Returns the factor by which moving light raises the importance of a node.
    pub(super) fn activity(&self, activity: &Activity, level: u8, index: u32) -> f32 {
        let Some(below) = level.checked_sub(self.top) else {
            let under = self.top - level;
            let slots = index << under..(index + 1) << under;
            return slots.map(|slot| self.activity(activity, self.top, slot)).fold(1.0, f32::max);
        };
        // A node that is half of a quad has the factor of the quad.
        let (below, index) = (below & !1, index >> (below & 1));
        match SLOTS[(index >> below) as usize % SLOTS.len()] {
            EMPTY => 1.0,
            face => activity.factor(below / 2, (face << below) | (index & ((1 << below) - 1))),
        }
    }
}
