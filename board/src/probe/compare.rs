//! A second sampler on the same frames, while somebody asks for it: one at a time for all clients, and none when nobody looks.

use super::published::Ring;
use super::{Published, lock};
use crate::pipeline::Pipeline;
use crate::samplers::{self, SamplerError, Tuning};
use hemilux_core::Order;
use hemilux_core::SamplerKind;
use hemilux_core::light::Light;
use hemilux_core::pyramid::{Quad, pyramid_len};
use hemilux_core::sampler::{Request, Sampler};
use hemilux_core::wire::Latency;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Most lights of the second sampler: more could not be told apart, and would not leave its memory small.
pub const MOST_LIGHTS: usize = 2048;

/// Time without a client after which the second sampler and its memory are given up.
const KEPT: Duration = Duration::from_secs(3);

/// Time without a client after which another may choose another sampler: a client that goes on asks again sooner.
const HELD: Duration = Duration::from_millis(500);

/// Order of the map's [sketch](Second::sketch): 2048 quads for a hemisphere, with their centroids.
pub const SKETCH_ORDER: u8 = 4;

/// A second sampler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contender {
    /// The sampler.
    pub sampler: SamplerKind,
    /// Lights asked for, at most [`MOST_LIGHTS`].
    pub lights: usize,
}

/// What the second sampler made of a frame.
#[derive(Clone, Debug, Default)]
pub struct Second {
    /// Its lights.
    pub set: Published,
    /// The map in quads of [`SKETCH_ORDER`], or of its own order where that is less: what sets can be held against.
    pub sketch: Vec<Quad>,
}

/// Two sets of one frame.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Who is compared.
    pub contender: Contender,
    /// What everybody gets.
    pub first: Arc<Published>,
    /// What the second sampler gives.
    pub second: Arc<Second>,
}

/// Who asks for what, and the newest pair.
#[derive(Debug)]
pub struct Comparison {
    desk: Mutex<Desk>,
    /// Whether the processing thread has to look at the desk.
    is_wanted: AtomicBool,
    pairs: watch::Sender<Option<Pair>>,
}

#[derive(Debug)]
struct Desk {
    contender: Option<Contender>,
    /// Clients that wait now.
    waiting: usize,
    /// When a client came or went last.
    seen: Instant,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            desk: Mutex::new(Desk { contender: None, waiting: 0, seen: Instant::now() }),
            is_wanted: AtomicBool::new(false),
            pairs: watch::Sender::new(None),
        }
    }
}

/// A client's place: pairs come as long as somebody has one, and a while longer.
#[derive(Debug)]
pub struct Seat<'a>(&'a Comparison);

impl Drop for Seat<'_> {
    fn drop(&mut self) {
        let mut desk = lock(&self.0.desk);
        desk.waiting = desk.waiting.saturating_sub(1);
        desk.seen = Instant::now();
    }
}

impl Comparison {
    /// Asks for `contender`'s pairs.
    ///
    /// # Errors
    /// The other sampler that somebody looks at.
    pub fn ask(&self, contender: Contender) -> Result<Seat<'_>, Contender> {
        let mut desk = lock(&self.desk);
        let is_held = desk.waiting > 0 || desk.seen.elapsed() < HELD;
        if let Some(other) = desk.contender.filter(|other| *other != contender && is_held) {
            return Err(other);
        }
        desk.contender = Some(contender);
        desk.waiting += 1;
        desk.seen = Instant::now();
        self.is_wanted.store(true, Ordering::Release);
        Ok(Seat(self))
    }

    /// The newest pair, and news of it.
    #[must_use]
    pub fn pairs(&self) -> watch::Receiver<Option<Pair>> {
        self.pairs.subscribe()
    }

    /// Who is to be compared in this frame; one load when nobody asks.
    fn wanted(&self) -> Option<Contender> {
        if !self.is_wanted.load(Ordering::Acquire) {
            return None;
        }
        let mut desk = lock(&self.desk);
        if desk.waiting == 0 && desk.seen.elapsed() > KEPT {
            desk.contender = None;
            self.is_wanted.store(false, Ordering::Release);
        }
        desk.contender
    }
}

/// The processing thread's part.
#[derive(Default)]
pub(super) struct Arena {
    rival: Option<Rival>,
}

/// The second sampler with its memory.
struct Rival {
    contender: Contender,
    /// Order of the map and tuning that it was made for.
    made_for: (u8, Tuning),
    sampler: Box<dyn Sampler + Send>,
    ring: Ring<Second>,
}

