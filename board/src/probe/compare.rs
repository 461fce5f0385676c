//! A second sampler on the probe's frames while clients request it: one at a time for all clients.

use super::lock;
use super::made_for::MadeFor;
use super::ring::Ring;
use crate::light_set::{self, OwnedSet};
use crate::pipeline::Pipeline;
use crate::samplers::{self, SamplerError};
use hemilux_core::Order;
use hemilux_core::SamplerKind;
use hemilux_core::light::Light;
use hemilux_core::pyramid::{Quad, pyramid_len};
use hemilux_core::sampler::{Request, Sampler};
use hemilux_core::wire::{LightSet, Overrun};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Largest number of lights of a set of the second sampler, which bounds the sampler's memory.
pub const MOST_LIGHTS: usize = 2048;

/// Time without a request after which the second sampler and its memory are released.
const KEPT: Duration = Duration::from_secs(3);

/// Time without a request after which a request for another sampler is granted. Clients of a comparison repeat their requests at shorter
/// intervals.
const HELD: Duration = Duration::from_millis(500);

/// Order of the HEALPix grid of the [sketch](Second::sketch) of a map: 2048 quads for a hemisphere, each with
/// its centroid.
pub const SKETCH_ORDER: u8 = 4;

/// Request for a second sampler: kind, number of lights, and discs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contender {
    /// Kind of the requested second sampler.
    pub sampler: SamplerKind,
    /// Requested number of lights of the second sampler, at most [`MOST_LIGHTS`].
    pub lights: usize,
    /// True if the second sampler fits its lights as discs.
    pub soft: bool,
}

impl Contender {
    /// Returns this request in the form that the sampler's constructor reads.
    #[must_use]
    pub const fn request(&self) -> Request {
        Request { soft: self.soft, ..Request::of_lights(self.lights) }
    }
}

/// The second sampler's result for a frame.
#[derive(Clone, Debug, Default)]
pub struct Second {
    /// The light set of the second sampler for the frame.
    pub set: OwnedSet,
    /// The frame's map in quads of [`SKETCH_ORDER`], or of the map's own order where that is lower: the reference for the
    /// scores of both sets.
    pub sketch: Vec<Quad>,
}

/// The light sets of two samplers for one frame.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Request that the second sampler of the pair answers.
    pub contender: Contender,
    /// The light set of the probe's own sampler.
    pub first: Arc<OwnedSet>,
    /// The result of the second sampler for the same frame.
    pub second: Arc<Second>,
}

/// The clients' requests for a second sampler, and the newest pair of light sets.
#[derive(Debug)]
pub struct Comparison {
    state: Mutex<ComparisonState>,
    /// True if a second sampler may be requested; the processing thread locks `state` only then.
    is_wanted: AtomicBool,
    pairs: watch::Sender<Option<Pair>>,
}

#[derive(Debug)]
struct ComparisonState {
    contender: Option<Contender>,
    /// Number of clients that hold a [`Permit`].
    waiting: usize,
    /// Time of the last grant or release of a [`Permit`].
    seen: Instant,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            state: Mutex::new(ComparisonState { contender: None, waiting: 0, seen: Instant::now() }),
            is_wanted: AtomicBool::new(false),
            pairs: watch::Sender::new(None),
        }
    }
}

/// A client's permit for a comparison: the second sampler runs on every frame while a client holds a permit, and for three seconds after
/// the last permit is dropped.
#[derive(Debug)]
pub struct Permit<'a>(&'a Comparison);

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        let mut state = lock(&self.0.state);
        state.waiting = state.waiting.saturating_sub(1);
        state.seen = Instant::now();
    }
}

impl Comparison {
    /// Requests, until the returned permit is dropped, that each frame yields the probe's own set together with a set of `contender`.
    ///
    /// # Errors
    /// The second sampler in use, if clients hold permits for it, or held permits within the last 0.5 s, and it
    /// is another one than `contender`.
    pub fn ask(&self, contender: Contender) -> Result<Permit<'_>, Contender> {
        let mut state = lock(&self.state);
        let is_held = state.waiting > 0 || state.seen.elapsed() < HELD;
        if let Some(other) = state.contender.filter(|other| *other != contender && is_held) {
            return Err(other);
        }
        state.contender = Some(contender);
        state.waiting += 1;
        state.seen = Instant::now();
        self.is_wanted.store(true, Ordering::Release);
        Ok(Permit(self))
    }

    /// Returns a receiver of the newest pair of light sets; `None` before the first pair.
    #[must_use]
    pub fn pairs(&self) -> watch::Receiver<Option<Pair>> {
        self.pairs.subscribe()
    }

    /// Returns the requested second sampler; `None` if none is requested. Without requests, the call costs one
    /// atomic load.
    fn wanted(&self) -> Option<Contender> {
        if !self.is_wanted.load(Ordering::Acquire) {
            return None;
        }
        let mut state = lock(&self.state);
        if state.waiting == 0 && state.seen.elapsed() > KEPT {
            state.contender = None;
            self.is_wanted.store(false, Ordering::Release);
        }
        state.contender
    }
}

