//! The published filters of `hemigon-fir`: finite impulse responses over the total energy and over the path of each light.
//!
//! ```
//! use glam::Vec3;
//! use hemilux_core::sampler::hemigon::fir::{Fir, Kernel, Parameters, paths_len};
//!
//! let parameters = Parameters { taps: 5, cutoff_hz: 2.0, frame_rate_hz: 10.0 };
//! let sum: f64 = Kernel::new(&parameters).weights().iter().sum();
//! assert!((sum - 1.0).abs() < 1e-12);
//! // The filter of a sampler with 8 lights: 5 directions for each of two slots per light.
//! let filter = Fir::try_new(&parameters, 8, vec![Vec3::Z; paths_len(&parameters, 8)])?;
//! # Ok::<(), hemilux_core::TooSmall>(())
//! ```

use super::follow::{Follow, PathPoint};
use crate::buffer::{self, Buffer, TooSmall};
use crate::sampler::SamplerKind;
use core::f64::consts::PI;
use glam::Vec3;

/// Largest number of taps of a filter.
pub const MAX_TAPS: usize = 63;

/// Parameters of the low-pass filters of `hemigon-fir`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Number of frames in the filter's window, 1 to [`MAX_TAPS`] (clamped); 1 disables the filter.
    pub taps: usize,
    /// Cut-off frequency of the filter, hertz.
    pub cutoff_hz: f64,
    /// Assumed frame rate, frames per second.
    pub frame_rate_hz: f64,
}

impl Default for Parameters {
    /// Returns seven taps, cut-off 1 Hz, 10 frames per second: a delay of 0.3 s. The publications do not state these parameters.
    fn default() -> Self {
        Self { taps: 7, cutoff_hz: 1.0, frame_rate_hz: 10.0 }
    }
}

/// The coefficients of a low-pass filter, newest frame first.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    weights: heapless::Vec<f64, MAX_TAPS>,
}

impl Kernel {
    /// Computes the coefficients as a sinc under a Hamming window, normalised to a sum of 1: `h(k) = w(k) sinc(2 fc (k - (M - 1) / 2) /
    /// fs)`.
    #[must_use]
    pub fn new(parameters: &Parameters) -> Self {
        let taps = parameters.taps.clamp(1, MAX_TAPS);
        let last = (taps - 1) as f64;
        let step = 2.0 * parameters.cutoff_hz / parameters.frame_rate_hz;
        let weight = |k: usize| {
            let k = k as f64;
            let window = if taps > 1 { 0.54 - 0.46 * libm::cos(2.0 * PI * k / last) } else { 1.0 };
            window * sinc(step * (k - last / 2.0))
        };
        let mut weights: heapless::Vec<f64, MAX_TAPS> = (0..taps).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        if sum.is_finite() && sum.abs() > 1e-6 {
            weights.iter_mut().for_each(|w| *w /= sum);
        } else {
            weights = core::iter::once(1.0).collect();
        }
        Self { weights }
    }

    /// Returns the coefficients of the filter, newest frame first.
    #[must_use]
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

/// Returns sin(pi x) / (pi x), 1 at 0.
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(PI * x) / (PI * x) }
}

/// Returns the number of elements of the buffer of [`Fir::try_new`] for `lights` lights.
#[must_use]
pub fn paths_len(parameters: &Parameters, lights: usize) -> usize {
    Kernel::new(parameters).weights().len().saturating_mul(2).saturating_mul(lights)
}

/// The filters of `hemigon-fir`. `P` holds [`paths_len`] directions: a ring buffer of the last directions for each of two slots per light.
///
/// The length of a ring is the number of taps, which is set at run time; the length of `heapless::HistoryBuf` is constant at compile time.
#[derive(Clone, Debug)]
pub struct Fir<P> {
    kernel: Kernel,
    paths: P,
    /// Total energy of the map in each of the last frames, in a ring buffer.
    totals: [[f64; 3]; MAX_TAPS],
    /// Index of the newest frame in the ring buffers.
    head: usize,
    /// Whether a frame has been processed since the last reset.
    begun: bool,
}

impl<P: Buffer<Vec3>> Fir<P> {
    /// Creates the filters for a sampler with `lights` lights. [`paths_len`] returns the length of `paths`.
    ///
    /// # Errors
    /// [`TooSmall`] if `paths` has too few elements.
    pub fn try_new(parameters: &Parameters, lights: usize, paths: P) -> Result<Self, TooSmall> {
        let kernel = Kernel::new(parameters);
        buffer::check(&paths, paths_len(parameters, lights))?;
        Ok(Self { kernel, paths, totals: [[0.0; 3]; MAX_TAPS], head: 0, begun: false })
    }

    /// Returns weight and ring index of each frame in the window, the newest first.
    fn frames(&self) -> impl Iterator<Item = (f64, usize)> {
        let (head, taps) = (self.head, self.kernel.weights.len());
        self.kernel.weights().iter().enumerate().map(move |(k, w)| (*w, (head + taps - k) % taps))
    }
}

impl<P: Buffer<Vec3>> Follow for Fir<P> {
    const KIND: SamplerKind = SamplerKind::HemigonFir;

    fn slots(&self) -> usize {
        self.paths.as_ref().len() / self.kernel.weights.len()
    }

    fn begin(&mut self, _: bool) {
        self.head = (self.head + 1) % self.kernel.weights.len();
    }

    fn total(&mut self, total: [f64; 3]) -> [f64; 3] {
        if !self.begun {
            self.totals = [total; MAX_TAPS];
            self.begun = true;
        }
        self.totals[self.head] = total;
        let mut sum = [0.0; 3];
        for (weight, at) in self.frames() {
            for (s, v) in sum.iter_mut().zip(self.totals[at]) {
                *s += weight * v;
            }
        }
        // Side lobes of the filter make the sum negative after light is switched off.
        sum.map(|v| v.max(0.0))
    }

    fn follow(&mut self, slot: usize, is_new: bool, seen: PathPoint) -> PathPoint {
        let taps = self.kernel.weights.len();
        let Some(path) = self.paths.as_mut().get_mut(slot * taps..(slot + 1) * taps) else { return seen };
        if is_new {
            path.fill(seen.direction);
        }
        path[self.head] = seen.direction;
        let path = &self.paths.as_ref()[slot * taps..(slot + 1) * taps];
        let mut mean: Vec3 = self.frames().map(|(weight, at)| path[at] * weight as f32).sum();
        if mean.z * seen.direction.z < 0.0 {
            // Side lobes of the filter overshoot across the horizon: the filtered direction is limited to the hemisphere of the measured
            // one.
            mean.z = 0.0;
        }
        PathPoint { direction: mean.try_normalize().unwrap_or(seen.direction), ..seen }
    }

    fn reset(&mut self) {
        self.begun = false;
    }
}
