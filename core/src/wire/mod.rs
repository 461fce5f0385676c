//! Encodings of a light set: JSON, plain text, XML and a compact binary form.
//!
//! The encoders write to any `embedded_io::Write` (a `&mut &mut [u8]`, for example) and allocate nothing. All values are absolute and
//! linear. Directions and harmonics are converted to the requested [`Coordinates`]. [`LightSet::EMPTY`] gives default values for the
//! fields that a program does not set. `board/FORMATS.md` lists the fields of every form.

mod binary;
mod coordinates;
mod decimal;
mod json;
mod text;
mod xml;
mod xr;

pub use binary::{BinarySet, DecodeError, binary};
pub use coordinates::Coordinates;
pub use json::json;
pub use text::text;
pub use xml::xml;
pub use xr::{Estimate, estimate};

use crate::light::{Light, Sh9};
use decimal::{decimal, whole};
use embedded_io::Write;

/// The unit of irradiances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unit {
    /// Proportional to lux by an unknown factor.
    #[default]
    Relative,
    /// Lux: the camera is photometrically calibrated.
    Lux,
}

impl Unit {
    /// The name in light sets.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Relative => "relative",
            Self::Lux => "lux",
        }
    }
}

/// The reason why a light set is out of date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stale<'a> {
    /// Milliseconds since the set was computed.
    pub age_ms: u64,
    /// What happened to the camera, for people to read.
    pub reason: &'a str,
}

/// Duration of each stage of one frame, microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// Waiting for the burst and copying it.
    pub capture: u32,
    /// Merge of the burst and accumulation in texels.
    pub front: u32,
    /// Conversion of sums to energy, and coarser orders of the map.
    pub pyramid: u32,
    /// The sampler.
    pub sample: u32,
    /// Temporal filters outside of the sampler.
    pub filter: u32,
    /// Encoding of the previous frame's set.
    pub encode: u32,
    /// From the end of the burst to the finished light set.
    pub total: u32,
}

/// Number of durations in [`Latency`].
pub const STAGES: usize = 7;

impl Latency {
    /// Names of the durations in light sets, in the order of the fields.
    pub const NAMES: [&str; STAGES] = ["capture", "front", "pyramid", "sample", "filter", "encode", "total"];

    /// The durations in the order of [`Self::NAMES`].
    #[must_use]
    pub const fn all(&self) -> [u32; STAGES] {
        [self.capture, self.front, self.pyramid, self.sample, self.filter, self.encode, self.total]
    }
}

/// The set of stages whose duration exceeds its budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrun(u8);

impl Overrun {
    /// No stage.
    pub const NONE: Self = Self(0);

    /// The stages of `latency` that exceed their budgets; both in microseconds.
    #[must_use]
    pub fn of(latency: &Latency, budgets_us: &[u32; STAGES]) -> Self {
        let over = latency.all().into_iter().zip(budgets_us).map(|(us, budget)| us > *budget);
        Self(over.enumerate().fold(0, |bits, (i, over)| bits | u8::from(over) << i))
    }

    /// Names of the stages, from [`Latency::NAMES`].
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Latency::NAMES
            .into_iter()
            .enumerate()
            .filter(move |(i, _)| self.0 >> i & 1 == 1)
            .map(|(_, name)| name)
    }
}