/// The second sampler on the processing thread, if one is requested.
#[derive(Default)]
pub(super) struct SecondarySlot {
    secondary: Option<SecondarySampler>,
}

/// The second sampler of `/v1/compare` with its memory.
struct SecondarySampler {
    contender: Contender,
    made_for: MadeFor,
    sampler: Box<dyn Sampler + Send>,
    ring: Ring<Second>,
}

impl SecondarySlot {
    /// Runs the second sampler on the last frame, if a client requests one, and publishes its set with `first`,
    /// the probe's own set of that frame.
    pub(super) fn compare(&mut self, link: &Comparison, pipeline: &mut Pipeline, first: &Arc<OwnedSet>) {
        let Some(contender) = link.wanted() else {
            if self.secondary.take().is_some() {
                link.pairs.send_replace(None);
            }
            return;
        };
        let made_for = MadeFor::now(pipeline, contender.sampler);
        let same = |r: &SecondarySampler| r.contender == contender && r.made_for == made_for;
        if !self.secondary.as_ref().is_some_and(same) {
            self.secondary = None;
            match SecondarySampler::new(contender, made_for, pipeline) {
                Ok(secondary) => self.secondary = Some(secondary),
                Err(error) => tracing::warn!("comparison: found {error}"),
            }
        }
        if let Some(secondary) = &mut self.secondary {
            let second = secondary.sample(pipeline, first);
            link.pairs.send_replace(Some(Pair { contender, first: Arc::clone(first), second }));
        }
    }
}

impl SecondarySampler {
    fn new(contender: Contender, made_for: MadeFor, pipeline: &Pipeline) -> Result<Self, SamplerError> {
        let Contender { sampler, lights, .. } = contender;
        let shape = pipeline.shape();
        let quads = shape.domain.quads(SKETCH_ORDER.min(shape.order));
        let ring = Ring::new(|| Second {
            set: OwnedSet { lights: Vec::with_capacity(lights), ..OwnedSet::default() },
            sketch: Vec::with_capacity(quads),
        });
        let sampler = samplers::make_tuned(sampler, &shape, lights, &made_for.tuning)?;
        Ok(Self { contender, made_for, sampler, ring })
    }

    fn sample(&mut self, pipeline: &mut Pipeline, first: &OwnedSet) -> Arc<Second> {
        let Contender { sampler, .. } = self.contender;
        let request = self.contender.request();
        let sampled = pipeline.sample_again(self.sampler.as_mut(), &request);
        let (made, latency) = (sampled.decomposition, sampled.latency(&first.latency));
        let sketch = pipeline.sketch(SKETCH_ORDER);
        self.ring.fill(|second| {
            let set = LightSet {
                sampler: sampler.name(),
                requested: self.contender.lights as u32,
                lights: made.lights,
                ambient_sh: made.ambient.as_ref(),
                estimated_error: made.estimated_error,
                latency,
                overrun: Overrun::NONE,
                ..first.view()
            };
            light_set::copy(&set, &mut second.set);
            second.sketch.clear();
            second.sketch.extend_from_slice(sketch);
        })
    }
}

/// Returns the bytes that a comparison allocates for a map of `order`, without the memory of the sampler
/// itself.
#[must_use]
pub fn bytes(order: u8) -> usize {
    let quads =
        pyramid_len(hemilux_core::healpix::Domain::Hemisphere, Order::saturating(SKETCH_ORDER.min(order)));
    super::ring::SETS * (MOST_LIGHTS * size_of::<Light>() + quads * size_of::<Quad>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: Contender = Contender { sampler: SamplerKind::Q2Tree, lights: 64, soft: false };
    const OTHER: Contender = Contender { sampler: SamplerKind::Pharr, lights: 64, soft: false };

    #[test]
    fn one_sampler_runs_at_a_time_and_none_without_requests() {
        let comparison = Comparison::default();
        assert_eq!(comparison.wanted(), None, "no request");
        let first = comparison.ask(TREE).expect("a permit");
        let second = comparison.ask(TREE).expect("the same for two");
        assert_eq!(comparison.ask(OTHER).expect_err("another"), TREE, "names the sampler in use");
        drop(first);
        assert_eq!(comparison.wanted(), Some(TREE), "one is left");
        drop(second);
        assert!(comparison.ask(OTHER).is_err(), "it may go on asking");
        let past =
            |by| lock(&comparison.state).seen = Instant::now().checked_sub(by).expect("an uptime of seconds");
        past(HELD);
        assert_eq!(comparison.wanted(), Some(TREE), "its memory is kept for a while");
        drop(comparison.ask(OTHER).expect("the other's turn"));
        past(KEPT + Duration::from_millis(1));
        assert_eq!(comparison.wanted(), None, "no requests for KEPT");
        assert!(
            !comparison.is_wanted.load(Ordering::Relaxed),
            "and the processing thread need not look either"
        );
    }
}
