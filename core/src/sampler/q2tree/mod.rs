//! `q2tree` and `q2tree-jitter`: the spherical Q2-tree of \[Wan2005\] over NESTED HEALPix quads.
//!
//! The tree starts from the base quads and repeatedly splits the leaf of greatest importance E^a Omega^b until it has the requested number
//! of leaves; E is the energy of the quad and Omega its solid angle. With exponents of at least 0 a child is never more important than its
//! parent, so a best-first search from the roots yields the same tree as any sequence of merges and splits. The published frame-to-frame
//! threshold tau multiplies the importance of quads that were interior nodes in the last frame by 1 + tau: another split replaces a split of
//! the last frame only if its importance exceeds that of the replaced split by the factor 1 + tau.
//!
//! A split replaces one lit leaf by its lit children: four, or three for a leaf on the horizon of a hemisphere, whose lowest child is
//! below the horizon. Dark leaves give no light. A sphere that is lit everywhere therefore has 12 + 3 k lights and a hemisphere 8 + 3 a +
//! 2 b. If the split of the most important leaf would exceed the request, the next leaf whose split fits is split: on a hemisphere the
//! number of lights is the request or one less.
//!
//! A request for fewer lights than base quads (12 on a sphere, 8 on a hemisphere) gives no lights.
//!
//! The tree is stored as one bit per quad, set for interior nodes, and is traversed in NESTED order.
//!
//! ```
//! use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
//! use hemilux_core::sampler::q2tree::{Leaf, Parameters, Past, Q2Tree, Sizes};
//! use hemilux_core::{Domain, Light, Map, MapShape, Order, Request, Sampler, healpix, polar::LatLongView};
//!
//! let shape = MapShape { domain: Domain::Sphere, order: Order::try_new(3)? };
//! let sizes = Sizes::new(shape.domain, shape.order, 24);
//! let mut tree = Q2Tree::try_new(
//!     Parameters::CENTROID,
//!     shape,
//!     [vec![0; sizes.interior], vec![0; sizes.interior]],
//!     vec![Leaf::default(); sizes.lights],
//!     vec![Light::default(); sizes.lights],
//!     vec![Past::default(); sizes.lights],
//! )?;
//! let quads = vec![Quad::default(); pyramid_len(shape.domain, shape.order)];
//! let mut pyramid = Pyramid::try_new(quads, shape.domain, shape.order)?;
//! for (ipix, texel) in pyramid.texels_mut().iter_mut().enumerate() {
//!     let towards = healpix::centre(3, ipix as u32).as_vec3();
//!     *texel = Quad::from_light([healpix::solid_angle(3) as f32; 3], towards);
//! }
//! pyramid.build();
//! let map = Map { pyramid: pyramid.view(), polar: LatLongView::NONE };
//! let lights = tree.update(&map, &Request::of_lights(24)).lights;
//! assert_eq!(lights.len(), 24);
//! let flux: f32 = lights.iter().map(|light| light.irradiance[1]).sum();
//! assert!((flux / (4.0 * core::f32::consts::PI) - 1.0).abs() < 1e-4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod id;

use super::{Map, Request, Sampler, SamplerKind, Timer, heap};
use crate::buffer::{self, Buffer, TooSmall};
use crate::healpix::{self, Domain, MapShape, Order};
use crate::light::{Decomposition, Light};
use crate::pyramid::{PyramidView, Quad};
use crate::sizes::BufferSize;
use core::ops::Range;
use id::{id_of, ipix_of, jitter, order_of, range};

/// Position of a light inside its quad.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Placement {
    /// The light is at the energy centroid of the quad: `q2tree`.
    Centroid,
    /// The light is at a pseudo-random point that depends on the quad alone, within `spread` widths around its centre: `q2tree-jitter`.
    Jitter {
        /// Width of the range of points, as a fraction of the quad's width, 0..=1.
        spread: f32,
    },
}

