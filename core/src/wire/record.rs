//! The lights of one frame with their metadata.

use super::{Coordinates, Degraded, FramesLeftOut, Latency, Overrun, Unit};
use crate::light::{Light, Sh9};
use crate::mains::Flicker;
use core::borrow::Borrow;

/// Age of the last light set while no newer set exists, and the reason why none exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stale<Text> {
    /// Time since the set was computed, milliseconds.
    pub age_ms: u64,
    /// Reason why no newer set exists, one sentence.
    pub reason: Text,
}

impl<Text: AsRef<str>> Stale<Text> {
    /// Returns the age and the reason, whose text is borrowed.
    #[must_use]
    pub fn view(&self) -> Stale<&str> {
        Stale { age_ms: self.age_ms, reason: self.reason.as_ref() }
    }
}

/// The lights of one frame with their metadata.
///
/// The type parameters are the storage of the texts, of the lights and of the spherical harmonics: references in [`LightSet`], which the
/// encoders read; `String`, `Vec<Light>` and [`Sh9`] in a program that keeps sets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record<Text, Lights, Harmonics> {
    /// Identifier of the run of the program, different after every start.
    pub run: Text,
    /// Number of the frame, from 0 in each run.
    pub frame: u64,
    /// CLOCK_MONOTONIC at the end of the burst, nanoseconds.
    pub timestamp_ns: u64,
    /// Unix time of the set, milliseconds.
    pub wall_ms: u64,
    /// False in a set from before the first frame.
    pub valid: bool,
    /// Age of the set and reason why it is repeated, if no new burst arrives; otherwise `None`.
    pub stale: Option<Stale<Text>>,
    /// Name of the sampler that computed the lights.
    pub sampler: Text,
    /// Number of lights that was requested of the sampler.
    pub requested: u32,
    /// Unit of the set's irradiances.
    pub unit: Unit,
    /// Relative uncertainty of the unit with 95 % coverage, a ratio; `None` where the unit is relative.
    pub unit_uncertainty: Option<f32>,
    /// Coordinates to which the encoders convert directions and harmonics.
    pub coordinates: Coordinates,
    /// The lights, in the probe's axes.
    pub lights: Lights,
    /// Radiance that `lights` do not represent, as spherical harmonics in the probe's axes.
    pub ambient_sh: Option<Harmonics>,
    /// Scalar flux that neither `lights` nor `ambient_sh` represent ([`LightSet::missing_flux`]); `None` if it is below a thousandth of
    /// `scalar_flux`. The binary form omits it, since it can be computed from the other fields.
    pub left_out: Option<[f32; 3]>,
    /// Scalar flux, red, green and blue: radiance times solid angle, summed over the map.
    pub scalar_flux: [f32; 3],
    /// Horizontal irradiance, red, green and blue: radiance times cos(theta) times solid angle, summed above the horizon.
    pub horizontal_irradiance: [f32; 3],
    /// Lower bound of the horizontal irradiance of clipped light; part of `horizontal_irradiance`. Only in the JSON form.
    pub clipped_irradiance_at_least: [f32; 3],
    /// Fraction of the solid angle of the map's domain in which the shortest exposure is clipped, 0..=1.
    pub clipped: f32,
    /// Fraction of the solid angle of the map's domain outside of the field of view, 0..=1.
    pub unseen: f32,
    /// Estimated shadowed error of the set, a ratio; `None` for samplers without an estimate.
    pub estimated_error: Option<f32>,
    /// Duration of each stage of the frame, microseconds.
    pub latency: Latency,
    /// Stages of the frame that exceeded their budgets; only the JSON form contains them.
    pub overrun: Overrun,
    /// Frames of the burst that were not merged; only the JSON form contains them.
    pub frames_left_out: FramesLeftOut,
    /// Reductions relative to the settings that keep a frame within its budget; only the JSON form contains them.
    pub degraded: Degraded,
    /// Modulation by lamps on the mains that was removed from the map; only the JSON form contains it.
    pub flicker: Flicker,
}

