//! Samplers: state machines that turn maps into lights.
//!
//! A sampler owns its arena, keeps what it needs of the past, allocates nothing and gives every light an id that survives as long
//! as the light does. The server and the simulator know only the trait.

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

/// What a sampler reads.
#[derive(Clone, Copy, Debug)]
pub struct Map<'a> {
    /// The HEALPix pyramid.
    pub pyramid: PyramidView<'a>,
    /// The latitude-longitude map; [`LatLongView::NONE`] unless the sampler [needs it](Sampler::needs_polar).
    pub polar: LatLongView<'a>,
}

/// What is asked of a sampler for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Request {
    /// Most lights.
    pub lights: usize,
    /// The shadowed error, a ratio, that the fewest possible lights are to reach; without one there are as many as the map allows. Read
    /// by samplers that estimate their error.
    pub tolerance: Option<f32>,
    /// Spherical harmonics for what has no direction. Read by `adaptive` alone.
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
