//! Encodings of a light set: JSON, plain text, XML and a compact binary form.
//!
//! The encoders write to any `embedded_io::Write` (a `&mut &mut [u8]`, for example) and allocate no memory. All values are absolute and
//! linear. Directions and harmonics are converted to the requested [`Coordinates`]. [`LightSet::EMPTY`] holds default values for the
//! fields that a program does not set. `board/FORMATS.md` lists the fields of every form.

mod binary;
mod coordinates;
mod decimal;
mod degraded;
mod frames;
mod json;
mod record;
mod text;
mod xml;
mod xr;

pub use binary::{BinarySet, DecodeError, binary};
pub use coordinates::Coordinates;
pub use degraded::{Degraded, Step};
pub use frames::{FrameFault, FrameLeftOut, FramesLeftOut};
pub use json::json;
pub use record::{LightSet, Record, Stale};
pub use text::text;
pub use xml::xml;
pub use xr::{Estimate, estimate};

use decimal::{decimal, whole};
use embedded_io::Write;

/// The unit of the irradiances in a light set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unit {
    /// Irradiances are proportional to lux by an unknown factor.
    #[default]
    Relative,
    /// Irradiances are in lux: the camera is photometrically calibrated.
    Lux,
}

impl Unit {
    /// Returns the name of the unit in light sets.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Relative => "relative",
            Self::Lux => "lux",
        }
    }
}

/// Duration of each stage of one frame, microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// Duration of the wait for the burst and of its copy, microseconds.
    pub capture: u32,
    /// Duration of the merge of the burst and of the accumulation in texels, microseconds.
    pub front: u32,
    /// Duration of the conversion of sums to energy and of the coarser orders of the map, microseconds.
    pub pyramid: u32,
    /// Duration of the sampler without its temporal filters, microseconds.
    pub sample: u32,
    /// Duration of the temporal filters of the sampler, microseconds.
    pub filter: u32,
    /// Duration of the encoding of the previous frame's set, microseconds.
    pub encode: u32,
    /// Time from the end of the burst to the finished light set, microseconds.
    pub total: u32,
}

/// Number of durations of stages in [`Latency`].
pub const STAGES: usize = 7;

impl Latency {
    /// Names of the durations in light sets, in the order of the fields.
    pub const NAMES: [&str; STAGES] = ["capture", "front", "pyramid", "sample", "filter", "encode", "total"];

    /// Returns the durations, microseconds, in the order of [`Self::NAMES`].
    #[must_use]
    pub const fn all(&self) -> [u32; STAGES] {
        [self.capture, self.front, self.pyramid, self.sample, self.filter, self.encode, self.total]
    }
}

/// The stages of a frame whose durations exceed their budgets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrun(u8);

impl Overrun {
    /// The value for a frame without such a stage.
    pub const NONE: Self = Self(0);

    /// Returns the stages of `latency` that exceed their budgets; both in microseconds.
    #[must_use]
    pub fn of(latency: &Latency, budgets_us: &[u32; STAGES]) -> Self {
        let over = latency.all().into_iter().zip(budgets_us).map(|(us, budget)| us > *budget);
        Self(over.enumerate().fold(0, |bits, (i, over)| bits | u8::from(over) << i))
    }

    /// Returns the names of the stages that exceed their budgets, from [`Latency::NAMES`].
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Latency::NAMES
            .into_iter()
            .enumerate()
            .filter(move |(i, _)| self.0 >> i & 1 == 1)
            .map(|(_, name)| name)
    }
}

/// Returns `v`, or 0 if it is not finite: the encoded forms hold finite numbers only.
fn number(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

/// Writes the numbers `values` with a `separator` between them.
fn numbers<W: Write>(w: &mut W, values: &[f32], separator: &str) -> Result<(), W::Error> {
    for (i, v) in values.iter().enumerate() {
        put(w, if i == 0 { "" } else { separator })?;
        decimal(w, *v)?;
    }
    Ok(())
}

/// Writes the string `words` without escaping.
fn put<W: Write>(w: &mut W, words: &str) -> Result<(), W::Error> {
    w.write_all(words.as_bytes())
}
