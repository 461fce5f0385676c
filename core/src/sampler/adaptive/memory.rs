//! The buffers that the caller lends to [`super::Adaptive`].

use super::{activity, ambient, cut, filter, gather, nodes, receivers, source, tree, weights};
use crate::healpix::{Domain, Order};
use crate::light::Light;
use crate::sizes::BufferSize;

/// Intermediate results of a fixed size, about 180 KB for any number of lights: the sources that approximate the map, the matrix of the
/// weights, the receivers of the estimate, the ambient light and the state of the last frames.
#[derive(Clone, Debug)]
pub struct Workspace {
    pub(super) ambient: ambient::Ambient,
    pub(super) gather: gather::Gather,
    pub(super) sources: source::Sources,
    pub(super) fit: weights::Fit,
    pub(super) receivers: receivers::Receivers,
    pub(super) cut: cut::Cut,
    pub(super) activity: activity::Activity,
}

impl Workspace {
    /// Creates an empty workspace, also as the initial value of a `static`.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            ambient: ambient::Ambient::new(),
            gather: gather::Gather::new(),
            sources: source::Sources::new(),
            fit: weights::Fit::new(),
            receivers: receivers::Receivers::new(),
            cut: cut::Cut::new(),
            activity: activity::Activity::new(),
        }
    }

    /// Prepares the workspace for maps of `domain` up to `order`.
    pub(super) fn prepare(&mut self, domain: Domain, order: Order) {
        self.ambient.prepare(domain, order.get());
        self.gather.reset();
        self.receivers.prepare();
        self.cut = cut::Cut::new();
        self.activity.reset();
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

/// The buffers of [`super::Adaptive`]; their lengths are in [`Sizes`].
#[derive(Clone, Debug)]
pub struct Memory<B, H, L, T, W> {
    /// Bit sets of the interior nodes of the tree, of this frame and the last.
    pub interior: [B; 2],
    /// Leaves of the tree, in a heap.
    pub leaves: H,
    /// Lights of this frame and the last.
    pub lights: [L; 2],
    /// Filter states of the lights, of this frame and the last.
    pub tracks: [T; 2],
    /// One [`Workspace`], by value, reference or box.
    pub workspace: W,
}

/// Lengths of the buffers in [`Memory`]; where [`Memory`] has two buffers, the length of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Number of bytes of each bit set in [`Memory::interior`].
    pub interior: usize,
    /// Number of elements of [`Memory::leaves`], and of each buffer in [`Memory::lights`] and [`Memory::tracks`].
    pub lights: usize,
}

impl Sizes {
    /// Returns the lengths of the buffers for maps of `domain` up to `order` and for up to `lights` lights.
    #[must_use]
    pub const fn new(domain: Domain, order: Order, lights: usize) -> Self {
        Self { interior: tree::bits_len(domain, order), lights }
    }

    /// Returns the names and sizes in bytes of all buffers of the sampler.
    #[must_use]
    pub const fn buffers(&self) -> [BufferSize; 5] {
        [
            BufferSize::of::<u8>("sampler: bits", self.interior.saturating_mul(2)),
            BufferSize::of::<nodes::Leaf>("sampler: heap", self.lights),
            BufferSize::of::<Light>("sampler: lights", self.lights.saturating_mul(2)),
            BufferSize::of::<filter::LightFilter>("sampler: tracks", self.lights.saturating_mul(2)),
            BufferSize::of::<Workspace>("sampler: work", 1),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::Workspace;

    /// The documentation of [`Workspace`] states its size.
    #[test]
    fn the_workspace_has_the_stated_size() {
        let kilobytes = size_of::<Workspace>() as f64 / 1000.0;
        assert!((kilobytes - 180.0).abs() < 5.0, "{kilobytes} KB");
    }
}
