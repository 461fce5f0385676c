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
use hemilux_core::sampler::{Request, Sampler, SamplerKind};
use std::ops::RangeInclusive;

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

    /// The values that the sampler `kind` reads; the others are the defaults.
    #[must_use]
    pub fn of(self, kind: SamplerKind) -> Self {
        let default = Self::default();
        match kind {
            SamplerKind::Q2Tree | SamplerKind::Q2TreeJitter => Self { threshold: self.threshold, ..default },
            SamplerKind::HemigonFir => Self { threshold: default.threshold, ..self },
            SamplerKind::Adaptive | SamplerKind::Pharr | SamplerKind::Hemigon => default,
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

/// Why a sampler cannot be made or cannot do what is requested.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum SamplerError {
    /// A number of lights that the sampler does not give.
    #[error("{found} lights, expected {least} to {MAX_LIGHTS} for '{sampler}'")]
    BadLights {
        /// The number that was requested.
        found: usize,
        /// The fewest that the sampler gives on such maps.
        least: usize,
        /// The sampler.
        sampler: SamplerKind,
    },
    /// A tolerance that no decomposition can be held to.
    #[error("tolerance {0}, expected 0.002 to 1 (0.03 is 3 per cent of shadowed error)")]
    BadTolerance(f32),
    /// A sampler that always gives as many lights as are requested.
    #[error("{what} with '{sampler}', expected 'adaptive', which alone knows its error")]
    NotModelled {
        /// Tolerance or ambient light.
        what: &'static str,
        /// The sampler.
        sampler: SamplerKind,
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

/// Whether the sampler `kind` can do what is requested on maps of `domain`.
///
/// # Errors
/// [`SamplerError`] for what it cannot.
pub fn check(kind: SamplerKind, domain: Domain, request: &Request) -> Result<(), SamplerError> {
    let requested = [("a tolerance", request.tolerance.is_some()), ("ambient light", request.ambient)];
    if let Some((what, _)) = requested.into_iter().find(|(_, is)| *is && !kind.estimates_error()) {
        return Err(SamplerError::NotModelled { what, sampler: kind });
    }
    if let Some(tolerance) = request.tolerance.filter(|t| !TOLERANCES.contains(t)) {
        return Err(SamplerError::BadTolerance(tolerance));
    }
    let least = if request.ambient { 0 } else { kind.least_lights(domain) };
    if !(least..=MAX_LIGHTS).contains(&request.lights) {
        return Err(SamplerError::BadLights { found: request.lights, least, sampler: kind });
    }
    Ok(())
}

/// Makes the sampler `kind` for maps of `shape`, with memory for `lights` lights; `hemigon` and `hemigon-fir` give at most
/// [`hemigon::MAX_LIGHTS`].
///
/// # Errors
/// [`SamplerError`] for light counts that the sampler does not give and maps that it does not take.
pub fn make(
    kind: SamplerKind,
    shape: &Shape,
    lights: usize,
) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    make_tuned(kind, shape, lights, &Tuning::default())
}

/// Like [`make`], with values other than the defaults.
///
/// # Errors
/// Like [`make`].
pub fn make_tuned(
    kind: SamplerKind,
    shape: &Shape,
    lights: usize,
    tuning: &Tuning,
) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    let ambient = lights == 0 && kind.estimates_error();
    check(kind, shape.domain, &Request { ambient, ..Request::of_lights(lights) })?;
    let tree = |parameters| q2tree(Parameters { threshold: tuning.threshold, ..parameters }, shape, lights);
    match kind {
        SamplerKind::Pharr => {
            let conditional = vec![0.0f32; shape.grid.len()];
            let sampler = Pharr::try_new(&shape.grid, conditional, vec![Light::default(); lights]);
            Ok(Box::new(sampler.map_err(|_| SamplerError::TooManyRows(shape.grid.height))?))
        }
        SamplerKind::Adaptive => Ok(adaptive(shape, lights)),
        SamplerKind::Hemigon => Ok(gated(shape, lights.min(hemigon::MAX_LIGHTS))),
        SamplerKind::HemigonFir => Ok(filtered(shape, lights.min(hemigon::MAX_LIGHTS), &tuning.fir())),
        SamplerKind::Q2Tree => Ok(tree(Parameters::CENTROID)),
        SamplerKind::Q2TreeJitter => Ok(tree(Parameters::JITTER)),
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
