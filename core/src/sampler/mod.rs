//! Samplers: state machines that turn maps into lights.
//!
//! A sampler works in memory that the caller lends, keeps the state that later frames need, allocates nothing, and gives each light an id
//! that stays the same from frame to frame for as long as the light exists. The server and the simulator use the [`Sampler`] trait alone.

pub mod adaptive;
pub mod halton;
mod heap;
pub mod hemigon;
mod kind;
pub mod pharr;
pub mod q2tree;

use crate::light::Decomposition;
use crate::polar::LatLongView;
use crate::pyramid::PyramidView;
pub use kind::{SamplerKind, UnknownSampler};

/// The input of a sampler: one frame's light, in two forms.
#[derive(Clone, Copy, Debug)]
pub struct Map<'a> {
    /// The HEALPix pyramid.
    pub pyramid: PyramidView<'a>,
    /// The latitude-longitude map; [`LatLongView::NONE`] unless the sampler [needs it](Sampler::needs_polar).
    pub polar: LatLongView<'a>,
}

/// The request to a sampler for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Request {
    /// Largest number of lights in the set.
    pub lights: usize,
    /// Shadowed error, a ratio, that the set reaches with as few lights as possible; `None` requests as many lights as the map allows. Only
    /// samplers that [estimate their error](SamplerKind::estimates_error) read it.
    pub tolerance: Option<f32>,
    /// Whether light without a direction goes into spherical harmonics. Only `adaptive` reads it.
    pub ambient: bool,
}

impl Request {
    /// Up to `lights` lights and nothing else.
    #[must_use]
    pub const fn of_lights(lights: usize) -> Self {
        Self { lights, tolerance: None, ambient: false }
    }
}

impl From<usize> for Request {
    fn from(lights: usize) -> Self {
        Self::of_lights(lights)
    }
}

/// Turns a sequence of maps into light sets.
pub trait Sampler {
    /// Which sampler it is.
    fn kind(&self) -> SamplerKind;

    /// Whether it reads [`Map::polar`].
    fn needs_polar(&self) -> bool {
        false
    }

    /// Decomposes the next frame. A map without light gives no lights.
    fn update(&mut self, map: &Map<'_>, request: &Request) -> Decomposition<'_>;

    /// Forgets the past, as after a jump in time.
    fn reset(&mut self);
}