/// The lights of one frame with their metadata: the input of the encoders.
///
/// With a [`FrontEnd`](crate::FrontEnd) `front`, the [`Coverage`](crate::Coverage) of its last burst and the
/// [`Decomposition`](crate::Decomposition) of a sampler:
///
/// ```
/// use hemilux_core::wire::LightSet;
/// use hemilux_core::{Buffer, Coverage, Decomposition, FrontEnd};
///
/// fn set<'a>(front: &FrontEnd<impl Buffer<u64>>, seen: &Coverage, made: &'a Decomposition<'a>) -> LightSet<'a> {
///     LightSet {
///         valid: true,
///         sampler: "q2tree",
///         requested: 8,
///         lights: made.lights,
///         ambient_sh: made.ambient.as_ref(),
///         estimated_error: made.estimated_error,
///         scalar_flux: front.map().total().rgb(),
///         horizontal_irradiance: front.map().horizontal_irradiance(),
///         clipped: seen.clipped as f32,
///         unseen: seen.unseen as f32,
///         ..LightSet::EMPTY
///     }
/// }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSet<'a> {
    /// Identifier of the run of the program: differs after every start.
    pub run: &'a str,
    /// Number of the frame, from 0 in each run.
    pub frame: u64,
    /// CLOCK_MONOTONIC at the end of the burst, nanoseconds.
    pub timestamp_ns: u64,
    /// Unix time, milliseconds.
    pub wall_ms: u64,
    /// `false` before the first frame.
    pub valid: bool,
    /// Present if no new burst arrives and this is the last light set.
    pub stale: Option<Stale<'a>>,
    /// Name of the sampler.
    pub sampler: &'a str,
    /// Requested number of lights.
    pub requested: u32,
    /// Unit of the irradiances.
    pub unit: Unit,
    /// Coordinates to which the encoders convert directions and harmonics.
    pub coordinates: Coordinates,
    /// The lights, in the probe's axes.
    pub lights: &'a [Light],
    /// Radiance of the light that `lights` leave out, as spherical harmonics in the probe's axes.
    pub ambient_sh: Option<&'a Sh9>,
    /// Scalar flux that neither `lights` nor `ambient_sh` contain ([`LightSet::missing_flux`]); `None` if it is below a thousandth of
    /// `scalar_flux`. The binary form omits it, since it follows from the other fields.
    pub left_out: Option<[f32; 3]>,
    /// Scalar flux: radiance times solid angle, summed over the map.
    pub scalar_flux: [f32; 3],
    /// Horizontal irradiance: radiance times cos(theta) times solid angle, summed above the horizon.
    pub horizontal_irradiance: [f32; 3],
    /// Fraction of the domain's solid angle in which even the shortest exposure is clipped.
    pub clipped: f32,
    /// Fraction of the domain's solid angle outside of the field of view.
    pub unseen: f32,
    /// Estimated shadowed error, a ratio; `None` for samplers without an estimate.
    pub estimated_error: Option<f32>,
    /// Duration of each stage.
    pub latency: Latency,
    /// Stages over their budget; only the JSON form contains them.
    pub overrun: Overrun,
}

impl LightSet<'_> {
    /// A light set without lights, as before the first frame.
    pub const EMPTY: LightSet<'static> = LightSet {
        run: "",
        frame: 0,
        timestamp_ns: 0,
        wall_ms: 0,
        valid: false,
        stale: None,
        sampler: "",
        requested: 0,
        unit: Unit::Relative,
        coordinates: Coordinates::Probe,
        lights: &[],
        ambient_sh: None,
        left_out: None,
        scalar_flux: [0.0; 3],
        horizontal_irradiance: [0.0; 3],
        clipped: 0.0,
        unseen: 0.0,
        estimated_error: None,
        latency: Latency { capture: 0, front: 0, pyramid: 0, sample: 0, filter: 0, encode: 0, total: 0 },
        overrun: Overrun::NONE,
    };
}

/// Largest fraction of the scalar flux that is not reported as missing.
const SILENT: f32 = 1e-3;

impl LightSet<'_> {
    /// Scalar flux from the upper hemisphere that neither `lights` nor `ambient_sh` contain: the value of [`LightSet::left_out`].
    #[must_use]
    pub fn missing_flux(&self) -> Option<[f32; 3]> {
        // Integrals of the basis functions (0,0) and (1,0) over the hemisphere; those of the others are 0.
        const CONSTANT: f64 = 1.772_453_850_905_516;
        const LINEAR: f64 = 1.534_990_061_919_733;
        let missing: [f64; 3] = core::array::from_fn(|c| {
            let lights: f64 = self.lights.iter().map(|light| f64::from(light.irradiance[c])).sum();
            let ambient = self
                .ambient_sh
                .map_or(0.0, |sh| CONSTANT * f64::from(sh[0][c]) + LINEAR * f64::from(sh[2][c]));
            f64::from(self.scalar_flux[c]) - lights - ambient
        });
        let most = self.scalar_flux.iter().fold(0.0f32, |most, v| most.max(*v));
        let is_silent = missing.iter().all(|v| v.abs() <= f64::from(SILENT * most));
        (!is_silent).then(|| missing.map(|v| v as f32))
    }
}

/// `v`, or 0 if it is not finite: the encoded forms hold finite numbers only.
fn number(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// Writes numbers with a `separator` between them.
fn numbers<W: Write>(w: &mut W, values: &[f32], separator: &str) -> Result<(), W::Error> {
    for (i, v) in values.iter().enumerate() {
        put(w, if i == 0 { "" } else { separator })?;
        decimal(w, *v)?;
    }
    Ok(())
}

/// Writes a string without escaping.
fn put<W: Write>(w: &mut W, words: &str) -> Result<(), W::Error> {
    w.write_all(words.as_bytes())
}
