//! The map as a pyramid: energy and first moment of every NESTED HEALPix quad of every order.
//!
//! The four children of a quad are adjacent in memory, so each order is computed in one linear pass over the next finer order.
//!
//! ```
//! use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
//! use hemilux_core::{Domain, Order, healpix};
//!
//! let order = Order::try_new(3)?;
//! let mut memory = [Quad::default(); pyramid_len(Domain::Hemisphere, Order::saturating(3))];
//! let mut map = Pyramid::try_new(&mut memory, Domain::Hemisphere, order)?;
//! let towards = healpix::centre(3, 100).as_vec3();
//! map.texels_mut()[100] = Quad::from_light([2.0, 1.0, 0.5], towards);
//! map.build();
//! assert_eq!(map.view().total().rgb(), [2.0, 1.0, 0.5]);
//! assert_eq!(map.view().quad(2, 25).y(), map.view().quad(3, 100).y());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Example of a pyramid from a latitude-longitude map: the energy of each texel is added to the quad at its centre.
//!
//! ```
//! use hemilux_core::polar::Grid;
//! use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
//! use hemilux_core::{Domain, Order, healpix};
//!
//! let (grid, order) = (Grid { width: 64, height: 32, domain: Domain::Sphere }, Order::try_new(2)?);
//! let quads = vec![Quad::default(); pyramid_len(grid.domain, order)];
//! let mut pyramid = Pyramid::try_new(quads, grid.domain, order)?;
//! for texel in 0..grid.len() {
//!     let towards = grid.centre(texel);
//!     // A uniform radiance of 1.
//!     let energy = [grid.solid_angle(texel / grid.width) as f32; 3];
//!     let quad = &mut pyramid.texels_mut()[healpix::ipix(order.get(), towards) as usize];
//!     quad.add(&Quad::from_light(energy, towards.as_vec3()));
//! }
//! pyramid.build();
//! let total = pyramid.view().total().y();
//! assert!((total / (4.0 * core::f32::consts::PI) - 1.0).abs() < 1e-4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{self, luminance};
use crate::healpix::{self, Domain, FaceCell, Order};
use crate::lanes::{Lanes, Pick};
use crate::pixel_table::Texel;
pub use crate::quad::Quad;

/// Returns the number of quads of all orders from 0 to `order`.
#[must_use]
pub const fn pyramid_len(domain: Domain, order: Order) -> usize {
    first(domain, order.get() + 1)
}

/// Returns the index in the pyramid of the first quad of `order`: faces (4^order - 1) / 3.
pub(crate) const fn first(domain: Domain, order: u8) -> usize {
    domain.faces() * (((1 << (2 * order)) - 1) / 3)
}

/// A HEALPix map and the sums over its coarser orders, in a lent buffer.
#[derive(Clone, Debug)]
pub struct Pyramid<Q> {
    quads: Q,
    domain: Domain,
    order: u8,
}

/// A borrowed pyramid: the input of samplers.
#[derive(Clone, Copy, Debug)]
pub struct PyramidView<'a> {
    quads: &'a [Quad],
    domain: Domain,
    order: u8,
}

impl<Q: Buffer<Quad>> Pyramid<Q> {
    /// Creates a dark map in `quads`, which needs [`pyramid_len`] elements.
    ///
    /// # Errors
    /// [`TooSmall`] if `quads` has too few elements.
    pub fn try_new(mut quads: Q, domain: Domain, order: Order) -> Result<Self, TooSmall> {
        buffer::check(&quads, pyramid_len(domain, order))?;
        quads.as_mut().fill(Quad::default());
        Ok(Self { quads, domain, order: order.get() })
    }

    /// Creates a pyramid over quads that are already filled.
    pub(crate) fn over(quads: Q, domain: Domain, order: Order) -> Self {
        Self { quads, domain, order: order.get() }
    }

    /// Returns the quads of the finest order of the map.
    #[must_use]
    pub fn texels(&self) -> &[Quad] {
        self.view().quads_of(self.order)
    }

    /// Returns the quads of the finest order of the map for writing. Call [`Pyramid::build`] after changing them.
    pub fn texels_mut(&mut self) -> &mut [Quad] {
        let at = first(self.domain, self.order)..first(self.domain, self.order + 1);
        self.quads.as_mut().get_mut(at).unwrap_or_default()
    }

    /// Clears and returns the quads of order `order`, or of the finest order if that is less. The front end adds sums per lane to their
    /// `energy` for [`Pyramid::finish`].
    #[doc(hidden)]
    pub fn accumulators(&mut self, order: u8) -> &mut [Quad] {
        let quads = self.sums_mut(order);
        quads.fill(Quad::default());
        quads
    }

