//! Samplers: convert a sequence of maps to sets of directional lights.
//!
//! A sampler works in buffers that the caller lends and allocates no memory. It keeps state from frame to frame, so that a light keeps its
//! id for as long as it exists. All samplers implement [`Sampler`]; [`SamplerKind`] lists their names.
//!
//! | module | input | lights |
//! |---|---|---|
//! | [`adaptive`] | HEALPix pyramid | unequal energy; estimates its error; optional ambient light and number of lights by tolerance |
//! | [`q2tree`] | HEALPix pyramid | one per leaf of a quadtree; unequal energy |
//! | [`pharr`] | latitude-longitude map | equal luminance, at Halton points |
//! | [`hemigon`] | latitude-longitude map | equal luminance, filtered over time |

pub mod adaptive;
pub mod halton;
mod heap;
pub mod hemigon;
mod kind;
pub mod pharr;
pub mod q2tree;
mod timer;

use crate::light::Decomposition;
use crate::polar::LatLongView;
use crate::pyramid::PyramidView;
pub use kind::{SamplerKind, UnknownSampler};
pub use timer::Timer;

/// The input of a sampler for one frame.
#[derive(Clone, Copy, Debug)]
pub struct Map<'a> {
    /// The HEALPix pyramid of the map.
    pub pyramid: PyramidView<'a>,
    /// The latitude-longitude map; [`LatLongView::NONE`] for samplers that [do not read it](Sampler::needs_polar).
    pub polar: LatLongView<'a>,
}

/// The request to a sampler for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Request {
    /// Largest number of lights in the set.
    pub lights: usize,
    /// Shadowed error (a ratio: 0.03 is 3 %) that the light set must reach with as few lights as possible; `None` requests `lights`
    /// lights. Only samplers that [estimate their error](SamplerKind::estimates_error) read it.
    pub tolerance: Option<f32>,
    /// Whether light without a dominant direction is returned as spherical harmonics. Only `adaptive` reads it.
    pub ambient: bool,
    /// Whether the lights are drawn as uniform discs of their radius, so that their energies and radii are fitted to discs instead of points.
    /// Only `adaptive` reads it; the other samplers return radii in either case.
    pub soft: bool,
}

impl Request {
    /// Requests up to `lights` lights, without a tolerance or ambient light, fitted as points.
    #[must_use]
    pub const fn of_lights(lights: usize) -> Self {
        Self { lights, tolerance: None, ambient: false, soft: false }
    }
}

impl From<usize> for Request {
    fn from(lights: usize) -> Self {
        Self::of_lights(lights)
    }
}

/// Converts a sequence of maps to sets of directional lights.
pub trait Sampler {
    /// Returns the kind of the sampler.
    fn kind(&self) -> SamplerKind;

    /// Returns whether the sampler reads [`Map::polar`].
    fn needs_polar(&self) -> bool {
        false
    }

    /// Computes the lights of the next frame. A map without light gives no lights.
    fn update(&mut self, map: &Map<'_>, request: &Request) -> Decomposition<'_> {
        self.update_timed(map, request, &mut Timer::none())
    }

    /// Computes lights like [`Sampler::update`]; `timer` measures the temporal filters of directions and energies. Samplers without such filters do not read
    /// `timer`.
    fn update_timed(&mut self, map: &Map<'_>, request: &Request, timer: &mut Timer<'_>) -> Decomposition<'_>;

    /// Discards the state of earlier frames, for example after a jump in time.
    fn reset(&mut self);
}
