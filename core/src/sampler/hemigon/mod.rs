//! `hemigon` and `hemigon-fir`: equally luminous lights through a continuous map from the unit square, followed over time.
//!
//! Light i is where [`inversion`] puts point i of a fixed [`sequence`]: more lights leave those that are there where they are. A sphere
//! is two hemispheres, each with a sequence of its own, that share the lights by luminance; a light's id says which hemisphere and
//! which point, so that ids survive when the share moves. Lights of one hemisphere are in the order of their ids.
//!
//! Over time a lamp that moves anywhere moves all lights a little. `hemigon-fir` smooths that with the published filters ([`fir`]),
//! over the energy too, so that its lights do not give out the map's energy of this frame; `hemigon` has a filter that keeps up with
//! abrupt changes ([`kalman`]), and its lights give out the map's energy in every frame and channel.
//!
//! \[Havran2005\] is the system, \[Havran2003\] the map, \[Nikodym2012\] the filters; what they leave open is a reconstruction.

mod colour;
mod event;
pub mod fir;
pub mod follow;
pub mod inversion;
pub mod kalman;
pub mod sequence;

use super::{Map, Request, Sampler, SamplerKind};
use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{luminance, sound};
use crate::light::{Decomposition, Light};
use crate::polar::{Grid, LatLongView};
use crate::sizes::BufferSize;
use core::f64::consts::TAU;
use event::Detector;
use follow::{Follow, PathPoint};
use inversion::{Inversion, Ring, rings_len};

/// Most lights; a request for more gives this number.
pub const MAX_LIGHTS: usize = 8192;

/// Lights by which the share of a hemisphere may be off before it moves: half a light is rounding, the rest keeps noise from moving it.
const HYSTERESIS: f64 = 0.6;

/// Lengths of the buffers of [`Hemigon`] and its [`Inversion`]; the filter's are its own ([`fir::paths_len`], two
/// [`kalman::PathFilter`]s per light).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Conditional distributions: one number per texel.
    pub texels: usize,
    /// Rings of the map.
    pub rings: usize,
    /// Lives: two numbers per light.
    pub lives: usize,
    /// Lights, at most [`MAX_LIGHTS`].
    pub lights: usize,
}

impl Sizes {
    /// Lengths for maps of `grid` and up to `lights` lights.
    #[must_use]
    pub const fn new(grid: &Grid, lights: usize) -> Self {
        let lights = if lights < MAX_LIGHTS { lights } else { MAX_LIGHTS };
        Self { texels: grid.len(), rings: rings_len(grid), lives: 2 * lights, lights }
    }

    /// Names and bytes of all buffers.
    #[must_use]
    pub const fn buffers(&self) -> [BufferSize; 4] {
        [
            BufferSize::of::<f32>("sampler: rows", self.texels),
            BufferSize::of::<Ring>("sampler: rings", self.rings),
            BufferSize::of::<u32>("sampler: slots", self.lives),
            BufferSize::of::<Light>("sampler: lights", self.lights),
        ]
    }
}

/// The sampler. `C` and `R` are the memory of [`Inversion`], `F` the filter; `A` holds two numbers per light, `L` one [`Light`].
///
/// # Examples
/// ```
/// use hemilux_core::polar::{Grid, LatLongView};
/// use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
/// use hemilux_core::sampler::hemigon::inversion::{Inversion, Ring};
/// use hemilux_core::sampler::hemigon::kalman::{Gated, Parameters, PathFilter};
/// use hemilux_core::sampler::hemigon::{Hemigon, Sizes};
/// use hemilux_core::{Domain, Light, Map, Order, Request, Sampler};
///
/// let grid = Grid { width: 16, height: 4, domain: Domain::Hemisphere };
/// let sizes = Sizes::new(&grid, 8);
/// let inversion = Inversion::try_new(&grid, vec![0.0; sizes.texels], vec![Ring::default(); sizes.rings])?;
/// let filter = Gated::try_new(Parameters::LIGHTS, sizes.lights, vec![PathFilter::default(); sizes.lives])?;
/// let lights = vec![Light::default(); sizes.lights];
/// let mut sampler = Hemigon::try_new(inversion, filter, vec![0; sizes.lives], lights)?;
///
/// let texels: Vec<_> = (0..grid.len()).map(|i| [grid.solid_angle(i / 16) as f32; 3]).collect();
/// let quads = vec![Quad::default(); pyramid_len(Domain::Hemisphere, Order::saturating(0))];
/// let pyramid = Pyramid::try_new(quads, Domain::Hemisphere, Order::saturating(0))?;
/// let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels: &texels } };
/// let made = sampler.update(&map, &Request::of_lights(8));
/// // A uniform hemisphere of radiance 1 has a scalar flux of 2 pi.
/// let flux: f32 = made.lights.iter().map(|light| light.irradiance[0]).sum();
/// assert!((flux - core::f32::consts::TAU).abs() < 1e-4);
/// # Ok::<(), hemilux_core::TooSmall>(())
/// ```
#[derive(Clone, Debug)]
pub struct Hemigon<C, R, F, A, L> {
    inversion: Inversion<C, R>,
    filter: F,
    detector: Detector,
    /// Frames that the light of each slot has lived, 0 for none: the upper hemisphere's slots, then the lower's.
    lives: A,
    lights: L,
    /// Lights of the last frame by hemisphere.
    shares: [usize; 2],
}