    /// Returns the quads of order `order`, or of the finest order if that is less; [`Pyramid::finish`] converts their sums to energy.
    pub(crate) fn sums_mut(&mut self, order: u8) -> &mut [Quad] {
        let order = order.min(self.order);
        let at = first(self.domain, order)..first(self.domain, order + 1);
        self.quads.as_mut().get_mut(at).unwrap_or_default()
    }

    /// Converts the sums in the [accumulators](Pyramid::accumulators) of `order` to energy and computes the orders above the texels.
    ///
    /// If the texels are finer than `order`, the sum of an accumulator is divided among its descendants in proportion to their solid angle
    /// inside the domain. Sums that sensor noise made negative count as 0.
    #[doc(hidden)]
    pub fn finish(&mut self, order: u8, geometry: &[Texel], lanes: &Lanes) {
        let texels = first(self.domain, self.order);
        if order < self.order
            && let Some((coarse, texels)) = self.quads.as_mut().split_at_mut_checked(texels)
        {
            let sums = coarse.get_mut(first(self.domain, order)..).unwrap_or_default();
            if let Some(tally) = &lanes.tally {
                sums.iter_mut().for_each(|quad| quad.energy = tally.settled(quad));
            }
            share_out(self.domain, OrderQuads { order, quads: sums }, self.order, texels);
        }
        light_up(self.quads.as_mut().get_mut(texels..).unwrap_or_default(), geometry, lanes);
        if order < self.order {
            self.build();
        } else {
            sum_up(self.quads.as_mut(), self.domain, self.order);
        }
    }

    /// Computes the quads of all orders below that of the map from texels that are valid: finite energies that are not
    /// negative, and finite first moments.
    pub(crate) fn sum_up(&mut self) {
        sum_up(self.quads.as_mut(), self.domain, self.order);
    }

    /// Computes the quads of all orders below that of the map from the texels.
    ///
    /// Texels outside of the domain, and texels with negative or non-finite numbers, are set to 0 first: samplers rely on valid quads.
    pub fn build(&mut self) {
        self.clear_below_horizon();
        self.texels_mut().iter_mut().filter(|q| !q.is_sound()).for_each(|q| *q = Quad::default());
        sum_up(self.quads.as_mut(), self.domain, self.order);
    }

    /// Clears the texels of a hemisphere map that lie below the horizon: at every order, the lowest child of each quad on the horizon.
    fn clear_below_horizon(&mut self) {
        if self.domain == Domain::Sphere {
            return;
        }
        for order in 0..self.order {
            let shift = 2 * (self.order - order - 1);
            let last = (1u32 << order) - 1;
            for at in 0..4 << order {
                let x = at & last;
                let cell = FaceCell { face: 4 + (at >> order), x, y: last - x };
                let child = 4 * healpix::join(order, cell) as usize;
                let below = self.texels_mut().get_mut(child << shift..(child + 1) << shift);
                below.unwrap_or_default().fill(Quad::default());
            }
        }
    }

    /// Borrows the pyramid for samplers.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        PyramidView { quads: self.quads.as_ref(), domain: self.domain, order: self.order }
    }
}

/// Computes each order above the texels from the next finer order.
#[inline(never)]
fn sum_up(quads: &mut [Quad], domain: Domain, order: u8) {
    for order in (0..order).rev() {
        let Some((coarse, fine)) = quads.split_at_mut_checked(first(domain, order + 1)) else { return };
        let parents = coarse.get_mut(first(domain, order)..).unwrap_or_default();
        let (children, _) = fine.as_chunks::<4>();
        for (parent, four) in parents.iter_mut().zip(children) {
            *parent = sum(four);
        }
    }
}

/// The quads of one order of a map.
#[derive(Clone, Copy)]
struct OrderQuads<'a> {
    order: u8,
    quads: &'a [Quad],
}

/// Divides the sum of each coarse quad among its texels by solid angle inside the domain.
fn share_out(domain: Domain, coarse: OrderQuads<'_>, fine: u8, texels: &mut [Quad]) {
    let OrderQuads { order, quads: sums } = coarse;
    let shift = 2 * (fine - order);
    let equal = 1.0 / (1u32 << shift) as f32;
    for (sum, (ancestor, below)) in sums.iter().zip(texels.chunks_exact_mut(1 << shift).enumerate()) {
        // Quads that lie wholly inside of the domain are divided equally among their texels.
        let whole = domain.share(order, ancestor as u32);
        for (i, quad) in below.iter_mut().enumerate() {
            let share = if whole == 0.5 {
                let own = domain.share(fine, (ancestor << shift | i) as u32);
                (own / whole) as f32 * equal
            } else {
                equal
            };
            *quad = Quad { energy: sum.energy.map(|v| v * share), moment: [0.0; 4] };
        }
    }
}

