//! The tree: nodes are split best-first, and each lit leaf becomes a light.
//!
//! The id of a light is the index of the first texel of its leaf, counted from 1: the left child of a split keeps the parent's id, the
//! right one gets a new id.

use super::activity::Activity;
use super::discs;
use super::nodes::{self, Leaf, Nodes};
use crate::buffer::Buffer;
use crate::healpix::{Domain, Order};
use crate::light::Light;
use crate::pyramid::{PyramidView, Quad};
use crate::root::root;
use crate::sampler::heap;
use glam::Vec3;

/// Relative difference of importance above which another node replaces a split of the last frame.
///
/// At 2 % texel noise the importance of a quad varies by a few per cent; a smaller hysteresis lets noise change the tree. A larger one
/// keeps lights in place, so that a lamp that is switched on takes fewer lights from the rest of the scene, and a moving lamp gets fewer.
/// Of 0, 0.3, 1, 1.3, 1.6 and 3, 1 is the largest that does not increase the error of moving lamps.
const HYSTERESIS: f32 = 1.0;

/// Lower limit of the angular variance 1 - |m| in the importance of a node, with m the mean direction of its light: narrower light counts as
/// one direction.
const LEAST_VARIANCE: f32 = 1e-7;

/// Returns the length in bytes of the bit set that marks the interior nodes of the tree over maps of `order`.
#[must_use]
pub const fn bits_len(domain: Domain, order: Order) -> usize {
    (1usize << (nodes::top(domain) + 2 * order.get())).div_ceil(8)
}

/// The interior nodes of the tree in this frame and the last, and the heap of leaves.
#[derive(Clone, Debug)]
pub(super) struct Tree<B, H> {
    interior: [B; 2],
    heap: H,
}

impl<B: Buffer<u8>, H: Buffer<Leaf>> Tree<B, H> {
    pub(super) fn new(interior: [B; 2], heap: H) -> Self {
        Self { interior, heap }
    }

    pub(super) fn capacity(&self) -> usize {
        self.heap.as_ref().len()
    }

    pub(super) fn fits(&self, map: &PyramidView<'_>) -> bool {
        self.interior.iter().all(|b| b.as_ref().len() >= bits_len(map.domain(), map.order()))
    }

    pub(super) fn reset(&mut self) {
        self.interior.iter_mut().for_each(|bits| bits.as_mut().fill(0));
    }

    /// Begins a frame: the interior nodes become those of the last frame.
    pub(super) fn advance(&mut self) {
        self.interior.swap(0, 1);
    }

    /// Splits the most important leaves until the number of lit leaves reaches `growth`. A second call in the same frame continues the
    /// growth.
    pub(super) fn grow(&mut self, nodes: &Nodes<'_>, activity: &Activity, growth: &Growth) {
        self.interior[0].as_mut().fill(0);
        let mut len = 0;
        let mut lit = 1;
        let inputs = ImportanceInputs { nodes, activity, soft: growth.soft };
        self.push(
            &mut len,
            &inputs,
            &Node { at: NodeIndex { level: 0, index: 0 }, quad: nodes.quad(0, 0) },
            f32::INFINITY,
        );
        while lit < growth.limit {
            let Some(leaf) = heap::pop(&mut self.heap.as_mut()[..len], before) else { break };
            len -= 1;
            set(self.interior[0].as_mut(), leaf.level, leaf.index);
            let level = leaf.level + 1;
            let children = [2 * leaf.index, 2 * leaf.index + 1]
                .map(|index| Node { at: NodeIndex { level, index }, quad: nodes.quad(level, index) });
            lit += usize::from(children.iter().all(|child| child.quad.y() > 0.0));
            for child in &children {
                self.push(&mut len, &inputs, child, leaf.importance);
            }
        }
    }

    /// Adds a node to the heap unless it is dark or a texel. The importance of a node is limited to that of its parent, so that the tree of
    /// the most important nodes is connected.
    fn push(&mut self, len: &mut usize, inputs: &ImportanceInputs<'_>, node: &Node, most: f32) {
        let Node { at: NodeIndex { level, index }, quad } = node;
        let (level, index) = (*level, *index);
        let leaves = self.heap.as_mut();
        if quad.y() <= 0.0 || level >= inputs.nodes.last() || *len >= leaves.len() {
            return;
        }
        let kept = if bit(self.interior[1].as_ref(), level, index) { 1.0 + HYSTERESIS } else { 1.0 };
        let kept = kept * inputs.nodes.activity(inputs.activity, level, index);
        let importance = (inputs.importance(level, index, quad) * kept).min(most);
        leaves[*len] = Leaf { importance, level, index };
        *len += 1;
        heap::sift_up(&mut leaves[..*len], before);
    }