/// Parameters by which the Q2-tree selects the quads that it splits and places its lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Exponent a of the energy in the importance of a quad, at least 0.
    pub energy_exponent: f32,
    /// Exponent b of the solid angle in the importance of a quad, at least 0.
    pub solid_angle_exponent: f32,
    /// Frame-to-frame threshold tau: relative importance by which a split must exceed a split of the last frame to replace it.
    pub threshold: f32,
    /// Position of each light inside its quad.
    pub placement: Placement,
}

impl Parameters {
    /// Exponents a = 1 and b = 1/4, threshold tau = 0, lights at energy centroids.
    pub const CENTROID: Self = Self {
        energy_exponent: 1.0,
        solid_angle_exponent: 0.25,
        threshold: 0.0,
        placement: Placement::Centroid,
    };

    /// Exponents a = 1 and b = 1/4, threshold tau = 0, lights at pseudo-random points within half the width of their quads.
    pub const JITTER: Self = Self { placement: Placement::Jitter { spread: 0.5 }, ..Self::CENTROID };
}

impl Default for Parameters {
    fn default() -> Self {
        Self::CENTROID
    }
}

/// An element of the heap: a leaf of the tree that can be split.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leaf {
    importance: f32,
    /// Id of the light of the leaf.
    id: u32,
}

impl Leaf {
    fn order(&self) -> u8 {
        order_of(self.id)
    }

    fn ipix(&self) -> u32 {
        ipix_of(self.id)
    }
}

/// Id, age and parent of a light of the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Past {
    id: u32,
    age: u32,
    /// Id of the light's parent; 0 for none.
    parent: u32,
}

impl Past {
    fn of(light: &Light) -> Self {
        Self { id: light.id, age: light.age, parent: light.parent.unwrap_or(0) }
    }
}

/// Returns the number of bytes of the bit set that marks interior quads of a map of `order`.
#[must_use]
pub const fn interior_len(domain: Domain, order: Order) -> usize {
    crate::pyramid::first(domain, order.get()).div_ceil(8)
}

/// Number of elements of each buffer of [`Q2Tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Number of bytes of each of the two bit sets.
    pub interior: usize,
    /// Number of elements of the heap, of the lights and of the past lights.
    pub lights: usize,
}

impl Sizes {
    /// Returns the buffer lengths of the sampler for maps of `domain` of at most `order` and for up to `lights` lights.
    #[must_use]
    pub const fn new(domain: Domain, order: Order, lights: usize) -> Self {
        Self { interior: interior_len(domain, order), lights }
    }

    /// Returns name and size of each buffer of the sampler.
    #[must_use]
    pub const fn buffers(&self) -> [BufferSize; 4] {
        [
            BufferSize::of::<u8>("sampler: bits", self.interior.saturating_mul(2)),
            BufferSize::of::<Leaf>("sampler: heap", self.lights),
            BufferSize::of::<Light>("sampler: lights", self.lights),
            BufferSize::of::<Past>("sampler: past", self.lights),
        ]
    }
}

/// The sampler `q2tree` or `q2tree-jitter`. The buffers are `B`: [`interior_len`] bytes, twice; `H`: one [`Leaf`] per light; `L`: one
/// [`Light`] per light; `P`: one [`Past`] per light.
#[derive(Clone, Debug)]
pub struct Q2Tree<B, H, L, P> {
    parameters: Parameters,
    /// Bit sets of the interior quads of this frame and of the last frame.
    interior: [B; 2],
    heap: H,
    lights: L,
    past: P,
    count: usize,
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, P: Buffer<Past>> Q2Tree<B, H, L, P> {
    /// Creates the sampler for maps of `shape` or of a lower order, and for as many lights as the shortest of `heap`, `lights` and `past`
    /// has elements. [`Sizes`] contains the length of each buffer.
    ///
    /// # Errors
    /// [`TooSmall`] if a bit set has too few elements.
    pub fn try_new(
        parameters: Parameters,
        shape: MapShape,
        mut interior: [B; 2],
        heap: H,
        lights: L,
        past: P,
    ) -> Result<Self, TooSmall> {
        for bits in &mut interior {
            buffer::check(bits, interior_len(shape.domain, shape.order))?;
            bits.as_mut().fill(0);
        }
        Ok(Self { parameters, interior, heap, lights, past, count: 0 })
    }

    /// Returns the largest number of lights: the length of the shortest of the buffers for lights.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.heap.as_ref().len().min(self.lights.as_ref().len()).min(self.past.as_ref().len())
    }

