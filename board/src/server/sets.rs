//! The encoded forms of the newest light set: each form is encoded once per frame for all requests with equal
//! parameters.

use super::answer::Answer;
use super::encoder::Encoder;
use super::format::Format;
use super::memory::{AnswerMemory, Held, KEPT_SET_BYTES, Kept, LONGEST, body};
use super::query::Variant;
use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::Selection;
use axum::body::Bytes;
use hemilux_core::light::Light;
use hemilux_core::thin::{Pair, merge};
use hemilux_core::wire::{Coordinates, LightSet, Stale};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Step to which the age of a stale set is rounded, milliseconds: answers with equal rounded ages share their bytes.
const STALE_STEP_MS: u64 = 100;

/// Number of lights above which a set is encoded on a thread of its own: the encoding takes more than about 0.1 ms.
const MANY_LIGHTS: usize = 256;

/// Number of lights above which text is encoded on the thread for costly sets: the encoding takes milliseconds, ten times as long as a
/// binary form.
const TEXT_LIGHTS: usize = 8192;

/// Difference of the nice value of the thread for costly sets from that of the process.
const NICE: i32 = 10;

/// Largest number of variants whose bytes are kept; beyond it the least recently requested variant is dropped.
const VARIANTS: usize = 64;

/// The encoded bytes of the newest set for each variant, most recently requested first.
pub(super) struct EncodedSets {
    variants: Mutex<Vec<(Variant, Arc<Entry>)>>,
    /// Thread that encodes sets of more than [`MANY_LIGHTS`] lights.
    encoder: Encoder<Variant>,
    /// Thread that encodes costly sets, so that other sets do not wait for them: see [`is_costly`].
    costly: Encoder<Variant>,
    memory: Arc<AnswerMemory>,
}

/// The cached bytes of a light set in one variant.
#[derive(Default)]
struct Entry {
    encoded: Mutex<Encoded>,
    /// Locked while the variant is encoded; requests that find the bytes in the cache do not lock it.
    encoding: tokio::sync::Mutex<()>,
}

#[derive(Clone, Default)]
struct Encoded {
    key: Option<Key>,
    kept: Kept,
}

/// Identifies the set that was encoded: its frame and, for a stale set, its age in units of [`STALE_STEP_MS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Key {
    frame: u64,
    stale_steps: Option<u64>,
}

impl Key {
    fn of(answer: &Answer) -> Self {
        let stale_steps = answer.stale.as_ref().map(|s| s.age_ms / STALE_STEP_MS);
        Self { frame: answer.set.frame, stale_steps }
    }
}

/// Reasons why a requested light set is not encoded for the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Missing {
    /// The probe has not published a light set yet.
    NoSet,
    /// The answers in progress have used up the memory limit.
    Full,
    /// An answer with this number of lights would exceed the limit on the length of an answer.
    TooLong(usize),
    /// A programming error occurred while the set was encoded.
    Fault,
}

/// An encoded set that is ready to be sent.
#[derive(Clone, Debug)]
pub(super) struct Ready {
    pub(super) bytes: Bytes,
    /// The light set that the bytes encode.
    pub(super) set: Arc<OwnedSet>,
    pub(super) is_stale: bool,
}

impl EncodedSets {
    pub(super) fn new(memory: Arc<AnswerMemory>) -> Self {
        Self {
            variants: Mutex::default(),
            encoder: Encoder::new("hemilux-encode", 0),
            costly: Encoder::new("hemilux-costly", NICE),
            memory,
        }
    }

    /// Returns the newest set in the form `variant`, marked stale if `is_late`. The first request for a set encodes it, concurrent requests
    /// wait for the bytes.
    pub(super) async fn newest(
        &self,
        variant: Variant,
        link: &Arc<Link>,
        is_late: bool,
    ) -> Result<Ready, Missing> {
        // Requests that share a tier share the encoded bytes.
        let variant = Variant { selection: link.tiers().resolve(variant.selection), ..variant };
        let entry = self.entry(variant);
        let answer = Answer::newest(link, variant.selection, is_late).ok_or(Missing::NoSet)?;
        if let Some(ready) = entry.find(&answer) {
            return Ok(ready);
        }
        drop(answer);
        let _alone = entry.encoding.lock().await;
        let answer = Answer::newest(link, variant.selection, is_late).ok_or(Missing::NoSet)?;
        if let Some(ready) = entry.find(&answer) {
            return Ok(ready);
        }
        // The buffer of the expected length makes one allocation per frame.
        let (most, found) = (variant.selection.lights.unwrap_or(usize::MAX), answer.set.lights.len());
        let length = variant.format.expected_length(found.min(most));
        if length > LONGEST {
            return Err(Missing::TooLong(found.min(most)));
        }
        // A request that waits holds no set: requests of many forms would hold the sets of as many frames.
        drop(answer);
        let reserved = self.memory.reserve(length).await.ok_or(Missing::Full)?;
        let link = Arc::clone(link);
        let work = move || {
            // The set is the newest one when the thread runs the job.
            let answer = Answer::newest(&link, variant.selection, is_late)?;
            encode(variant, &link, &answer, length).map(|bytes| (answer, bytes))
        };
        let encoded = if found > MANY_LIGHTS || variant.format == Format::PackedEvent {
            let encoder = if is_costly(variant, found) { &self.costly } else { &self.encoder };
            encoder.run(variant, work).await.flatten()
        } else {
            work()
        };
        let (answer, bytes) = encoded.ok_or(Missing::Fault)?;
        Ok(self.keep(&entry, answer, &reserved.hold(bytes)))
    }

