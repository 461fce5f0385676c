//! The samplers by kind, with memory that is allocated on the heap.

use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::Grid;
use hemilux_core::sampler::adaptive::{self, Adaptive, LightFilter};
use hemilux_core::sampler::hemigon::fir::{self, Fir};
use hemilux_core::sampler::hemigon::follow::Follow;
use hemilux_core::sampler::hemigon::inversion::{Inversion, Ring};
use hemilux_core::sampler::hemigon::kalman::{self, Gated, PathFilter};
use hemilux_core::sampler::hemigon::{self, Hemigon};
use hemilux_core::sampler::pharr::{self, Pharr};
use hemilux_core::sampler::q2tree::{self, Parameters, Past, Q2Tree};
use hemilux_core::sampler::{Request, Sampler, SamplerKind};
use hemilux_core::{BufferSize, MapShape, Order};
use std::ops::RangeInclusive;

/// Largest number of lights that a request may have.
pub const MAX_LIGHTS: usize = 50_000;

/// Range of the tolerance that a request may have, a ratio.
pub const TOLERANCES: RangeInclusive<f32> = 0.002..=1.0;

/// Range of the HEALPix orders of the map that the settings accept.
pub const ORDERS: RangeInclusive<u8> = 4..=7;

/// Range of the relative threshold of the sampler `q2tree`, a ratio.
pub const THRESHOLDS: RangeInclusive<f32> = 0.0..=10.0;

/// Range of the filter length of the sampler `hemigon-fir`, frames.
pub const TAPS: RangeInclusive<usize> = 1..=fir::MAX_TAPS;

/// Range of the cut-off frequency of the sampler `hemigon-fir`, Hz: up to half of its assumed frame rate.
pub const CUTOFFS_HZ: RangeInclusive<f32> = 0.05..=5.0;

/// Parameters of individual samplers that are fixed when a sampler is made; the request of each frame has the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuning {
    /// Relative threshold of `q2tree` and `q2tree-jitter`, in [`THRESHOLDS`].
    pub threshold: f32,
    /// Filter length of `hemigon-fir`, frames, in [`TAPS`].
    pub taps: usize,
    /// Cut-off frequency of the filter of `hemigon-fir`, Hz, in [`CUTOFFS_HZ`].
    pub cutoff_hz: f32,
}

impl Default for Tuning {
    fn default() -> Self {
        let fir::Parameters { taps, cutoff_hz, .. } = fir::Parameters::default();
        Self { threshold: Parameters::CENTROID.threshold, taps, cutoff_hz: cutoff_hz as f32 }
    }
}

impl Tuning {
    /// Returns the parameters of the filter of `hemigon-fir`.
    #[must_use]
    pub fn fir(&self) -> fir::Parameters {
        fir::Parameters { taps: self.taps, cutoff_hz: self.cutoff_hz.into(), ..fir::Parameters::default() }
    }

    /// Returns the parameters that the sampler `kind` reads, and the defaults for all others.
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

/// Shape of the maps that a sampler reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Part of the sphere that the maps cover: all of it or the upper hemisphere.
    pub domain: Domain,
    /// Finest HEALPix order of the maps' pyramid.
    pub order: u8,
    /// Numbers of rows and columns of the latitude-longitude maps.
    pub grid: Grid,
}

/// Reasons for which a sampler cannot be made or cannot serve a request.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum SamplerError {
    /// The sampler does not support this number of lights.
    #[error("{found} lights, expected {least} to {MAX_LIGHTS} for '{sampler}'")]
    BadLights {
        /// Number of lights that was requested of the sampler.
        found: usize,
        /// The least number of lights that the sampler supports for such maps.
        least: usize,
        /// Kind of the requested sampler.
        sampler: SamplerKind,
    },
    /// The requested tolerance is outside of [`TOLERANCES`].
    #[error("tolerance {0}, expected 0.002 to 1 (0.03 is 3 per cent of shadowed error)")]
    BadTolerance(f32),
    /// The sampler estimates no error, which a tolerance and ambient light require.
    #[error("{what} with '{sampler}', expected 'adaptive', the only sampler that estimates its error")]
    NotModelled {
        /// The request that is refused: a tolerance or ambient light.
        what: &'static str,
        /// Kind of the requested sampler.
        sampler: SamplerKind,
    },
}

/// Returns the finest order of the map that `lights` lights need: 6, or 7 from 256 lights, where a small sun in one texel of order 6 would cause
/// most of the error.
#[must_use]
pub fn order_for(lights: usize) -> u8 {
    if lights < 256 { 6 } else { 7 }
}

/// Returns the order of the quads from which the polar map is computed: `order`, at most 6, at which a quad is as large as a texel; the share
/// table of order 7 would be four times as long.
#[must_use]
pub fn polar_order(order: u8) -> u8 {
    order.min(6)
}

/// Checks that the sampler `kind` supports the request on maps of `domain`.
///
/// # Errors
/// [`SamplerError`] for a number of lights, a tolerance or ambient light that the sampler does not support.
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

/// Makes the sampler `kind` for maps of `shape`, with memory for `lights` lights; `hemigon` and `hemigon-fir` return at most
/// [`hemigon::MAX_LIGHTS`].
///
/// # Errors
/// [`SamplerError`] for a number of lights or a shape that the sampler does not support.
pub fn make(
    kind: SamplerKind,
    shape: &Shape,
    lights: usize,
) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    make_tuned(kind, shape, lights, &Tuning::default())
}

