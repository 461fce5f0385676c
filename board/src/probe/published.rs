//! Finished sets, in a ring of reused memory.

use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{Coordinates, Latency, LightSet, Overrun, Stale, Unit};
use std::sync::Arc;

/// A finished light set that owns its lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
    /// Counts from 0 in each run.
    pub frame: u64,
    /// CLOCK_MONOTONIC at the end of the burst.
    pub timestamp_ns: u64,
    /// Unix time when the set was finished.
    pub wall_ms: u64,
    /// The sampler's name.
    pub sampler: &'static str,
    /// Largest number of lights requested.
    pub requested: u32,
    /// The lights.
    pub lights: Vec<Light>,
    /// Radiance of the light that is not in `lights`, as spherical harmonics.
    pub ambient: Option<Sh9>,
    /// Sum of L dOmega.
    pub scalar_flux: [f32; 3],
    /// Sum of L cos(theta) dOmega.
    pub horizontal_irradiance: [f32; 3],
    /// Clipped share of the hemisphere.
    pub clipped: f32,
    /// Unseen share of the hemisphere.
    pub unseen: f32,
    /// The sampler's estimate.
    pub estimated_error: Option<f32>,
    /// Time spent in each stage.
    pub latency: Latency,
    /// The stages that took longer than their budgets.
    pub overrun: Overrun,
    /// Frames a second, smoothed; 0 until there are two.
    pub rate_hz: f32,
}

impl Published {
    /// As the encoders read it.
    #[must_use]
    pub fn on_wire<'a>(&'a self, run: &'a str, stale: Option<Stale<'a>>) -> LightSet<'a> {
        LightSet {
            run,
            frame: self.frame,
            timestamp_ns: self.timestamp_ns,
            wall_ms: self.wall_ms,
            valid: true,
            stale,
            sampler: self.sampler,
            requested: self.requested,
            unit: Unit::Relative,
            coordinates: Coordinates::Probe,
            lights: &self.lights,
            ambient_sh: None,
            left_out: None,
            scalar_flux: self.scalar_flux,
            horizontal_irradiance: self.horizontal_irradiance,
            clipped: self.clipped,
            unseen: self.unseen,
            estimated_error: self.estimated_error,
            latency: self.latency,
            overrun: self.overrun,
        }
    }

    /// A set without lights, with the values that every sampler shares for the frame of `set`.
    pub(super) fn of_frame(set: &Self) -> Self {
        let Self { frame, timestamp_ns, wall_ms, scalar_flux, horizontal_irradiance, .. } = *set;
        let Self { clipped, unseen, latency, rate_hz, .. } = *set;
        Self {
            frame,
            timestamp_ns,
            wall_ms,
            scalar_flux,
            horizontal_irradiance,
            clipped,
            unseen,
            latency,
            rate_hz,
            ..Self::default()
        }
    }
}

/// Number of sets in a ring: one is published, one is being filled, two are being encoded.
pub(super) const SETS: usize = 4;

/// Hands out sets to fill that have no reader.
#[derive(Debug)]
pub(super) struct Ring<T> {
    sets: [Arc<T>; SETS],
}

impl<T: Default> Ring<T> {
    pub(super) fn new(make: impl Fn() -> T) -> Self {
        Self { sets: std::array::from_fn(|_| Arc::new(make())) }
    }

    /// Fills a set that has no reader and hands it out; allocates one only when readers hold all of them.
    pub(super) fn fill(&mut self, fill: impl FnOnce(&mut T)) -> Arc<T> {
        let free = self.sets.iter_mut().position(|set| Arc::get_mut(set).is_some());
        let at = free.unwrap_or_else(|| {
            self.sets[0] = Arc::default();
            0
        });
        if let Some(set) = Arc::get_mut(&mut self.sets[at]) {
            fill(set);
        }
        Arc::clone(&self.sets[at])
    }
}

impl Ring<Published> {
    /// With room for `lights` lights in every set.
    pub(super) fn with_lights(lights: usize) -> Self {
        let mut ring = Self::new(Published::default);
        ring.reserve(lights);
        ring
    }

    /// Makes room for `lights` lights in every set. A set that is being read stays and is replaced when its turn comes.
    pub(super) fn reserve(&mut self, lights: usize) {
        for set in &mut self.sets {
            if set.lights.capacity() < lights {
                *set = Arc::new(Published { lights: Vec::with_capacity(lights), ..Published::default() });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_reused_and_a_held_one_is_not_overwritten() {
        let mut ring = Ring::with_lights(10);
        let held: Vec<_> = (0..SETS as u64).map(|n| ring.fill(|set| set.frame = n)).collect();
        let one_over = ring.fill(|set| set.frame = 99);
        let frames: Vec<_> = held.iter().map(|set| set.frame).collect();
        assert_eq!((frames, one_over.frame), (vec![0, 1, 2, 3], 99), "at capacity, and one over");
        let freed = Arc::as_ptr(&held[2]);
        drop(held);
        assert!(ring.sets.iter().any(|set| Arc::as_ptr(set) == freed), "it stays in the ring");
        let next = ring.fill(|set| set.frame = 100);
        assert!(ring.sets.iter().any(|set| Arc::ptr_eq(set, &next)), "memory goes round");
    }
}
