//! A light set in the client's memory.

use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{BinarySet, Coordinates, Unit};

/// One frame's lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Set {
    /// Changes at every start of the probe.
    pub run: String,
    /// Counts from 0 in each run.
    pub frame: u64,
    /// The probe's CLOCK_MONOTONIC at the end of the burst.
    pub timestamp_ns: u64,
    /// The probe's Unix time.
    pub wall_ms: u64,
    /// Age in milliseconds and reason, when the source has stopped and this is the last good set.
    pub stale: Option<(u64, String)>,
    /// The sampler's name.
    pub sampler: String,
    /// What the numbers are in.
    pub unit: Unit,
    /// Axes of the directions.
    pub coordinates: Coordinates,
    /// The lights.
    pub lights: Vec<Light>,
    /// Radiance of what is not in the lights, if it was asked for and the sampler gives it.
    pub ambient_sh: Option<Sh9>,
    /// Sum of L dOmega over everything.
    pub scalar_flux: [f32; 3],
    /// Sum of L cos(theta) dOmega.
    pub horizontal_irradiance: [f32; 3],
    /// Clipped share of the hemisphere.
    pub clipped: f32,
    /// Unseen share of the hemisphere.
    pub unseen: f32,
    /// The sampler's estimate of its error, a ratio.
    pub estimated_error: Option<f32>,
    /// Ids and places in `lights`, by id.
    pub(super) places: Vec<(u32, u32)>,
}

impl Set {
    /// Becomes what `bytes` say; memory is used again.
    pub(super) fn read(&mut self, bytes: &BinarySet<'_>) {
        let head = bytes.head();
        replace(&mut self.run, head.run);
        replace(&mut self.sampler, head.sampler);
        self.frame = head.frame;
        self.timestamp_ns = head.timestamp_ns;
        self.wall_ms = head.wall_ms;
        self.stale = head.stale.map(|s| (s.age_ms, s.reason.into()));
        self.unit = head.unit;
        self.coordinates = head.coordinates;
        self.lights.clear();
        self.lights.extend(bytes.lights());
        self.ambient_sh = bytes.ambient_sh();
        self.scalar_flux = head.scalar_flux;
        self.horizontal_irradiance = head.horizontal_irradiance;
        self.clipped = head.clipped;
        self.unseen = head.unseen;
        self.estimated_error = head.estimated_error;
        self.places.clear();
        self.places.extend(self.lights.iter().map(|l| l.id).zip(0..));
        self.places.sort_unstable();
    }

    /// The light called `id`.
    #[must_use]
    pub fn light(&self, id: u32) -> Option<&Light> {
        let at = self.places.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        self.lights.get(self.places[at].1 as usize)
    }
}

fn replace(text: &mut String, new: &str) {
    text.clear();
    text.push_str(new);
}