impl<C, R, F, A, L> Hemigon<C, R, F, A, L>
where
    C: Buffer<f32>,
    R: Buffer<Ring>,
    F: Follow,
    A: Buffer<u32>,
    L: Buffer<Light>,
{
    /// Takes the memory for as many lights as `lights` holds, at most [`MAX_LIGHTS`].
    ///
    /// # Errors
    /// [`TooSmall`]: the filter and `lives` need two slots per light.
    pub fn try_new(inversion: Inversion<C, R>, filter: F, lives: A, lights: L) -> Result<Self, TooSmall> {
        let needed = 2 * lights.as_ref().len().min(MAX_LIGHTS);
        buffer::check(&lives, needed)?;
        if filter.slots() < needed {
            return Err(TooSmall { needed, lent: filter.slots() });
        }
        let mut new = Self { inversion, filter, detector: Detector::new(), lives, lights, shares: [0; 2] };
        new.reset();
        Ok(new)
    }

    /// Most lights it can give.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.lights.as_ref().len().min(MAX_LIGHTS)
    }

    /// Writes the lights that point 0, 1, ... of a hemisphere make into `self.lights` from `first` on; returns how many.
    fn sample(&mut self, map: &LatLongView<'_>, lower: bool, first: usize) -> usize {
        let (capacity, points) = (self.capacity(), self.shares[usize::from(lower)]);
        let mut count = first;
        for i in 0..capacity {
            let slot = i + if lower { capacity } else { 0 };
            let life = &mut self.lives.as_mut()[slot];
            let place = if i < points {
                self.inversion.place(map, lower, sequence::point(lower, i as u32))
            } else {
                None
            };
            let Some(place) = place else {
                *life = 0;
                continue;
            };
            let seen = PathPoint {
                direction: place.direction.as_vec3(),
                colour: colour_of(map.texels[place.texel]),
            };
            let is = self.filter.follow(slot, *life == 0, seen);
            // The light's share of the sphere, 1 / (n pdf), as a cap.
            let cap = 1.0 / (points as f64 * place.pdf_sa);
            self.lights.as_mut()[count] = Light {
                id: id(lower, i),
                direction: is.direction,
                irradiance: is.colour,
                radius_deg: libm::acos((1.0 - cap / TAU).clamp(-1.0, 1.0)).to_degrees() as f32,
                age: *life,
                parent: None,
            };
            *life = life.saturating_add(1);
            count += 1;
        }
        count - first
    }
}

/// A light's number: that of its point, the lower hemisphere's after the upper's.
fn id(lower: bool, point: usize) -> u32 {
    (point + 1 + if lower { MAX_LIGHTS } else { 0 }) as u32
}

/// Colour of a texel, of luminance 1.
fn colour_of(texel: [f32; 3]) -> [f32; 3] {
    let rgb = sound(texel);
    let y = luminance(rgb);
    rgb.map(|v| v / y)
}

/// How many of `lights` each hemisphere gets: by luminance, those of the last frame if they are right within [`HYSTERESIS`].
fn divide(lights: usize, energy: [f64; 2], last: [usize; 2]) -> [usize; 2] {
    let total = energy[0] + energy[1];
    let exact = lights as f64 * energy[0] / total;
    let nearest = (libm::floor(exact + 0.5) as usize).min(lights);
    // Between what the upper hemisphere had and what it has if it takes all that is new or gives all that is gone.
    let (had, other) = (last[0].min(lights), lights.saturating_sub(last[1]));
    let kept = nearest.clamp(had.min(other), had.max(other));
    let is_near = (kept as f64 - exact).abs() <= HYSTERESIS;
    let is_lit = (kept == 0 || energy[0] > 0.0) && (kept == lights || energy[1] > 0.0);
    let upper = if is_near && is_lit { kept } else { nearest };
    [upper, lights - upper]
}

/// Energy of a map, RGB.
fn total_of(map: &LatLongView<'_>) -> [f64; 3] {
    let mut total = [0.0; 3];
    for texel in map.texels {
        for (sum, v) in total.iter_mut().zip(sound(*texel)) {
            *sum += f64::from(v);
        }
    }
    total
}

impl<C, R, F, A, L> Sampler for Hemigon<C, R, F, A, L>
where
    C: Buffer<f32>,
    R: Buffer<Ring>,
    F: Follow,
    A: Buffer<u32>,
    L: Buffer<Light>,
{
    fn kind(&self) -> SamplerKind {
        F::KIND
    }

    fn needs_polar(&self) -> bool {
        true
    }

    fn update(&mut self, map: &Map<'_>, request: &Request) -> Decomposition<'_> {
        let map = &map.polar;
        let energy = self.inversion.build(map);
        let luminous = energy[0] + energy[1];
        if luminous <= 0.0 {
            self.reset();
            return Decomposition::of_lights(&[]);
        }
        let abrupt = self.detector.is_abrupt(map, luminous);
        self.shares = divide(request.lights.min(self.capacity()), energy, self.shares);
        self.filter.begin(abrupt);
        let total = self.filter.total(total_of(map));
        let upper = self.sample(map, false, 0);
        let count = upper + self.sample(map, true, upper);
        let lights = &mut self.lights.as_mut()[..count];
        colour::share(lights, total);
        Decomposition::of_lights(lights)
    }

    fn reset(&mut self) {
        self.shares = [0; 2];
        self.lives.as_mut().fill(0);
        self.filter.reset();
        self.detector.reset();
    }
}