    fn keep(&self, entry: &Entry, answer: Answer, held: &Arc<Held>) -> Ready {
        let key = Some(Key::of(&answer));
        *lock(&entry.encoded) = Encoded { key, kept: Kept::new(held) };
        self.release_old();
        Ready { bytes: body(held), is_stale: answer.stale.is_some(), set: answer.set }
    }

    /// Releases encoded bytes beyond [`KEPT_SET_BYTES`] that no client is being sent; the bytes of the variants that
    /// were requested last are kept.
    fn release_old(&self) {
        let mut kept = 0;
        for (_, entry) in lock(&self.variants).iter() {
            let mut encoded = lock(&entry.encoded);
            kept += encoded.kept.len();
            if kept > KEPT_SET_BYTES {
                kept -= encoded.kept.len();
                encoded.kept.release();
            }
        }
    }

    /// Returns the cache entry of `variant`; evicts the least recently requested entry when the cache is full.
    fn entry(&self, variant: Variant) -> Arc<Entry> {
        let mut all = lock(&self.variants);
        let known = all.iter().position(|(v, _)| *v == variant);
        let entry = known.map_or_else(|| (variant, Arc::default()), |i| all.remove(i));
        all.truncate(VARIANTS - 1);
        all.insert(0, entry);
        Arc::clone(&all[0].1)
    }
}

impl Entry {
    fn find(&self, answer: &Answer) -> Option<Ready> {
        let encoded = lock(&self.encoded);
        let bytes = encoded.kept.find().filter(|_| encoded.key == Some(Key::of(answer)))?;
        Some(Ready { bytes, set: Arc::clone(&answer.set), is_stale: answer.stale.is_some() })
    }
}

/// Returns true if the encoding of a set of `lights` lights takes so long that its clients get sets at a lower rate: its lights are merged to
/// fewer, or it is text of many lights whose coordinates are converted or whose bytes are compressed.
fn is_costly(variant: Variant, lights: usize) -> bool {
    let is_thinned = variant.selection.lights.is_some_and(|most| most < lights);
    is_thinned
        || (lights > TEXT_LIGHTS
            && variant.format != Format::Binary
            && (variant.coordinates != Coordinates::Probe || variant.format == Format::PackedEvent))
}

/// Locks `mutex`, also after a panic of another thread: no critical section leaves partial updates.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(super) fn encode(variant: Variant, link: &Link, answer: &Answer, room: usize) -> Option<Vec<u8>> {
    let began = Instant::now();
    let set = &answer.set;
    let Selection { lights, ambient, .. } = variant.selection;
    let has_ambient = variant.format.has_ambient() && ambient.unwrap_or(true);
    let mut on_wire = LightSet {
        stale: answer.stale.as_ref().map(Stale::view),
        coordinates: variant.coordinates,
        ambient_sh: set.ambient_sh.as_ref().filter(|_| has_ambient),
        ..set.view()
    };
    let thinned;
    // A set may have more lights than requested: a tier may have no set yet when the source has stopped.
    if let Some(most) = lights.filter(|most| *most < set.lights.len()) {
        thinned = thin(&set.lights, most)?;
        on_wire.lights = &thinned;
    }
    if let Some(most) = lights {
        on_wire.requested = on_wire.requested.min(u32::try_from(most).unwrap_or(u32::MAX));
    }
    on_wire.left_out = on_wire.missing_flux();
    let bytes = variant.format.encode(&on_wire, room)?;
    link.durations().set_encode_us(u32::try_from(began.elapsed().as_micros()).unwrap_or(u32::MAX));
    Some(bytes)
}

/// Returns `lights` merged to at most `most` lights; `None` only for a programming error.
pub(super) fn thin(lights: &[Light], most: usize) -> Option<Vec<Light>> {
    let (mut lights, mut pairs) = (lights.to_vec(), vec![Pair::default(); lights.len()]);
    let count = merge(&mut lights, most, &mut pairs).ok()?;
    lights.truncate(count);
    Some(lights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::{Config, Worker};
    use crate::scene;
    use crate::source::{Pace, SceneSource};
    use std::task::{Context, Waker};

    #[tokio::test]
    async fn a_request_that_waits_for_memory_holds_no_set() {
        let source = SceneSource::new(scene::by_name("overcast").expect("a scene"), Pace::Free);
        let worker = Worker::try_new(Box::new(source), "test".into(), Config::steady());
        let mut worker = worker.expect("a worker");
        worker.step().expect("a set");
        let (link, memory) = (worker.link(), Arc::<AnswerMemory>::default());
        let sets = EncodedSets::new(Arc::clone(&memory));
        let variant = Variant::of(Format::Json);
        let mut full = Vec::new();
        for _ in 0..3 {
            full.push(memory.reserve(2 << 20).await.expect("memory"));
        }
        let set = link.sets().latest().expect("a set");
        let holders = Arc::strong_count(&set);
        let mut waiting = std::pin::pin!(sets.newest(variant, &link, false));
        assert!(waiting.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending(), "no memory");
        assert_eq!(Arc::strong_count(&set), holders);
        drop(full);
        let ready = waiting.await.expect("an answer");
        assert_eq!((ready.set.frame, Arc::strong_count(&set)), (set.frame, holders + 1));
    }
}
