//! Tiers: additional light sets per frame, for clients that request fewer lights than the probe's own set has, another choice of ambient light,
//! or another choice between points and discs.
//!
//! A tier is a sampler with a state of its own that runs once per frame while clients request its sets, so that ids and filters persist from
//! frame to frame. A setting bounds the number of tiers ([`MOST`]): a request beyond it is served by a tier of fewer lights, never by one of
//! more. The work per frame is therefore bounded, whatever clients request.

use super::lock;
use super::made_for::MadeFor;
use super::ring::Ring;
use crate::light_set::{self, OwnedSet};
use crate::pipeline::{Pipeline, Settings};
use crate::samplers;
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use hemilux_core::sampler::{Request, Sampler};
use hemilux_core::wire::{Latency, LightSet, Overrun};
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Range of the largest number of tiers. Four tiers, one for each combination of ambient light or none with discs or points, are the fewest
/// that serve every request.
pub const MOST: RangeInclusive<usize> = CLASSES.len()..=16;

/// Default of the largest number of tiers: at 64 lights each adds at most 0.2 ms per frame on x86-64.
pub const USUAL: usize = 6;

/// Largest number of lights of a tier's set; requests for more lights that the probe's own set does not serve are answered
/// with this number.
pub const MOST_LIGHTS: usize = 2048;

/// Time without a request after which a tier is dropped, provided that [`KEPT_FRAMES`] frames have passed as well.
const KEPT: Duration = Duration::from_secs(3);

/// Number of frames without a request for which a tier is kept at least: exposures may last longer than
/// [`KEPT`].
const KEPT_FRAMES: u64 = 3;

/// The contents of a light set that a client requests: number of lights, ambient light, discs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Selection {
    /// Largest number of lights of the set; `None` for the number of the probe's own set.
    pub lights: Option<usize>,
    /// True if the set has diffuse light as spherical harmonics; `None` for the probe's own setting.
    pub ambient: Option<bool>,
    /// True if the lights of the set are fitted as discs; `None` for the probe's own setting.
    pub soft: Option<bool>,
}

impl Selection {
    /// The selection of the probe's own set.
    pub const OWN: Self = Self { lights: None, ambient: None, soft: None };
}

/// The contents of the light sets of a tier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tier {
    /// Largest number of lights of a set of the tier.
    pub lights: usize,
    /// True if the sets of the tier have diffuse light as spherical harmonics.
    pub ambient: bool,
    /// True if the lights of the tier are fitted as discs.
    pub soft: bool,
}

/// The properties of a tier besides the number of lights: a tier serves requests of its own class alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Class {
    ambient: bool,
    soft: bool,
}

/// All classes of tiers: with and without ambient light, of points and of discs.
const CLASSES: [Class; 4] = [
    Class { ambient: false, soft: false },
    Class { ambient: false, soft: true },
    Class { ambient: true, soft: false },
    Class { ambient: true, soft: true },
];

impl Tier {
    fn class(self) -> Class {
        Class { ambient: self.ambient, soft: self.soft }
    }
}

/// A tier with the time and the frame number of its last request.
#[derive(Clone, Copy, Debug)]
struct RequestedTier {
    tier: Tier,
    at: Instant,
    frame: u64,
}

#[derive(Debug)]
struct Table {
    most: usize,
    /// The contents of the light sets of the probe's own sampler.
    own: Tier,
    frame: u64,
    requested: Vec<RequestedTier>,
    /// The tiers' light sets of the newest frame.
    sets: Vec<(Tier, Arc<OwnedSet>)>,
}

/// The tiers that clients request, and their newest light sets.
#[derive(Debug)]
pub struct Tiers(Mutex<Table>);

impl Tiers {
    pub(super) fn new(settings: &Settings, most: usize) -> Self {
        let own = own(settings);
        let (requested, sets) = (Vec::with_capacity(*MOST.end()), Vec::with_capacity(*MOST.end()));
        Self(Mutex::new(Table { most: clamp(most), own, frame: 0, requested, sets }))
    }

