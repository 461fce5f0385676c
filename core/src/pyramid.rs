//! The NESTED pyramid: energy and first moment of every quad of every order.
//!
//! The four children of a quad are neighbours in memory, so each order is one linear pass over the next finer one.
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

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{self, luminance};
use crate::healpix::{self, Domain, FaceCell, Order};
use crate::lanes::{Lanes, Pick};
use crate::pixel_table::Texel;
pub use crate::quad::Quad;

/// Quads of all orders up to `order`.
#[must_use]
pub const fn pyramid_len(domain: Domain, order: Order) -> usize {
    first(domain, order.get() + 1)
}

/// Index of the first quad of `order`: faces (4^order - 1) / 3.
pub(crate) const fn first(domain: Domain, order: u8) -> usize {
    domain.faces() * (((1 << (2 * order)) - 1) / 3)
}

/// A map and the sums above it.
#[derive(Clone, Debug)]
pub struct Pyramid<Q> {
    quads: Q,
    domain: Domain,
    order: u8,
}

/// A pyramid that samplers read.
#[derive(Clone, Copy, Debug)]
pub struct PyramidView<'a> {
    quads: &'a [Quad],
    domain: Domain,
    order: u8,
}

impl<Q: Buffer<Quad>> Pyramid<Q> {
    /// Takes [`pyramid_len`] quads, all dark at first.
    ///
    /// # Errors
    /// [`TooSmall`].
    pub fn try_new(mut quads: Q, domain: Domain, order: Order) -> Result<Self, TooSmall> {
        buffer::check(&quads, pyramid_len(domain, order))?;
        quads.as_mut().fill(Quad::default());
        Ok(Self { quads, domain, order: order.get() })
    }

    /// The pyramid whose quads are the first of `quads`, as they are.
    pub(crate) fn over(quads: Q, domain: Domain, order: Order) -> Self {
        Self { quads, domain, order: order.get() }
    }

    /// Quads of the finest order.
    #[must_use]
    pub fn texels(&self) -> &[Quad] {
        self.view().quads_of(self.order)
    }

    /// Quads of the finest order, to be filled before [`Pyramid::build`].
    pub fn texels_mut(&mut self) -> &mut [Quad] {
        let at = first(self.domain, self.order)..first(self.domain, self.order + 1);
        self.quads.as_mut().get_mut(at).unwrap_or_default()
    }

    /// The quads of `order`, at most the finest, dark: sums of light go into their energy, in any lanes, for [`Pyramid::finish`].
    #[doc(hidden)]
    pub fn accumulators(&mut self, order: u8) -> &mut [Quad] {
        let order = order.min(self.order);
        let at = first(self.domain, order)..first(self.domain, order + 1);
        let quads = self.quads.as_mut().get_mut(at).unwrap_or_default();
        quads.fill(Quad::default());
        quads
    }

    /// Makes light of the sums in the [accumulators](Pyramid::accumulators) of `order` and sums the orders above the texels.
    ///
    /// Where the texels are finer than `order`, they share their ancestor's energy by solid angle inside the domain, so that the sum
    /// is kept. Sums that noise round black made negative hold no light.
    #[doc(hidden)]
    pub fn finish(&mut self, order: u8, geometry: &[Texel], lanes: &Lanes) {
        let texels = first(self.domain, self.order);
        if order < self.order
            && let Some((coarse, texels)) = self.quads.as_mut().split_at_mut_checked(texels)
        {
            let sums = coarse.get(first(self.domain, order)..).unwrap_or_default();
            share_out(self.domain, Level { order, quads: sums }, self.order, texels);
        }
        light_up(self.quads.as_mut().get_mut(texels..).unwrap_or_default(), geometry, lanes);
        if order < self.order {
            self.build();
        } else {
            sum_up(self.quads.as_mut(), self.domain, self.order);
        }
    }

    /// Sums the orders above the texels.
    ///
    /// A texel outside the domain, with a number that is not finite or with negative energy holds no light from here on: samplers
    /// read what they may trust.
    pub fn build(&mut self) {
        self.clear_below_horizon();
        self.texels_mut().iter_mut().filter(|q| !q.is_sound()).for_each(|q| *q = Quad::default());
        sum_up(self.quads.as_mut(), self.domain, self.order);
    }

    /// Darkens the texels of a hemisphere that lie below it: under each quad on the horizon, of every order, the lowest child.
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

    /// What samplers read.
    #[must_use]
    pub fn view(&self) -> PyramidView<'_> {
        PyramidView { quads: self.quads.as_ref(), domain: self.domain, order: self.order }
    }
}

/// Sums each order above the texels from the next finer one.
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

/// The quads of one order.
struct Level<'a> {
    order: u8,
    quads: &'a [Quad],
}

