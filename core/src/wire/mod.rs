//! The bytes of a light set: JSON, plain text, XML and a compact binary form, written through `embedded-io` without allocation.
//!
//! All values are absolute and linear. Directions and harmonics are turned to the asked-for axes on the way out.

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

/// What a light's numbers are in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unit {
    /// Proportional to lux, with an unknown factor.
    #[default]
    Relative,
    /// Photometrically calibrated.
    Lux,
}

impl Unit {
    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Relative => "relative",
            Self::Lux => "lux",
        }
    }
}

/// Why a set is not fresh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stale<'a> {
    /// Milliseconds since the set was made.
    pub age_ms: u64,
    /// What happened to the source.
    pub reason: &'a str,
}

/// Time spent in each stage of one frame, microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// Waiting for and copying the burst.
    pub capture: u32,
    /// Merge and map in one.
    pub front: u32,
    /// Sums above the map.
    pub pyramid: u32,
    /// The sampler.
    pub sample: u32,
    /// Temporal filters outside the sampler.
    pub filter: u32,
    /// Encoding of the previous frame's set.
    pub encode: u32,
    /// From the end of the burst to the finished set.
    pub total: u32,
}

/// How many times [`Latency`] holds.
pub const STAGES: usize = 7;

impl Latency {
    /// Names of the times on the wire, in their order everywhere.
    pub const NAMES: [&str; STAGES] = ["capture", "front", "pyramid", "sample", "filter", "encode", "total"];

    /// The times in the order of [`Self::NAMES`].
    #[must_use]
    pub const fn all(&self) -> [u32; STAGES] {
        [self.capture, self.front, self.pyramid, self.sample, self.filter, self.encode, self.total]
    }
}

/// Which of the times of a [`Latency`] were longer than their budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrun(u8);

impl Overrun {
    /// None of them.
    pub const NONE: Self = Self(0);

    /// Those of `latency` that are longer than their budget, both in microseconds.
    #[must_use]
    pub fn of(latency: &Latency, budgets_us: &[u32; STAGES]) -> Self {
        let over = latency.all().into_iter().zip(budgets_us).map(|(us, budget)| us > *budget);
        Self(over.enumerate().fold(0, |bits, (i, over)| bits | u8::from(over) << i))
    }

    /// Their names.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Latency::NAMES
            .into_iter()
            .enumerate()
            .filter(move |(i, _)| self.0 >> i & 1 == 1)
            .map(|(_, name)| name)
    }
}

/// One frame's lights and what is known about them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSet<'a> {
    /// Changes at every start of the probe.
    pub run: &'a str,
    /// Counts from 0 in each run.
    pub frame: u64,
    /// CLOCK_MONOTONIC at the end of the burst, nanoseconds.
    pub timestamp_ns: u64,
    /// Unix time, milliseconds.
    pub wall_ms: u64,
    /// False before the first frame.
    pub valid: bool,
    /// Set when the source has stopped and this is the last good set.
    pub stale: Option<Stale<'a>>,
    /// The sampler's name.
    pub sampler: &'a str,
    /// Lights asked for.
    pub requested: u32,
    /// What the numbers are in.
    pub unit: Unit,
    /// Axes of the directions.
    pub coordinates: Coordinates,
    /// The lights, in probe axes.
    pub lights: &'a [Light],
    /// Radiance of what is not in `lights`, in probe axes.
    pub ambient_sh: Option<&'a Sh9>,
    /// Scalar flux that is neither in `lights` nor in `ambient_sh`; `None` where it is less than a thousandth of `scalar_flux`. The binary
    /// form leaves it out: it follows from the other numbers.
    pub left_out: Option<[f32; 3]>,
    /// Sum of L dOmega over everything.
    pub scalar_flux: [f32; 3],
    /// Sum of L cos(theta) dOmega above the horizon.
    pub horizontal_irradiance: [f32; 3],
    /// Clipped share of the domain's solid angle.
    pub clipped: f32,
    /// Unseen share of the domain's solid angle.
    pub unseen: f32,
    /// Estimated shadowed error, a ratio.
    pub estimated_error: Option<f32>,
    /// Time spent in each stage.
    pub latency: Latency,
    /// Which of the times were over budget; in JSON alone.
    pub overrun: Overrun,
}

impl LightSet<'_> {
    /// The set before the first frame.
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

/// Largest share of the scalar flux that a set may lack without a word.
const SILENT: f32 = 1e-3;

impl LightSet<'_> {
    /// The scalar flux over the upper hemisphere that `lights` and `ambient_sh` do not hold, for [`LightSet::left_out`].
    #[must_use]
    pub fn missing_flux(&self) -> Option<[f32; 3]> {
        // Integrals over the hemisphere of the basis functions (0,0) and (1,0); those of the others are 0.
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

/// A number as the formats hold it: what is not finite becomes 0, which no stage produces.
fn number(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// Writes numbers with `separator` between them.
fn numbers<W: Write>(w: &mut W, values: &[f32], separator: &str) -> Result<(), W::Error> {
    for (i, v) in values.iter().enumerate() {
        put(w, if i == 0 { "" } else { separator })?;
        decimal(w, *v)?;
    }
    Ok(())
}

/// Writes words as they are.
fn put<W: Write>(w: &mut W, words: &str) -> Result<(), W::Error> {
    w.write_all(words.as_bytes())
}