    /// Writes the lights of the lit leaves, by ascending id, and returns their number; their leaves are then in the heap's memory.
    pub(super) fn emit(&mut self, nodes: &Nodes<'_>, lights: &mut [Light]) -> usize {
        let mut out = LightWriter {
            nodes: *nodes,
            interior: self.interior[0].as_ref(),
            leaves: self.heap.as_mut(),
            lights,
            count: 0,
        };
        out.visit(NodeIndex { level: 0, index: 0 }, 1, None);
        out.count
    }

    /// Returns the leaves of the lights that [`Tree::emit`] wrote last.
    pub(super) fn leaves(&self) -> &[Leaf] {
        self.heap.as_ref()
    }
}

/// Limits of the growth of the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Growth {
    /// Largest number of lit leaves of the tree.
    pub(super) limit: usize,
    /// Whether lights are fitted as discs.
    pub(super) soft: bool,
}

/// The position of a node: its level in the tree, and its index in the level.
#[derive(Clone, Copy, Debug)]
struct NodeIndex {
    level: u8,
    index: u32,
}

/// A node of the tree with the light from its directions.
#[derive(Clone, Copy, Debug)]
struct Node {
    at: NodeIndex,
    quad: Quad,
}

/// Inputs from which the importance of a node is computed.
struct ImportanceInputs<'a> {
    nodes: &'a Nodes<'a>,
    activity: &'a Activity,
    /// Whether lights are fitted as discs.
    soft: bool,
}

impl ImportanceInputs<'_> {
    fn importance(&self, level: u8, index: u32, quad: &Quad) -> f32 {
        if self.soft { discs::importance(self.nodes, level, index, quad) } else { importance(quad) }
    }
}

struct LightWriter<'a> {
    nodes: Nodes<'a>,
    interior: &'a [u8],
    leaves: &'a mut [Leaf],
    lights: &'a mut [Light],
    count: usize,
}

impl LightWriter<'_> {
    /// Visits the tree below a node whose first lit leaf gets `id`; the recursion is at most as deep as the tree.
    fn visit(&mut self, NodeIndex { level, index }: NodeIndex, id: u32, parent: Option<u32>) {
        let quad = self.nodes.quad(level, index);
        if quad.y() <= 0.0 || self.count >= self.lights.len().min(self.leaves.len()) {
            return;
        }
        if level >= self.nodes.last() || !bit(self.interior, level, index) {
            self.leaves[self.count] = Leaf { importance: 0.0, level, index };
            let light = Light::at_centroid(id, &quad, || Vec3::Z);
            self.lights[self.count] = Light { parent, ..light };
            self.count += 1;
            return;
        }
        let (left, right) = (2 * index, 2 * index + 1);
        let child = |index| NodeIndex { level: level + 1, index };
        let left_lit = self.nodes.quad(level + 1, left).y() > 0.0;
        self.visit(child(left), id, parent);
        if left_lit {
            let start = (right << (self.nodes.last() - level - 1)) + 1;
            self.visit(child(right), start, Some(id));
        } else {
            self.visit(child(right), id, parent);
        }
    }
}

/// Returns the importance of a node, Y (1 - |m|)^(3/8): nearly the square root of its share of the squared shadowed error.
///
/// An occluder's edge that crosses a light's region causes an error of about Y, and crosses it with a probability proportional to the
/// region's width, (1 - |m|)^(1/2). This gives Y^2 (1 - |m|)^(1/2) in the mean square, hence an exponent of 1/4. Open receivers have an
/// error of Y (1 - |m|). Of 1/4, 3/8 and 1/2, 3/8 is the best compromise over the maps and scenarios of `host-sim`.
fn importance(quad: &Quad) -> f32 {
    let fourth = root(root(quad.variance().max(LEAST_VARIANCE)));
    quad.y() * fourth * root(fourth)
}

/// Returns whether `a` is split before `b`; ties are resolved by level and index, so that the order never depends on earlier frames.
fn before(a: &Leaf, b: &Leaf) -> bool {
    (a.importance, b.level, b.index) > (b.importance, a.level, a.index)
}

fn bit(bits: &[u8], level: u8, index: u32) -> bool {
    let at = (1usize << level) + index as usize;
    bits.get(at / 8).is_some_and(|byte| byte >> (at % 8) & 1 == 1)
}

fn set(bits: &mut [u8], level: u8, index: u32) {
    let at = (1usize << level) + index as usize;
    if let Some(byte) = bits.get_mut(at / 8) {
        *byte |= 1 << (at % 8);
    }
}