/// A light set that borrows its texts, lights and harmonics: the input of the encoders.
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
pub type LightSet<'a> = Record<&'a str, &'a [Light], &'a Sh9>;

/// Creates a [`Record`] from the given fields that need storage, and the plain values of another record.
macro_rules! with_values_of {
    ($record:expr, { $($stored:ident: $value:expr,)* }) => {
        Record {
            $($stored: $value,)*
            frame: $record.frame,
            timestamp_ns: $record.timestamp_ns,
            wall_ms: $record.wall_ms,
            valid: $record.valid,
            requested: $record.requested,
            unit: $record.unit,
            unit_uncertainty: $record.unit_uncertainty,
            coordinates: $record.coordinates,
            left_out: $record.left_out,
            scalar_flux: $record.scalar_flux,
            horizontal_irradiance: $record.horizontal_irradiance,
            clipped_irradiance_at_least: $record.clipped_irradiance_at_least,
            clipped: $record.clipped,
            unseen: $record.unseen,
            estimated_error: $record.estimated_error,
            latency: $record.latency,
            overrun: $record.overrun,
            frames_left_out: $record.frames_left_out,
            degraded: $record.degraded,
            flicker: $record.flicker,
        }
    };
}

impl<Text: AsRef<str>, Lights: AsRef<[Light]>, Harmonics: Borrow<Sh9>> Record<Text, Lights, Harmonics> {
    /// Returns this record with borrowed texts, lights and harmonics.
    #[must_use]
    pub fn view(&self) -> LightSet<'_> {
        with_values_of!(self, {
            run: self.run.as_ref(),
            stale: self.stale.as_ref().map(Stale::view),
            sampler: self.sampler.as_ref(),
            lights: self.lights.as_ref(),
            ambient_sh: self.ambient_sh.as_ref().map(Borrow::borrow),
        })
    }
}

impl<Text, Lights, Harmonics> Record<Text, Lights, Harmonics> {
    /// Returns this record in other storage. `text` converts `run`, `sampler` and the reason of `stale`, in this order.
    #[must_use]
    pub fn map<T, L, H>(
        self,
        mut text: impl FnMut(Text) -> T,
        lights: impl FnOnce(Lights) -> L,
        harmonics: impl FnOnce(Harmonics) -> H,
    ) -> Record<T, L, H> {
        with_values_of!(self, {
            run: text(self.run),
            sampler: text(self.sampler),
            stale: self.stale.map(|stale| Stale { age_ms: stale.age_ms, reason: text(stale.reason) }),
            lights: lights(self.lights),
            ambient_sh: self.ambient_sh.map(harmonics),
        })
    }
}

impl LightSet<'_> {
    /// A light set without lights, for the time before the first frame.
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
        unit_uncertainty: None,
        coordinates: Coordinates::Probe,
        lights: &[],
        ambient_sh: None,
        left_out: None,
        scalar_flux: [0.0; 3],
        horizontal_irradiance: [0.0; 3],
        clipped_irradiance_at_least: [0.0; 3],
        clipped: 0.0,
        unseen: 0.0,
        estimated_error: None,
        latency: Latency { capture: 0, front: 0, pyramid: 0, sample: 0, filter: 0, encode: 0, total: 0 },
        overrun: Overrun::NONE,
        frames_left_out: FramesLeftOut::NONE,
        degraded: Degraded::NONE,
        flicker: Flicker::NONE,
    };
}

/// Largest missing fraction of the scalar flux that is not reported.
const SILENT: f32 = 1e-3;

impl LightSet<'_> {
    /// Returns the scalar flux from the upper hemisphere that neither `lights` nor `ambient_sh` represent: the value of [`LightSet::left_out`].
    #[must_use]
    pub fn missing_flux(&self) -> Option<[f32; 3]> {
        // The numbers are the integrals of the basis functions (0,0) and (1,0) over the hemisphere; those of the other functions are 0.
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
