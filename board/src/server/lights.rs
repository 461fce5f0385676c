//! `/v1/lights`, `/data`, `/xml` and `/lights.json`: the next finished frame, encoded once per frame for all requests with equal parameters.

use super::query::{Variant, Wanted, wanted};
use super::{Context, line};
use crate::clock;
use crate::probe::{Link, Published, Staleness};
use axum::body::Bytes;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER, VARY};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use hemilux_core::light::Light;
use hemilux_core::thin::{Pair, merge};
use hemilux_core::wire;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait for the next frame, below the two seconds after which clients repeat a request.
pub(super) const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// Resolution of the age in answers about a stopped source: answers within one step share their bytes.
const STALE_STEP_MS: u64 = 100;

/// Number of lights above which encoding takes more than about a millisecond and moves to a thread of its own.
const MANY_LIGHTS: usize = 2048;

/// Largest number of variants whose bytes are kept; beyond it the least recently requested variant is dropped.
const VARIANTS: usize = 16;

/// A form of the light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Json,
    Text,
    Xml,
    Binary,
    /// JSON as a server-sent event.
    Event,
}

impl Format {
    /// What `format=` accepts.
    pub(super) const NAMED: [(&str, Self); 4] =
        [("json", Self::Json), ("text", Self::Text), ("xml", Self::Xml), ("binary", Self::Binary)];

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(n, _)| *n == name).map(|(_, format)| *format)
    }

    fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json => "application/json",
            Self::Text => "text/plain; charset=utf-8",
            Self::Xml => "application/xml",
            Self::Binary => "application/vnd.hemilux.lights",
            Self::Event => "text/event-stream",
        })
    }

    /// Writes `set` into a buffer with room for `room` bytes; `None` only for a programming error, since writing to memory does not fail.
    fn encode(self, set: &wire::LightSet<'_>, room: usize) -> Option<Vec<u8>> {
        let mut bytes = Vec::with_capacity(room);
        let written = match self {
            Self::Json => wire::json(set, &mut bytes),
            Self::Text => wire::text(set, &mut bytes),
            Self::Xml => wire::xml(set, &mut bytes),
            Self::Binary => wire::binary(set, &mut bytes),
            Self::Event => {
                bytes.extend_from_slice(format!("id: {}\ndata: ", event_id(set.run, set.frame)).as_bytes());
                let written = wire::json(set, &mut bytes);
                bytes.extend_from_slice(b"\n\n");
                written
            }
        };
        written.ok().map(|()| bytes)
    }
}

/// The id of an event, which a client sends back as Last-Event-ID when it reconnects.
pub(super) fn event_id(run: &str, frame: u64) -> String {
    format!("{run}-{frame}")
}

/// The encoded bytes of the newest set for each variant, most recently requested first.
#[derive(Default)]
pub(super) struct Cache {
    variants: Mutex<Vec<(Variant, Arc<Place>)>>,
    /// Held while a large set is encoded: at most one core is used for that.
    large: tokio::sync::Mutex<()>,
}

/// The bytes of one variant.
#[derive(Default)]
struct Place {
    encoded: Mutex<Encoded>,
    /// Held while the set is encoded; requests that find the bytes in the cache do not wait for it.
    encoding: tokio::sync::Mutex<()>,
}

#[derive(Clone, Default)]
struct Encoded {
    /// Frame, and the age of stale sets in steps.
    key: Option<(u64, Option<u64>)>,
    bytes: Bytes,
}

/// A set to answer with.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    pub(super) set: Arc<Published>,
    pub(super) stale: Option<Staleness>,
}

impl Answer {
    /// `set` with its present age: stale when older than [`LONGEST_WAIT`], or when `is_late`.
    pub(super) fn of(link: &Link, set: Arc<Published>, is_late: bool) -> Self {
        let age = link.staleness(&set);
        let stale = (is_late || u128::from(age.age_ms) > LONGEST_WAIT.as_millis()).then_some(age);
        Self { set, stale }
    }
}

/// Answers with the next finished frame, or after [`LONGEST_WAIT`] with the last one, marked stale.
pub(super) async fn answer(
    State(context): State<Context>,
    uri: Uri,
    headers: HeaderMap,
    fixed: Option<Format>,
) -> Response {
    let Wanted { variant, after } = match wanted(&uri, &headers, fixed) {
        Ok(wanted) => wanted,
        Err(Some(found)) => return line(StatusCode::BAD_REQUEST, &found),
        Err(None) => {
            let text = "no format suits; there are application/json, text/plain, application/xml, application/vnd.hemilux.lights";
            return line(StatusCode::NOT_ACCEPTABLE, text);
        }
    };
    let Some(answer) = next_set(&context.link, after).await else { return no_frame_yet(&context.link) };
    let fresh = answer.stale.is_none().then(|| Arc::clone(&answer.set));
    let Some(bytes) = context.cache.bytes(variant, &context.link, answer).await else {
        return line(StatusCode::INTERNAL_SERVER_ERROR, "the light set could not be encoded");
    };
    if let Some(set) = fresh.filter(|_| after.is_none()) {
        context.counts.delivered(since_ready(&set));
    }
    let no_store = HeaderValue::from_static("no-store");
    let mut response =
        ([(CONTENT_TYPE, variant.format.content_type()), (CACHE_CONTROL, no_store)], bytes).into_response();
    if fixed.is_none() {
        response.headers_mut().append(VARY, HeaderValue::from_static("Accept"));
    }
    response
}

