//! `hemigon` and `hemigon-fir`: lights of equal luminance at the images of fixed points of the unit square, filtered over time.
//!
//! Light i is the image of point i of a fixed [`sequence`] under the [`inversion`] of the map's distribution, so a higher number of lights
//! leaves the existing lights in place. A sphere consists of two hemispheres with a sequence each; the lights are divided between them by
//! luminance. The id of a light encodes its hemisphere and its point, so ids stay the same when the division changes. Lights of a
//! hemisphere are in the order of their ids.
//!
//! Any motion in the map moves all lights slightly. `hemigon-fir` smooths the directions and the total energy with the published filters
//! ([`fir`]): the sum of its lights is delayed against the map. `hemigon` smooths the directions alone, with a filter that follows abrupt
//! changes without delay ([`kalman`]): the sum of its lights equals the energy of the map in every frame and channel.
//!
//! The system is from \[Havran2005\], the map from \[Havran2003\], the filters are from \[Nikodym2012\]; details that these publications do
//! not state are a reconstruction.

mod colour;
mod event;
pub mod fir;
pub mod follow;
pub mod inversion;
pub mod kalman;
pub mod sequence;

use super::{Map, Request, Sampler, SamplerKind, Timer};
use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{luminance, sound};
use crate::light::{Decomposition, Light};
use crate::polar::{Grid, LatLongView};
use crate::sizes::BufferSize;
use core::f64::consts::TAU;
use event::Detector;
use follow::{Follow, PathPoint};
use inversion::{Inversion, Ring, rings_len};

/// Largest number of lights of the sampler.
pub const MAX_LIGHTS: usize = 8192;

/// Largest difference between a hemisphere's number of lights and its exact share, above which lights are moved to the other hemisphere:
/// 0.5 is rounding, the rest prevents moves by noise.
const HYSTERESIS: f64 = 0.6;

/// Number of elements of each buffer of [`Hemigon`] and its [`Inversion`]. The filter has further buffers ([`fir::paths_len`]; two
/// [`kalman::PathFilter`]s per light).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Number of elements of the conditional distributions: one per texel.
    pub texels: usize,
    /// Number of rings of the inversion.
    pub rings: usize,
    /// Number of stored ages, two per light.
    pub lives: usize,
    /// Number of lights, at most [`MAX_LIGHTS`].
    pub lights: usize,
}

impl Sizes {
    /// Returns the buffer lengths of the sampler for maps of `grid` and up to `lights` lights.
    #[must_use]
    pub const fn new(grid: &Grid, lights: usize) -> Self {
        let lights = if lights < MAX_LIGHTS { lights } else { MAX_LIGHTS };
        Self { texels: grid.len(), rings: rings_len(grid), lives: 2 * lights, lights }
    }

    /// Returns name and size of each buffer of the sampler.
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

/// The sampler `hemigon` or `hemigon-fir`. `C` and `R` are the buffers of [`Inversion`], `F` is the filter, `A` holds two ages per light,
/// `L` one [`Light`] per light.
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
    /// Number of frames since the light of each slot appeared, 0 for an unused slot; first the slots of the upper hemisphere, then of the lower.
    lives: A,
    lights: L,
    /// Number of lights of each hemisphere in the last frame.
    shares: [usize; 2],
}

impl<C: Buffer<f32>, R: Buffer<Ring>, F: Follow, A: Buffer<u32>, L: Buffer<Light>> Hemigon<C, R, F, A, L> {
    /// Creates the sampler for as many lights as `lights` has elements, at most [`MAX_LIGHTS`]. `lives` and the filter need two slots per
    /// light.
    ///
    /// # Errors
    /// [`TooSmall`] if `lives` or the filter has too few slots.
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