    /// Requests light sets of `selection` for the next frames and returns the newest set of the tier that
    /// serves it, if there is one.
    #[must_use]
    pub fn request(&self, selection: Selection) -> Served {
        let mut table = lock(&self.0);
        match table.assign(selection) {
            None => Served::Own,
            Some(tier) => table
                .sets
                .iter()
                .find(|(t, _)| *t == tier)
                .map_or(Served::NotYet(tier), |(_, set)| Served::Set(Arc::clone(set))),
        }
    }

    /// Returns the selection that the tier serving `selection` has: it is equal for all requests that share the
    /// tier.
    #[must_use]
    pub fn resolve(&self, selection: Selection) -> Selection {
        let mut table = lock(&self.0);
        let tier = table.assign(selection);
        let Class { ambient, soft } = tier.unwrap_or(table.own).class();
        Selection { lights: tier.map(|tier| tier.lights), ambient: Some(ambient), soft: Some(soft) }
    }

    /// Returns the tiers that clients have requested recently.
    #[must_use]
    pub fn in_use(&self) -> Vec<Tier> {
        lock(&self.0).requested.iter().map(|r| r.tier).collect()
    }

    /// Returns the largest number of tiers that the settings allow.
    #[must_use]
    pub fn most(&self) -> usize {
        lock(&self.0).most
    }

    /// Adopts changed settings of the probe and removes the light sets that were made with the earlier
    /// settings.
    pub(super) fn follow(&self, settings: &Settings, most: usize) {
        let mut table = lock(&self.0);
        (table.own, table.most) = (own(settings), clamp(most));
        let own = table.own;
        table.requested.retain(|r| r.tier != own && r.tier.lights <= own.lights.max(1));
        let most = table.most;
        table.requested.truncate(most);
        table.sets.clear();
    }

    /// Drops the tiers without recent requests, and calls `each` for every other tier.
    fn frame(&self, mut each: impl FnMut(Tier)) {
        let mut table = lock(&self.0);
        table.frame += 1;
        let frame = table.frame;
        table.requested.retain(|r| r.at.elapsed() < KEPT || frame - r.frame <= KEPT_FRAMES);
        table.requested.iter().for_each(|r| each(r.tier));
    }

    fn publish(&self, sets: impl Iterator<Item = (Tier, Arc<OwnedSet>)>) {
        let mut table = lock(&self.0);
        table.sets.clear();
        table.sets.extend(sets);
    }
}

/// The answer to a request for light sets of a selection.
#[derive(Clone, Debug)]
pub enum Served {
    /// The probe's own light set answers the request.
    Own,
    /// The newest light set of the tier that serves the request.
    Set(Arc<OwnedSet>),
    /// The tier has no set yet; its first one is published with one of the next frames.
    NotYet(Tier),
}

impl Table {
    /// Returns the tier that serves `selection`; `None` if the probe's own set serves it. A new tier is created while the number of
    /// tiers is below the limit.
    fn assign(&mut self, selection: Selection) -> Option<Tier> {
        let ambient = selection.ambient.unwrap_or(self.own.ambient);
        let soft = selection.soft.unwrap_or(self.own.soft);
        // A set with ambient light may have no directional light; without ambient light, at least one light carries the energy.
        let most = self.own.lights.max(usize::from(!ambient));
        let lights = selection.lights.unwrap_or(most).min(most);
        if (Tier { lights, ambient, soft }) == self.own {
            return None;
        }
        let wanted = Tier { lights: lights.min(MOST_LIGHTS), ambient, soft };
        let (at, frame) = (Instant::now(), self.frame);
        let is_new = !self.requested.iter().any(|r| r.tier == wanted);
        if is_new && self.has_room(wanted.class()) {
            self.requested.push(RequestedTier { tier: wanted, at, frame });
        } else if is_new && !self.requested.iter().any(|r| serves(r.tier, wanted)) {
            // No tier of this class has few enough lights: the one with the fewest lights is reduced, for all
            // of its clients.
            let class = self.requested.iter_mut().filter(|r| r.tier.class() == wanted.class());
            if let Some(smallest) = class.min_by_key(|r| r.tier.lights) {
                smallest.tier = wanted;
            }
        }
        let fitting = self.requested.iter_mut().filter(|r| serves(r.tier, wanted));
        let best = fitting.max_by_key(|r| r.tier.lights)?;
        (best.at, best.frame) = (at, frame);
        Some(best.tier)
    }