/// Converts the sums in the texels to energy and first moment.
#[inline(never)]
fn light_up(quads: &mut [Quad], geometry: &[Texel], lanes: &Lanes) {
    let all = quads.iter_mut().zip(geometry);
    let swapped = |e: [f32; 4]| lanes.scaled([e[2], e[1], e[0]]);
    let plain = |e: [f32; 4]| lanes.scaled([e[0], e[1], e[2]]);
    match (lanes.pick, &lanes.tally) {
        (Pick::Swapped, Some(tally)) => all.for_each(|(q, t)| light(q, tally.settled(q), t, &swapped)),
        (_, Some(tally)) => all.for_each(|(q, t)| light(q, tally.settled(q), t, &plain)),
        (Pick::Plain, None) => all.for_each(|(q, t)| light(q, q.energy, t, &plain)),
        (Pick::Swapped, None) => all.for_each(|(q, t)| light(q, q.energy, t, &swapped)),
        (Pick::Grey, None) => all.for_each(|(q, t)| light(q, q.energy, t, &|e| lanes.scaled([e[0]; 3]))),
        (Pick::Cell { .. }, None) => all.for_each(|(q, t)| light(q, q.energy, t, &|e| lanes.rgb(e))),
    }
}

/// Converts the sum `lanes` to energy and first moment towards the centroid of its texel.
#[inline]
fn light(quad: &mut Quad, lanes: [f32; 4], texel: &Texel, rgb: &impl Fn([f32; 4]) -> [f32; 3]) {
    // Texels below the horizon and outside of the field of view are 0.
    if lanes.iter().fold(0, |bits, e| bits | e.to_bits()) == 0 {
        *quad = Quad::default();
        return;
    }
    let [r, g, b] = rgb(lanes.map(positive));
    let y = luminance([r, g, b]);
    let [x, across, up] = texel.direction.map(|d| d * y);
    *quad = Quad { energy: [r, g, b, y], moment: [x, across, up, 0.0] };
}

/// Returns `v`, or 0 if it is negative, without a comparison: on small cores a comparison would cost more than the sum.
#[inline]
pub(crate) fn positive(v: f32) -> f32 {
    f32::from_bits((v.to_bits() as i32).max(0) as u32)
}

/// Returns the sum of the energies and first moments of four quads.
fn sum(four: &[Quad; 4]) -> Quad {
    let [a, b, c, d] = four;
    Quad {
        energy: core::array::from_fn(|i| (a.energy[i] + b.energy[i]) + (c.energy[i] + d.energy[i])),
        moment: core::array::from_fn(|i| (a.moment[i] + b.moment[i]) + (c.moment[i] + d.moment[i])),
    }
}

impl<'a> PyramidView<'a> {
    /// Creates a view of quads that are already filled.
    pub(crate) fn over(quads: &'a [Quad], domain: Domain, order: Order) -> Self {
        Self { quads, domain, order: order.get() }
    }

    /// Returns the part of the sphere that the map covers.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Returns the HEALPix order of the texels.
    #[must_use]
    pub fn order(&self) -> Order {
        Order::saturating(self.order)
    }

    /// Returns all quads of `order`; those of the finest order if `order` is above it.
    #[must_use]
    pub fn quads_of(&self, order: u8) -> &'a [Quad] {
        let order = order.min(self.order);
        self.quads.get(first(self.domain, order)..first(self.domain, order + 1)).unwrap_or_default()
    }

    /// Returns quad `ipix` of `order`; a dark quad if the index is outside of the map.
    #[must_use]
    pub fn quad(&self, order: u8, ipix: u32) -> Quad {
        self.quads_of(order).get(ipix as usize).copied().unwrap_or_default()
    }

    /// Returns energy and first moment of the whole map.
    #[must_use]
    pub fn total(&self) -> Quad {
        let mut total = Quad::default();
        self.quads_of(0).iter().for_each(|q| total.add(q));
        total
    }

    /// Returns the horizontal irradiance, red, green and blue: radiance times cos(theta) times solid angle, summed over the hemisphere above the
    /// horizon; the quantity that a flat cosine-corrected meter measures.
    ///
    /// The luminance is exact. For each channel, cos(theta) is the luminance-weighted mean over a quad of order 4 (3.7 degrees).
    #[must_use]
    pub fn horizontal_irradiance(&self) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for quad in self.quads_of(4).iter().filter(|q| q.moment[2] > 0.0 && q.y() > 0.0) {
            let height = (quad.moment[2] / quad.y()).min(1.0);
            color::add(&mut sum, quad.rgb().map(|v| v * height));
        }
        sum
    }

    /// Returns the mean radiance of a quad: energy divided by its solid angle inside the domain.
    #[must_use]
    pub fn radiance(&self, order: u8, ipix: u32) -> [f32; 3] {
        let omega = healpix::solid_angle(order) * self.domain.share(order, ipix);
        if omega > 0.0 { self.quad(order, ipix).rgb().map(|v| v / omega as f32) } else { [0.0; 3] }
    }
}