/// Time since `set` was finished.
pub(super) fn since_ready(set: &Published) -> Duration {
    let ready_ns = set.timestamp_ns + 1000 * u64::from(set.latency.total);
    Duration::from_nanos(clock::monotonic_ns().saturating_sub(ready_ns))
}

/// Answers 200 while the newest frame is at most [`LONGEST_WAIT`] old, else 503.
pub(super) async fn health(State(context): State<Context>) -> Response {
    let latest = context.link.subscribe().borrow().clone();
    let Some(set) = latest else { return no_frame_yet(&context.link) };
    let age = context.link.staleness(&set);
    if u128::from(age.age_ms) <= LONGEST_WAIT.as_millis() {
        return line(StatusCode::OK, "ok");
    }
    line(StatusCode::SERVICE_UNAVAILABLE, &format!("the last frame is {} ms old: {}", age.age_ms, age.reason))
}

/// Waits for the set that follows frame `after`, or for the next one. Another frame than `after` is an answer at once: it is newer,
/// or the probe has begun anew.
pub(super) async fn next_set(link: &Link, after: Option<u64>) -> Option<Answer> {
    let latest = link.subscribe();
    let known = latest.borrow().clone();
    if let Some(set) = known.filter(|set| after.is_some_and(|frame| frame != set.frame)) {
        return Some(Answer::of(link, set, false));
    }
    let in_time = tokio::time::timeout(LONGEST_WAIT, link.newer(&latest)).await.is_ok();
    let set = latest.borrow().clone()?;
    Some(Answer::of(link, set, !in_time))
}

pub(super) fn no_frame_yet(link: &Link) -> Response {
    let reason = link.failure().unwrap_or_else(|| "the source has not given a burst".into());
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, &format!("no frame yet: {reason}"));
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

impl Cache {
    /// The bytes of `answer`: the first request encodes the set, concurrent ones wait for it.
    pub(super) async fn bytes(&self, variant: Variant, link: &Arc<Link>, answer: Answer) -> Option<Bytes> {
        let key = (answer.set.frame, answer.stale.as_ref().map(|s| s.age_ms / STALE_STEP_MS));
        let place = self.place(variant);
        if let Some(bytes) = place.find(key) {
            return Some(bytes);
        }
        let _alone = place.encoding.lock().await;
        if let Some(bytes) = place.find(key) {
            return Some(bytes);
        }
        // Capacity of 9/8 of the previous frame's length: one allocation per frame.
        let last = lock(&place.encoded).bytes.len();
        let room = last + last / 8;
        let bytes = if answer.set.lights.len() > MANY_LIGHTS {
            let _one_at_a_time = self.large.lock().await;
            let link = Arc::clone(link);
            let work = move || encode(variant, &link, &answer, room);
            tokio::task::spawn_blocking(work).await.ok()??
        } else {
            encode(variant, link, &answer, room)?
        };
        *lock(&place.encoded) = Encoded { key: Some(key), bytes: bytes.clone() };
        Some(bytes)
    }

    /// The cache entry of `variant`; evicts the least recently requested one when the cache is full.
    fn place(&self, variant: Variant) -> Arc<Place> {
        let mut all = lock(&self.variants);
        let known = all.iter().position(|(v, _)| *v == variant);
        let place = known.map_or_else(|| (variant, Arc::default()), |i| all.remove(i));
        all.truncate(VARIANTS - 1);
        all.insert(0, place);
        Arc::clone(&all[0].1)
    }
}

impl Place {
    fn find(&self, key: (u64, Option<u64>)) -> Option<Bytes> {
        let encoded = lock(&self.encoded);
        (encoded.key == Some(key)).then(|| encoded.bytes.clone())
    }
}

/// Locks `mutex`, also after a panic of another thread: no critical section leaves partial updates.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn encode(variant: Variant, link: &Link, answer: &Answer, room: usize) -> Option<Bytes> {
    let began = Instant::now();
    let set = &answer.set;
    let mut on_wire = set.on_wire(link.run(), answer.stale.as_ref().map(Staleness::on_wire));
    on_wire.coordinates = variant.coordinates;
    on_wire.ambient_sh = set.ambient.as_ref().filter(|_| variant.ambient);
    let thinned;
    if let Some(most) = variant.lights.filter(|most| *most < set.lights.len()) {
        thinned = thin(&set.lights, most)?;
        on_wire.lights = &thinned;
    }
    if let Some(most) = variant.lights {
        on_wire.requested = on_wire.requested.min(u32::try_from(most).unwrap_or(u32::MAX));
    }
    let bytes = variant.format.encode(&on_wire, room)?;
    link.set_encode_us(u32::try_from(began.elapsed().as_micros()).unwrap_or(u32::MAX));
    Some(Bytes::from(bytes))
}

/// `lights` merged into at most `most`; `None` only for a programming error.
pub(super) fn thin(lights: &[Light], most: usize) -> Option<Vec<Light>> {
    let (mut lights, mut pairs) = (lights.to_vec(), vec![Pair::default(); lights.len()]);
    let count = merge(&mut lights, most, &mut pairs).ok()?;
    lights.truncate(count);
    Some(lights)
}