    /// Returns true if a tier of `class` can be added within the limit on tiers, one of which is reserved for
    /// each other class without a tier.
    fn has_room(&self, class: Class) -> bool {
        let is_missing = |other: &&Class| self.requested.iter().all(|r| r.tier.class() != **other);
        let kept = CLASSES.iter().filter(|other| **other != class).filter(is_missing).count();
        self.requested.len() + kept < self.most
    }
}

/// Returns true if a set of `tier` has at most as many lights as `wanted` and is of the same class.
fn serves(tier: Tier, wanted: Tier) -> bool {
    tier.class() == wanted.class() && tier.lights <= wanted.lights
}

fn own(settings: &Settings) -> Tier {
    let soft = settings.soft && settings.sampler.estimates_error();
    Tier { lights: settings.lights, ambient: settings.ambient, soft }
}

fn clamp(most: usize) -> usize {
    most.clamp(*MOST.start(), *MOST.end())
}

/// The samplers of all tiers, which the processing thread runs.
#[derive(Default)]
pub(super) struct TierSamplers {
    running: Vec<RunningTier>,
    wanted: Vec<Tier>,
}

struct RunningTier {
    tier: Tier,
    kind: SamplerKind,
    made_for: MadeFor,
    sampler: Box<dyn Sampler + Send>,
    ring: Ring<OwnedSet>,
    set: Option<Arc<OwnedSet>>,
}

impl TierSamplers {
    /// Samples the last burst for each requested tier and publishes the tier's set; `own` is the probe's own
    /// set of the frame.
    pub(super) fn sample(&mut self, tiers: &Tiers, pipeline: &mut Pipeline, own: &OwnedSet) {
        self.wanted.clear();
        tiers.frame(|tier| self.wanted.push(tier));
        let wanted = &self.wanted;
        self.running.retain(|r| wanted.contains(&r.tier) && r.is_made_for(pipeline));
        for tier in wanted {
            if !self.running.iter().any(|r| r.tier == *tier) {
                match RunningTier::new(*tier, pipeline) {
                    Ok(running) => self.running.push(running),
                    Err(error) => tracing::warn!("a set of {} lights: found {error}", tier.lights),
                }
            }
        }
        self.running.iter_mut().for_each(|running| running.sample(pipeline, own));
        tiers.publish(self.running.iter().filter_map(|r| Some((r.tier, Arc::clone(r.set.as_ref()?)))));
    }
}

impl RunningTier {
    fn new(tier: Tier, pipeline: &Pipeline) -> Result<Self, samplers::SamplerError> {
        let kind = kind(tier, pipeline.settings());
        let tuning = pipeline.settings().tuning;
        let sampler = samplers::make_tuned(kind, &pipeline.shape(), tier.lights, &tuning)?;
        let made_for = MadeFor::now(pipeline, kind);
        Ok(Self { tier, kind, made_for, sampler, ring: Ring::with_lights(tier.lights), set: None })
    }

    fn is_made_for(&self, pipeline: &Pipeline) -> bool {
        let settings = pipeline.settings();
        self.kind == kind(self.tier, settings) && self.made_for == MadeFor::now(pipeline, self.kind)
    }