    /// Returns the largest number of lights for which the buffers have memory.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.lights.as_ref().len().min(MAX_LIGHTS)
    }

    /// Writes the lights of one hemisphere to `self.lights` from index `first`; returns the number of lights written.
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
            // The cap has the solid angle that the light represents, 1 / (n pdf).
            let cap = 1.0 / (points as f64 * place.pdf_sa);
            self.lights.as_mut()[count] = Light {
                id: id(lower, i),
                direction: place.direction.as_vec3(),
                irradiance: colour_of(map.texels[place.texel]),
                radius_deg: libm::acos((1.0 - cap / TAU).clamp(-1.0, 1.0)).to_degrees() as f32,
                age: *life,
                parent: None,
            };
            *life = life.saturating_add(1);
            count += 1;
        }
        count - first
    }

    /// Replaces the directions and colours of the first `count` lights by those that the filter returns.
    fn smooth(&mut self, count: usize) {
        let capacity = self.capacity();
        for light in &mut self.lights.as_mut()[..count] {
            let seen = PathPoint { direction: light.direction, colour: light.irradiance };
            let is = self.filter.follow(slot_of(light.id, capacity), light.age == 0, seen);
            (light.direction, light.irradiance) = (is.direction, is.colour);
        }
    }
}

/// Returns the id of the light of `point`: ids of the lower hemisphere follow those of the upper.
fn id(lower: bool, point: usize) -> u32 {
    (point + 1 + if lower { MAX_LIGHTS } else { 0 }) as u32
}

/// Returns the slot of the filter of the light `id`, with `capacity` slots for each hemisphere.
fn slot_of(id: u32, capacity: usize) -> usize {
    let point = (id as usize).saturating_sub(1);
    if point < MAX_LIGHTS { point } else { point - MAX_LIGHTS + capacity }
}

/// Returns the colour of a texel, scaled to luminance 1.
fn colour_of(texel: [f32; 3]) -> [f32; 3] {
    let rgb = sound(texel);
    let y = luminance(rgb);
    rgb.map(|v| v / y)
}

/// Divides `lights` between the hemispheres by luminance; keeps the division of the last frame if its error is at most [`HYSTERESIS`].
fn divide(lights: usize, energy: [f64; 2], last: [usize; 2]) -> [usize; 2] {
    let total = energy[0] + energy[1];
    let exact = lights as f64 * energy[0] / total;
    let nearest = (libm::floor(exact + 0.5) as usize).min(lights);
    // The upper hemisphere keeps a number between its last number and the number that leaves the lower hemisphere's unchanged.
    let (had, other) = (last[0].min(lights), lights.saturating_sub(last[1]));
    let kept = nearest.clamp(had.min(other), had.max(other));
    let is_near = (kept as f64 - exact).abs() <= HYSTERESIS;
    let is_lit = (kept == 0 || energy[0] > 0.0) && (kept == lights || energy[1] > 0.0);
    let upper = if is_near && is_lit { kept } else { nearest };
    [upper, lights - upper]
}

/// Returns the red, green and blue energy of a map.
fn total_of(map: &LatLongView<'_>) -> [f64; 3] {
    let mut total = [0.0; 3];
    for texel in map.texels {
        for (sum, v) in total.iter_mut().zip(sound(*texel)) {
            *sum += f64::from(v);
        }
    }
    total
}

impl<C: Buffer<f32>, R: Buffer<Ring>, F: Follow, A: Buffer<u32>, L: Buffer<Light>> Sampler
    for Hemigon<C, R, F, A, L>
{
    fn kind(&self) -> SamplerKind {
        F::KIND
    }

    fn needs_polar(&self) -> bool {
        true
    }

    fn update_timed(&mut self, map: &Map<'_>, request: &Request, timer: &mut Timer<'_>) -> Decomposition<'_> {
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
        let total = total_of(map);
        let total = timer.measure(|| self.filter.total(total));
        let upper = self.sample(map, false, 0);
        let count = upper + self.sample(map, true, upper);
        timer.measure(|| self.smooth(count));
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
