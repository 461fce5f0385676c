//! The samplers by name, with memory from the heap.

use hemilux_core::Order;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::Grid;
use hemilux_core::sampler::adaptive::{self, Adaptive, Track, bits_len};
use hemilux_core::sampler::hemigon::fir::{self, Fir, Kernel};
use hemilux_core::sampler::hemigon::follow::Follow;
use hemilux_core::sampler::hemigon::inversion::{Inversion, Ring, rings_len};
use hemilux_core::sampler::hemigon::kalman::{self, Gated, Track as Path};
use hemilux_core::sampler::hemigon::{self, Hemigon};
use hemilux_core::sampler::pharr::{MAX_ROWS, Pharr};
use hemilux_core::sampler::q2tree::{Leaf, Parameters, Past, Q2Tree, interior_len};
use hemilux_core::sampler::{Request, Sampler};
use std::ops::RangeInclusive;

/// Names that `--sampler` and `change?algorithm=` accept.
pub const NAMES: [&str; 6] = ["adaptive", "q2tree", "q2tree-jitter", "pharr", "hemigon", "hemigon-fir"];

/// Most lights that may be asked for.
pub const MAX_LIGHTS: usize = 50_000;

/// Tolerances that may be asked for, ratios.
pub const TOLERANCES: RangeInclusive<f32> = 0.002..=1.0;

/// Orders of the map that may be asked for.
pub const ORDERS: RangeInclusive<u8> = 4..=7;

/// Thresholds of `q2tree` that may be asked for, ratios.
pub const THRESHOLDS: RangeInclusive<f32> = 0.0..=10.0;

/// Lengths of the filter of `hemigon-fir`, frames.
pub const TAPS: RangeInclusive<usize> = 1..=fir::MAX_TAPS;

/// Cut-off frequencies of that filter: up to half the frame rate that it reckons with.
pub const CUTOFFS_HZ: RangeInclusive<f32> = 0.05..=5.0;

/// What samplers let their user choose beside what is asked for in each frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuning {
    /// Relative threshold of `q2tree` and `q2tree-jitter`, of [`THRESHOLDS`].
    pub threshold: f32,
    /// Frames that `hemigon-fir` filters over, of [`TAPS`].
    pub taps: usize,
    /// Its cut-off frequency, of [`CUTOFFS_HZ`].
    pub cutoff_hz: f32,
}

impl Default for Tuning {
    fn default() -> Self {
        let fir::Parameters { taps, cutoff_hz, .. } = fir::Parameters::default();
        Self { threshold: Parameters::CENTROID.threshold, taps, cutoff_hz: cutoff_hz as f32 }
    }
}

impl Tuning {
    /// As the filter takes it.
    #[must_use]
    pub fn fir(&self) -> fir::Parameters {
        fir::Parameters { taps: self.taps, cutoff_hz: self.cutoff_hz.into(), ..fir::Parameters::default() }
    }

    /// What matters to the sampler called `name`: the rest is as by default.
    #[must_use]
    pub fn of(self, name: &str) -> Self {
        let default = Self::default();
        match name {
            "q2tree" | "q2tree-jitter" => Self { threshold: self.threshold, ..default },
            "hemigon-fir" => Self { threshold: default.threshold, ..self },
            _ => default,
        }
    }
}

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
#[derive(Debug, thiserror::Error, PartialEq)]
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
    /// A tolerance that no decomposition can be held to.
    #[error("tolerance {0}, expected 0.002 to 1 (0.03 is 3 per cent of shadowed error)")]
    BadTolerance(f32),
    /// A sampler that always gives as many lights as it is asked for.
    #[error("{what} with '{name}', expected 'adaptive', which alone knows its error")]
    NotModelled {
        /// Tolerance or ambient light.
        what: &'static str,
        /// The sampler.
        name: String,
    },
    /// A map with more rows than `pharr` can hold.
    #[error("a map of {0} rows, expected at most {MAX_ROWS} for 'pharr'")]
    TooManyRows(usize),
}

/// Finest order that `lights` lights need: 6, or 7 from 256 on, where a small sun in one texel of order 6 would err more than all else.
#[must_use]
pub fn order_for(lights: usize) -> u8 {
    if lights < 256 { 6 } else { 7 }
}

/// Order whose quads fill the polar map: 6 is as fine as that map, and finer quads would make its plan four times as long.
#[must_use]
pub fn polar_order(order: u8) -> u8 {
    order.min(6)
}

/// The fewest lights that the sampler called `name` gives: a tree has a light per base quad. `None` for an unknown name.
#[must_use]
pub fn least_lights(name: &str, domain: Domain) -> Option<usize> {
    match name {
        "adaptive" | "pharr" | "hemigon" | "hemigon-fir" => Some(1),
        "q2tree" | "q2tree-jitter" => Some(domain.faces()),
        _ => None,
    }
}