impl Arena {
    /// Lets the second sampler work on the last frame, whose set is `first`, if somebody asked for it.
    pub(super) fn compare(&mut self, link: &Comparison, pipeline: &mut Pipeline, first: &Arc<Published>) {
        let Some(contender) = link.wanted() else {
            if self.rival.take().is_some() {
                link.pairs.send_replace(None);
            }
            return;
        };
        let made_for = (pipeline.settings().order(), pipeline.settings().tuning.of(contender.sampler));
        let same = |r: &Rival| r.contender == contender && r.made_for == made_for;
        if !self.rival.as_ref().is_some_and(same) {
            self.rival = None;
            match Rival::new(contender, made_for, pipeline) {
                Ok(rival) => self.rival = Some(rival),
                Err(error) => tracing::warn!("comparison: found {error}"),
            }
        }
        if let Some(rival) = &mut self.rival {
            let second = rival.sample(pipeline, first);
            link.pairs.send_replace(Some(Pair { contender, first: Arc::clone(first), second }));
        }
    }
}

impl Rival {
    fn new(contender: Contender, made_for: (u8, Tuning), pipeline: &Pipeline) -> Result<Self, SamplerError> {
        let Contender { sampler, lights } = contender;
        let shape = pipeline.shape();
        let quads = shape.domain.quads(SKETCH_ORDER.min(shape.order));
        let ring = Ring::new(|| Second {
            set: Published { lights: Vec::with_capacity(lights), ..Published::default() },
            sketch: Vec::with_capacity(quads),
        });
        let sampler = samplers::make_tuned(sampler, &shape, lights, &made_for.1)?;
        Ok(Self { contender, made_for, sampler, ring })
    }

    fn sample(&mut self, pipeline: &mut Pipeline, first: &Published) -> Arc<Second> {
        let Contender { sampler, lights } = self.contender;
        let request = Request::of_lights(lights);
        let (made, took) = pipeline.sample_again(self.sampler.as_mut(), &request);
        let sample = u32::try_from(took.as_micros()).unwrap_or(u32::MAX);
        let sketch = pipeline.sketch(SKETCH_ORDER);
        self.ring.fill(|second| {
            let set = &mut second.set;
            let mut lights = std::mem::take(&mut set.lights);
            lights.clear();
            lights.extend_from_slice(made.lights);
            let total = first.latency.total.saturating_sub(first.latency.sample).saturating_add(sample);
            *set = Published {
                sampler: sampler.name(),
                requested: self.contender.lights as u32,
                lights,
                ambient: made.ambient,
                estimated_error: made.estimated_error,
                latency: Latency { sample, total, ..first.latency },
                ..Published::of_frame(first)
            };
            second.sketch.clear();
            second.sketch.extend_from_slice(sketch);
        })
    }
}

/// Bytes that a comparison takes beside the sampler's own.
#[must_use]
pub fn bytes(order: u8) -> usize {
    let quads =
        pyramid_len(hemilux_core::healpix::Domain::Hemisphere, Order::saturating(SKETCH_ORDER.min(order)));
    super::published::SETS * (MOST_LIGHTS * size_of::<Light>() + quads * size_of::<Quad>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: Contender = Contender { sampler: SamplerKind::Q2Tree, lights: 64 };
    const OTHER: Contender = Contender { sampler: SamplerKind::Pharr, lights: 64 };

    #[test]
    fn one_sampler_at_a_time_and_none_when_nobody_looks() {
        let comparison = Comparison::default();
        assert_eq!(comparison.wanted(), None, "nobody has asked");
        let first = comparison.ask(TREE).expect("a seat");
        let second = comparison.ask(TREE).expect("the same for two");
        assert_eq!(comparison.ask(OTHER).expect_err("another"), TREE, "says who is in the way");
        drop(first);
        assert_eq!(comparison.wanted(), Some(TREE), "one is left");
        drop(second);
        assert!(comparison.ask(OTHER).is_err(), "it may go on asking");
        let past =
            |by| lock(&comparison.desk).seen = Instant::now().checked_sub(by).expect("an uptime of seconds");
        past(HELD);
        assert_eq!(comparison.wanted(), Some(TREE), "its memory is kept for a while");
        drop(comparison.ask(OTHER).expect("the other's turn"));
        past(KEPT + Duration::from_millis(1));
        assert_eq!(comparison.wanted(), None, "nobody looks any more");
        assert!(
            !comparison.is_wanted.load(Ordering::Relaxed),
            "and the processing thread need not look either"
        );
    }
}