    /// Returns the importance of quad `ipix` of `order`, E^a Omega^b, raised by 1 + tau if the quad was an interior node in the last frame.
    fn importance(&self, map: &PyramidView<'_>, order: u8, ipix: u32) -> f32 {
        let p = self.parameters;
        let energy = map.quad(order, ipix).y();
        if energy <= 0.0 {
            return 0.0;
        }
        let omega = (healpix::solid_angle(order) * map.domain().share(order, ipix)) as f32;
        let weighted = if p.energy_exponent == 1.0 { energy } else { libm::powf(energy, p.energy_exponent) };
        let size = if p.solid_angle_exponent == 0.25 {
            libm::sqrtf(libm::sqrtf(omega))
        } else {
            libm::powf(omega, p.solid_angle_exponent)
        };
        let was_interior =
            order < map.order().get() && bit(self.interior[1].as_ref(), index(map.domain(), order, ipix));
        weighted * size * if was_interior { 1.0 + p.threshold } else { 1.0 }
    }

    /// Splits leaves best-first until no split fits into `lights`, and marks the interior quads.
    fn grow(&mut self, map: &PyramidView<'_>, lights: usize) {
        self.interior.swap(0, 1);
        self.interior[0].as_mut().fill(0);
        let is_lit = |order: u8, ipix: u32| map.quad(order, ipix).y() > 0.0;
        let roots = 0..map.domain().faces() as u32;
        let mut len = 0;
        let mut lit = roots.clone().filter(|ipix| is_lit(0, *ipix)).count();
        for ipix in roots {
            self.push(&mut len, map, 0, ipix);
        }
        while lit < lights
            && let Some(leaf) = heap::pop(self.heap.as_mut().get_mut(..len).unwrap_or_default(), before)
        {
            len -= 1;
            let (order, ipix) = (leaf.order(), leaf.ipix());
            let children = 4 * ipix..4 * ipix + 4;
            let gain = children.clone().filter(|ipix| is_lit(order + 1, *ipix)).count().saturating_sub(1);
            if lit + gain > lights {
                continue;
            }
            lit += gain;
            set(self.interior[0].as_mut(), index(map.domain(), order, ipix));
            for ipix in children {
                self.push(&mut len, map, order + 1, ipix);
            }
        }
    }

    /// Adds a leaf to the heap unless it is dark or of the finest order.
    fn push(&mut self, len: &mut usize, map: &PyramidView<'_>, order: u8, ipix: u32) {
        let importance = self.importance(map, order, ipix);
        if importance > 0.0
            && order < map.order().get()
            && let Some(leaves) = self.heap.as_mut().get_mut(..=*len)
            && let Some(last) = leaves.last_mut()
        {
            *last = Leaf { importance, id: id_of(order, ipix) };
            *len += 1;
            heap::sift_up(leaves, before);
        }
    }

    /// Copies id, age and parent of the lights of the last frame; returns the number of lights copied.
    fn remember(&mut self) -> usize {
        let lights = self.lights.as_ref().iter().take(self.count);
        self.past.as_mut().iter_mut().zip(lights).map(|(past, light)| *past = Past::of(light)).count()
    }

    /// Writes the lights of the lit leaves in NESTED order; returns the number of lights written.
    fn emit(&mut self, map: &PyramidView<'_>) -> usize {
        let lights = self.lights.as_mut();
        let interior = self.interior[0].as_ref();
        let mut count = 0;
        walk(map, interior, |order, ipix, quad| {
            if let Some(slot) = lights.get_mut(count) {
                *slot = place(self.parameters.placement, map.domain(), order, ipix, quad);
                count += 1;
            }
        });
        count
    }
}

