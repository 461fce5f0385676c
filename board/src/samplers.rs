//! The samplers by name, with memory from the heap.

use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::Grid;
use hemilux_core::sampler::Sampler;
use hemilux_core::sampler::adaptive::{self, Adaptive, Track, bits_len};
use hemilux_core::sampler::pharr::{MAX_ROWS, Pharr};
use hemilux_core::sampler::q2tree::{Leaf, Parameters, Q2Tree, interior_len};

/// Names that `--sampler` and `change?algorithm=` accept.
pub const NAMES: [&str; 4] = ["adaptive", "q2tree", "q2tree-jitter", "pharr"];

/// Most lights that may be asked for.
pub const MAX_LIGHTS: usize = 50_000;

/// The shape of the maps that a sampler will read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Part of the sphere.
    pub domain: Domain,
    /// Finest order of the pyramid.
    pub order: u8,
    /// The latitude-longitude map.
    pub grid: Grid,
}

/// Why there is no such sampler.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum SamplerError {
    /// An unknown name.
    #[error("sampler '{0}', expected one of {list}", list = NAMES.join(", "))]
    Unknown(String),
    /// More lights than any sampler gives.
    #[error("{found} lights, expected {least} to {MAX_LIGHTS} for '{name}'")]
    BadLights {
        /// What was asked for.
        found: usize,
        /// The fewest that the sampler gives on such maps.
        least: usize,
        /// The sampler.
        name: String,
    },
    /// A map with more rows than `pharr` can hold.
    #[error("a map of {0} rows, expected at most {MAX_ROWS} for 'pharr'")]
    TooManyRows(usize),
}

/// Finest order that `lights` lights need: 6, or 7 above 12,000.
#[must_use]
pub fn order_for(lights: usize) -> u8 {
    if lights > 12_000 { 7 } else { 6 }
}

/// The fewest lights that the sampler called `name` gives: a tree has a light per base quad. `None` for an unknown name.
#[must_use]
pub fn least_lights(name: &str, domain: Domain) -> Option<usize> {
    match name {
        "adaptive" | "pharr" => Some(1),
        "q2tree" | "q2tree-jitter" => Some(domain.faces()),
        _ => None,
    }
}

/// Makes the sampler called `name` for maps of `shape`, with room for `lights` lights.
///
/// # Errors
/// [`SamplerError`] for names, light counts and maps that do not exist.
pub fn make(name: &str, shape: &Shape, lights: usize) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    let least = least_lights(name, shape.domain).ok_or_else(|| SamplerError::Unknown(name.into()))?;
    if !(least..=MAX_LIGHTS).contains(&lights) {
        return Err(SamplerError::BadLights { found: lights, least, name: name.into() });
    }
    match name {
        "pharr" => {
            let conditional = vec![0.0f32; shape.grid.len()];
            let sampler = Pharr::try_new(&shape.grid, conditional, vec![Light::default(); lights]);
            Ok(Box::new(sampler.map_err(|_| SamplerError::TooManyRows(shape.grid.height))?))
        }
        "adaptive" => Ok(adaptive(shape, lights)),
        "q2tree" => Ok(q2tree(Parameters::CENTROID, shape, lights)),
        "q2tree-jitter" => Ok(q2tree(Parameters::JITTER, shape, lights)),
        _ => Err(SamplerError::Unknown(name.into())),
    }
}

fn q2tree(parameters: Parameters, shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let bits = || vec![0u8; interior_len(shape.domain, shape.order)];
    let light = || vec![Light::default(); lights];
    let heap = vec![Leaf::default(); lights];
    let sampler =
        Q2Tree::try_new(parameters, (shape.domain, shape.order), [bits(), bits()], heap, [light(), light()]);
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}

fn adaptive(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let bits = || vec![0u8; bits_len(shape.domain, shape.order)];
    let light = || vec![Light::default(); lights];
    let tracks = || vec![Track::default(); lights];
    let heap = vec![adaptive::Leaf::default(); lights];
    let over = (shape.domain, shape.order);
    let sampler = Adaptive::try_new(over, [bits(), bits()], heap, [light(), light()], [tracks(), tracks()]);
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}