/// Gives every texel its part of the sum of its ancestor: by solid angle inside the domain.
fn share_out(domain: Domain, coarse: Level<'_>, fine: u8, texels: &mut [Quad]) {
    let Level { order, quads: sums } = coarse;
    let shift = 2 * (fine - order);
    let equal = 1.0 / (1u32 << shift) as f32;
    for (sum, (ancestor, below)) in sums.iter().zip(texels.chunks_exact_mut(1 << shift).enumerate()) {
        // What is whole is shared equally: all but the quads on the horizon.
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

/// Makes light of the sums in the texels.
#[inline(never)]
fn light_up(quads: &mut [Quad], geometry: &[Texel], lanes: &Lanes) {
    let all = quads.iter_mut().zip(geometry);
    match lanes.pick {
        Pick::Plain => all.for_each(|(q, t)| light(q, t, &|e| lanes.scaled([e[0], e[1], e[2]]))),
        Pick::Swapped => all.for_each(|(q, t)| light(q, t, &|e| lanes.scaled([e[2], e[1], e[0]]))),
        Pick::Grey => all.for_each(|(q, t)| light(q, t, &|e| lanes.scaled([e[0]; 3]))),
        Pick::Cell { .. } => all.for_each(|(q, t)| light(q, t, &|e| lanes.rgb(e))),
    }
}

/// Turns a sum into light from the texel's direction.
#[inline]
fn light(quad: &mut Quad, texel: &Texel, rgb: &impl Fn([f32; 4]) -> [f32; 3]) {
    // Most of what holds no light is below the horizon or not seen.
    if quad.energy.iter().fold(0, |bits, e| bits | e.to_bits()) == 0 {
        return;
    }
    let [r, g, b] = rgb(quad.energy.map(positive));
    let y = luminance([r, g, b]);
    let [x, across, up] = texel.direction.map(|d| d * y);
    *quad = Quad { energy: [r, g, b, y], moment: [x, across, up, 0.0] };
}

/// `v`, or 0 where it is negative: without a comparison, which costs more than the sum on small cores.
#[inline]
fn positive(v: f32) -> f32 {
    f32::from_bits((v.to_bits() as i32).max(0) as u32)
}

fn sum(four: &[Quad; 4]) -> Quad {
    let [a, b, c, d] = four;
    Quad {
        energy: core::array::from_fn(|i| (a.energy[i] + b.energy[i]) + (c.energy[i] + d.energy[i])),
        moment: core::array::from_fn(|i| (a.moment[i] + b.moment[i]) + (c.moment[i] + d.moment[i])),
    }
}

impl<'a> PyramidView<'a> {
    /// The pyramid whose quads are the first of `quads`.
    pub(crate) fn over(quads: &'a [Quad], domain: Domain, order: Order) -> Self {
        Self { quads, domain, order: order.get() }
    }

    /// The part of the sphere it holds.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Finest order.
    #[must_use]
    pub fn order(&self) -> Order {
        Order::saturating(self.order)
    }

    /// All quads of `order`, which is at most the finest.
    #[must_use]
    pub fn quads_of(&self, order: u8) -> &'a [Quad] {
        let order = order.min(self.order);
        self.quads.get(first(self.domain, order)..first(self.domain, order + 1)).unwrap_or_default()
    }

    /// Quad `ipix` of `order`; a dark one outside the map.
    #[must_use]
    pub fn quad(&self, order: u8, ipix: u32) -> Quad {
        self.quads_of(order).get(ipix as usize).copied().unwrap_or_default()
    }

    /// Sum over the whole map.
    #[must_use]
    pub fn total(&self) -> Quad {
        let mut total = Quad::default();
        self.quads_of(0).iter().for_each(|q| total.add(q));
        total
    }

    /// Sum of L cos(theta) dOmega over what is above the horizon: what a cosine-corrected meter lying flat reads.
    ///
    /// Exact for luminance; each channel takes the luminance's mean height within a quad of order 4, 3.7 degrees wide.
    #[must_use]
    pub fn horizontal_irradiance(&self) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for quad in self.quads_of(4).iter().filter(|q| q.moment[2] > 0.0 && q.y() > 0.0) {
            let height = (quad.moment[2] / quad.y()).min(1.0);
            color::add(&mut sum, quad.rgb().map(|v| v * height));
        }
        sum
    }

    /// Radiance of a quad: energy over its solid angle inside the domain.
    #[must_use]
    pub fn radiance(&self, order: u8, ipix: u32) -> [f32; 3] {
        let omega = healpix::solid_angle(order) * self.domain.share(order, ipix);
        if omega > 0.0 { self.quad(order, ipix).rgb().map(|v| v / omega as f32) } else { [0.0; 3] }
    }
}