/// Makes the sampler `kind` like [`make`], with the parameters `tuning`.
///
/// # Errors
/// [`SamplerError`] for a number of lights or a shape that the sampler does not support.
pub fn make_tuned(
    kind: SamplerKind,
    shape: &Shape,
    lights: usize,
    tuning: &Tuning,
) -> Result<Box<dyn Sampler + Send>, SamplerError> {
    let ambient = lights == 0 && kind.estimates_error();
    check(kind, shape.domain, &Request { ambient, ..Request::of_lights(lights) })?;
    let tree =
        |parameters| make_q2tree(Parameters { threshold: tuning.threshold, ..parameters }, shape, lights);
    let few = lights.min(hemigon::MAX_LIGHTS);
    Ok(match kind {
        SamplerKind::Adaptive => make_adaptive(shape, lights),
        SamplerKind::Q2Tree => tree(Parameters::CENTROID),
        SamplerKind::Q2TreeJitter => tree(Parameters::JITTER),
        SamplerKind::Pharr => make_pharr(shape, lights),
        SamplerKind::Hemigon => make_gated(shape, few),
        SamplerKind::HemigonFir => make_filtered(shape, few, &tuning.fir()),
    })
}

/// Lists the buffers of the sampler that [`make_tuned`] makes from the same arguments.
#[must_use]
pub fn buffers(kind: SamplerKind, shape: &Shape, lights: usize, tuning: &Tuning) -> Vec<BufferSize> {
    let Shape { domain, order, grid } = *shape;
    let order = Order::saturating(order);
    let few = lights.min(hemigon::MAX_LIGHTS);
    let filtered = |filter| [hemigon::Sizes::new(&grid, few).buffers().to_vec(), vec![filter]].concat();
    match kind {
        SamplerKind::Adaptive => adaptive::Sizes::new(domain, order, lights).buffers().to_vec(),
        SamplerKind::Q2Tree | SamplerKind::Q2TreeJitter => {
            q2tree::Sizes::new(domain, order, lights).buffers().to_vec()
        }
        SamplerKind::Pharr => pharr::Sizes::new(&grid, lights).buffers().to_vec(),
        SamplerKind::Hemigon => filtered(BufferSize::of::<PathFilter>("sampler: tracks", 2 * few)),
        SamplerKind::HemigonFir => {
            filtered(BufferSize::of::<glam::Vec3>("sampler: paths", fir::paths_len(&tuning.fir(), few)))
        }
    }
}

fn make_pharr(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let sizes = pharr::Sizes::new(&shape.grid, lights);
    let memory = pharr::Memory {
        conditional: vec![0.0; sizes.texels],
        marginal: vec![0.0; sizes.rows],
        lights: vec![Light::default(); sizes.lights],
    };
    Box::new(
        Pharr::try_new(&shape.grid, memory).expect("the buffers have the lengths that the sampler names"),
    )
}

fn make_q2tree(parameters: Parameters, shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let order = Order::saturating(shape.order);
    let sizes = q2tree::Sizes::new(shape.domain, order, lights);
    let bits = || vec![0u8; sizes.interior];
    let leaves = vec![q2tree::Leaf::default(); sizes.lights];
    let (lights, past) = (vec![Light::default(); sizes.lights], vec![Past::default(); sizes.lights]);
    let shape = MapShape { domain: shape.domain, order };
    let sampler = Q2Tree::try_new(parameters, shape, [bits(), bits()], leaves, lights, past);
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}

fn make_adaptive(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let order = Order::saturating(shape.order);
    let sizes = adaptive::Sizes::new(shape.domain, order, lights);
    let (bits, light) = (|| vec![0u8; sizes.interior], || vec![Light::default(); sizes.lights]);
    let tracks = || vec![LightFilter::default(); sizes.lights];
    let memory = adaptive::Memory {
        interior: [bits(), bits()],
        leaves: vec![adaptive::Leaf::default(); sizes.lights],
        lights: [light(), light()],
        tracks: [tracks(), tracks()],
        workspace: Box::new(adaptive::Workspace::new()),
    };
    let sampler = Adaptive::try_new(shape.domain, order, memory);
    Box::new(sampler.expect("the bit sets have the length that the tree names"))
}

fn make_gated(shape: &Shape, lights: usize) -> Box<dyn Sampler + Send> {
    let tracks = vec![PathFilter::default(); 2 * lights];
    let filter = Gated::try_new(kalman::Parameters::LIGHTS, lights, tracks);
    make_hemigon(shape, lights, filter.expect("two tracks per light"))
}

fn make_filtered(shape: &Shape, lights: usize, parameters: &fir::Parameters) -> Box<dyn Sampler + Send> {
    let paths = vec![glam::Vec3::ZERO; fir::paths_len(parameters, lights)];
    let filter = Fir::try_new(parameters, lights, paths);
    make_hemigon(shape, lights, filter.expect("two paths of as many directions as taps per light"))
}

fn make_hemigon<F: Follow + Send + 'static>(
    shape: &Shape,
    lights: usize,
    filter: F,
) -> Box<dyn Sampler + Send> {
    let sizes = hemigon::Sizes::new(&shape.grid, lights);
    let (conditional, rings) = (vec![0.0f32; sizes.texels], vec![Ring::default(); sizes.rings]);
    let inversion =
        Inversion::try_new(&shape.grid, conditional, rings).expect("memory for each texel and ring");
    let lights = vec![Light::default(); sizes.lights];
    let sampler = Hemigon::try_new(inversion, filter, vec![0; sizes.lives], lights);
    Box::new(sampler.expect("two slots per light"))
}