/// Calls `f` with order, index and quad of every lit leaf, in NESTED order.
fn walk(map: &PyramidView<'_>, interior: &[u8], mut f: impl FnMut(u8, u32, &Quad)) {
    for face in 0..map.domain().faces() as u32 {
        let (mut order, mut ipix) = (0, face);
        loop {
            let is_interior = order < map.order().get() && bit(interior, index(map.domain(), order, ipix));
            if is_interior {
                order += 1;
                ipix <<= 2;
                continue;
            }
            let quad = map.quad(order, ipix);
            if quad.y() > 0.0 {
                f(order, ipix, &quad);
            }
            while order > 0 && ipix & 3 == 3 {
                order -= 1;
                ipix >>= 2;
            }
            if order == 0 {
                break;
            }
            ipix += 1;
        }
    }
}

/// Returns the light of the leaf `ipix` of `order`.
fn place(placement: Placement, domain: Domain, order: u8, ipix: u32, quad: &Quad) -> Light {
    let id = id_of(order, ipix);
    let mut light = Light::at_centroid(id, quad, || healpix::centre(order, ipix).as_vec3());
    if let Placement::Jitter { spread } = placement {
        let [x, y] = jitter(id, f64::from(spread));
        // Points of a quad on the horizon that lie below the horizon are mirrored to above it.
        let below = domain.share(order, ipix) == 0.5 && x + y < 1.0;
        let (x, y) = if below { (1.0 - y, 1.0 - x) } else { (x, y) };
        light.direction = healpix::point(order, ipix, x, y).as_vec3();
    }
    light
}

/// Returns the index of a quad in the bit sets, unique over all orders.
fn index(domain: Domain, order: u8, ipix: u32) -> usize {
    crate::pyramid::first(domain, order) + ipix as usize
}

fn bit(bits: &[u8], index: usize) -> bool {
    bits.get(index / 8).is_some_and(|byte| byte >> (index % 8) & 1 == 1)
}

fn set(bits: &mut [u8], index: usize) {
    if let Some(byte) = bits.get_mut(index / 8) {
        *byte |= 1 << (index % 8);
    }
}

/// Returns whether `a` is split before `b`: by importance, then coarse before fine, then by index, so that equal maps give equal trees.
fn before(a: &Leaf, b: &Leaf) -> bool {
    (a.importance, b.id) > (b.importance, a.id)
}

/// Copies ages and parents from the last frame. Both lists are in NESTED order, so one pass finds the predecessor of each light.
fn inherit(lights: &mut [Light], previous: &[Past]) {
    let mut old = previous.iter().peekable();
    for light in lights {
        let Range { start, end } = range(light.id);
        while old.next_if(|o| range(o.id).end <= start).is_some() {}
        let Some(o) = old.peek() else { return };
        if o.id == light.id {
            light.age = o.age.saturating_add(1);
            light.parent = Some(o.parent).filter(|id| *id != 0);
        } else if range(o.id).start <= start && end <= range(o.id).end {
            light.parent = Some(o.id);
        }
    }
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, P: Buffer<Past>> Sampler for Q2Tree<B, H, L, P> {
    fn kind(&self) -> SamplerKind {
        match self.parameters.placement {
            Placement::Centroid => SamplerKind::Q2Tree,
            Placement::Jitter { .. } => SamplerKind::Q2TreeJitter,
        }
    }

    fn update_timed(&mut self, map: &Map<'_>, request: &Request, _: &mut Timer<'_>) -> Decomposition<'_> {
        let lights = request.lights.min(self.capacity());
        let fits =
            buffer::check(&self.interior[0], interior_len(map.pyramid.domain(), map.pyramid.order())).is_ok();
        let previous = self.remember();
        self.count = 0;
        if fits && lights >= map.pyramid.domain().faces() {
            self.grow(&map.pyramid, lights);
            self.count = self.emit(&map.pyramid);
            let old = self.past.as_ref().get(..previous).unwrap_or_default();
            inherit(self.lights.as_mut().get_mut(..self.count).unwrap_or_default(), old);
        }
        Decomposition::of_lights(self.lights.as_ref().get(..self.count).unwrap_or_default())
    }

    fn reset(&mut self) {
        self.count = 0;
        self.interior.iter_mut().for_each(|bits| bits.as_mut().fill(0));
    }
}