    fn sample(&mut self, pipeline: &mut Pipeline, own: &OwnedSet) {
        let Tier { lights, ambient, soft } = self.tier;
        let tolerance = pipeline.settings().tolerance.filter(|_| self.kind.estimates_error());
        let request = Request { tolerance, ambient, soft, ..Request::of_lights(lights) };
        let sampled = pipeline.sample_again(self.sampler.as_mut(), &request);
        let made = sampled.decomposition;
        let latency = Latency { total: own.latency.total, ..sampled.latency(&own.latency) };
        self.set = Some(self.ring.fill(|set| {
            let tier = LightSet {
                sampler: self.kind.name(),
                requested: u32::try_from(lights).unwrap_or(u32::MAX),
                lights: made.lights,
                ambient_sh: made.ambient.as_ref(),
                estimated_error: made.estimated_error,
                latency,
                overrun: Overrun::NONE,
                ..own.view()
            };
            light_set::copy(&tier, set);
        }));
    }
}

/// Returns the kind of sampler of a tier: the probe's own kind, or `adaptive` where the probe's sampler needs more lights than the tier has, has
/// no ambient light or fits no discs.
fn kind(tier: Tier, settings: &Settings) -> SamplerKind {
    let own = settings.sampler;
    let fits = tier.lights >= own.least_lights(Domain::Hemisphere)
        && (!tier.ambient || own.estimates_error())
        && (!tier.soft || own.estimates_error());
    if fits { own } else { SamplerKind::Adaptive }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(most: usize, ambient: bool) -> Table {
        let own = Tier { lights: 64, ambient, soft: false };
        Table { most, own, frame: 0, requested: Vec::new(), sets: Vec::new() }
    }

    fn select(lights: usize, ambient: bool) -> Selection {
        Selection { lights: Some(lights), ambient: Some(ambient), soft: Some(false) }
    }

    #[test]
    fn requests_that_the_own_set_serves_make_no_tier() {
        let mut table = table(4, false);
        for selection in [Selection::OWN, select(64, false), select(50_000, false)] {
            assert_eq!(table.assign(selection), None, "{selection:?}");
        }
        assert!(table.requested.is_empty(), "{:?}", table.requested);
    }

    #[test]
    fn a_set_without_ambient_light_has_a_light_although_the_own_set_has_none() {
        let mut table = table(4, true);
        table.own.lights = 0;
        let without = Tier { lights: 1, ambient: false, soft: false };
        for selection in [Selection { ambient: Some(false), ..Selection::OWN }, select(8, false)] {
            assert_eq!(table.assign(selection), Some(without), "{selection:?}");
        }
        assert_eq!(table.assign(select(8, true)), None, "the probe's own set");
    }

    #[test]
    fn any_sequence_of_requests_gets_at_most_the_lights_requested_from_a_bounded_number_of_tiers() {
        for (most, own_ambient) in [(4, false), (4, true), (6, false), (16, true)] {
            let mut table = table(most, own_ambient);
            let mut random = 1u32;
            for _ in 0..10_000 {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let (lights, ambient) = (1 + (random >> 16) as usize % 80, random >> 31 == 1);
                let soft = random >> 30 & 1 == 1;
                match table.assign(Selection { soft: Some(soft), ..select(lights, ambient) }) {
                    None => {
                        assert!(lights >= 64 && ambient == own_ambient && !soft, "{lights} {ambient} {soft}");
                    }
                    Some(tier) => {
                        assert!(tier.lights <= lights && tier.class() == Class { ambient, soft }, "{tier:?}");
                    }
                }
                assert!(table.requested.len() <= most, "{} tiers of {most}", table.requested.len());
            }
        }
    }

    #[test]
    fn a_request_beyond_the_limit_shares_the_largest_tier_that_is_small_enough() {
        let mut table = table(5, false);
        let one = |lights| Some(Tier { lights, ambient: false, soft: false });
        assert_eq!(table.assign(select(4, false)), one(4));
        assert_eq!(table.assign(select(16, false)), one(16));
        assert_eq!(table.assign(select(20, false)), one(16), "three places are the other classes'");
        assert_eq!(table.assign(select(2, false)), one(2), "the smallest one shrinks");
        assert_eq!(table.assign(select(4, false)), one(2));
        assert_eq!(table.assign(select(30, true)), Some(Tier { lights: 30, ambient: true, soft: false }));
    }
}