/// Whether the sampler called `name` can do what is requested on such maps.
///
/// # Errors
/// [`SamplerError`] for what it cannot.
pub fn check(name: &str, domain: Domain, request: &Request) -> Result<(), SamplerError> {
    let least = least_lights(name, domain).ok_or_else(|| SamplerError::Unknown(name.into()))?;
    let asked = [("a tolerance", request.tolerance.is_some()), ("ambient light", request.ambient)];
    if let Some((what, _)) = asked.into_iter().find(|(_, asked)| *asked && name != "adaptive") {
        return Err(SamplerError::NotModelled { what, name: name.into() });
    }
    if let Some(tolerance) = request.tolerance.filter(|t| !TOLERANCES.contains(t)) {
        return Err(SamplerError::BadTolerance(tolerance));
    }
    let least = if request.ambient { 0 } else { least };
    if !(least..=MAX_LIGHTS).contains(&request.lights) {
        return Err(SamplerError::BadLights { found: request.lights, least, name: name.into() });
    }
    Ok(())
}

/// Makes the sampler called `name` for maps of `shape`, with room for `lights` lights; `hemigon` and `hemigon-fir` give at most
/// [`hemigon::MAX_LIGHTS`].
///
/// # Errors
/// [`SamplerError`] for names, light counts and maps that do not exist.
pub fn make(name: &str, shape: &Shape, lights: usize) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    make_tuned(name, shape, lights, &Tuning::default())
}

/// The same, tuned.
///
/// # Errors
/// As [`make`].
pub fn make_tuned(
    name: &str,
    shape: &Shape,
    lights: usize,
    tuning: &Tuning,
) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    let ambient = lights == 0 && name == "adaptive";
    check(name, shape.domain, &Request { ambient, ..Request::of_lights(lights) })?;
    let tree = |parameters| q2tree(Parameters { threshold: tuning.threshold, ..parameters }, shape, lights);
    match name {
        "pharr" => {
            let conditional = vec![0.0f32; shape.grid.len()];
            let sampler = Pharr::try_new(&shape.grid, conditional, vec![Light::default(); lights]);
            Ok(Box::new(sampler.map_err(|_| SamplerError::TooManyRows(shape.grid.height))?))
        }
        "adaptive" => Ok(adaptive(shape, lights)),
        "hemigon" => Ok(gated(shape, lights.min(hemigon::MAX_LIGHTS))),
        "hemigon-fir" => Ok(filtered(shape, lights.min(hemigon::MAX_LIGHTS), &tuning.fir())),
        "q2tree" => Ok(tree(Parameters::CENTROID)),
        "q2tree-jitter" => Ok(tree(Parameters::JITTER)),
        _ => Err(SamplerError::Unknown(name.into())),
    }
}

fn q2tree(parameters: Parameters, shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let bits = || vec![0u8; interior_len(shape.domain, Order::saturating(shape.order))];
    let heap = vec![Leaf::default(); lights];
    let room = (vec![Light::default(); lights], vec![Past::default(); lights]);
    let sampler = Q2Tree::try_new(
        parameters,
        (shape.domain, Order::saturating(shape.order)),
        [bits(), bits()],
        heap,
        room,
    );
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}

fn adaptive(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let bits = || vec![0u8; bits_len(shape.domain, Order::saturating(shape.order))];
    let light = || vec![Light::default(); lights];
    let tracks = || vec![Track::default(); lights];
    let heap = vec![adaptive::Leaf::default(); lights];
    let over = (shape.domain, Order::saturating(shape.order));
    let sampler = Adaptive::try_new(over, [bits(), bits()], heap, [light(), light()], [tracks(), tracks()]);
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}

fn gated(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let tracks = vec![Path::default(); 2 * lights];
    let filter = Gated::try_new(kalman::Parameters::LIGHTS, lights, tracks);
    hemigon(shape, lights, filter.expect("two tracks per light"))
}

fn filtered(shape: &Shape, lights: usize, parameters: &fir::Parameters) -> Box<dyn Sampler + Send> {
    let paths = vec![glam::Vec3::ZERO; 2 * lights * Kernel::new(parameters).weights().len()];
    let filter = Fir::try_new(parameters, lights, paths);
    hemigon(shape, lights, filter.expect("two paths of as many directions as taps per light"))
}

fn hemigon<F: Follow + Send + 'static>(shape: &Shape, lights: usize, filter: F) -> Box<dyn Sampler + Send> {
    let conditional = vec![0.0f32; shape.grid.len()];
    let rings = vec![Ring::default(); rings_len(&shape.grid)];
    let inversion =
        Inversion::try_new(&shape.grid, conditional, rings).expect("memory for each texel and ring");
    let sampler = Hemigon::try_new(inversion, filter, vec![0; 2 * lights], vec![Light::default(); lights]);
    Box::new(sampler.expect("two slots per light"))
}
