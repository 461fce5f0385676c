//! `/data`, `/xml` and `/lights.json`: the next finished frame, encoded once per frame and format.

use super::{Context, line};
use crate::probe::{Link, Published, Staleness};
use axum::body::Bytes;
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use hemilux_core::wire;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Mutex;

/// Longest wait for the next frame: clients ask again after two seconds.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// Age in which the answers about a source that has stopped share their bytes: what they say is off by less than this.
const STALE_STEP_MS: u64 = 100;

/// Lights above which encoding takes so long (about a millisecond) that it must not hold up other connections.
const MANY_LIGHTS: usize = 2048;

/// A form of the light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Json,
    Text,
    Xml,
}

impl Format {
    const ALL: usize = 3;

    fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json => "application/json",
            Self::Text => "text/plain; charset=utf-8",
            Self::Xml => "application/xml",
        })
    }

    /// Writes `set` into a buffer with room for `room` bytes; `None` only for a fault of ours, since memory refuses nothing.
    fn encode(self, set: &wire::LightSet<'_>, room: usize) -> Option<Vec<u8>> {
        let mut bytes = Vec::with_capacity(room);
        let written = match self {
            Self::Json => wire::json(set, &mut bytes),
            Self::Text => wire::text(set, &mut bytes),
            Self::Xml => wire::xml(set, &mut bytes),
        };
        written.ok().map(|()| bytes)
    }
}

/// The newest bytes of each format.
#[derive(Default)]
pub(super) struct Cache {
    formats: [Mutex<Encoded>; Format::ALL],
}

#[derive(Default)]
struct Encoded {
    /// Frame, and the age of stale sets in steps.
    key: Option<(u64, Option<u64>)>,
    bytes: Bytes,
}

/// A set to answer with.
struct Answer {
    set: Arc<Published>,
    stale: Option<Staleness>,
}

/// Answers with the next finished frame, or after [`LONGEST_WAIT`] with the last one, marked stale.
pub(super) async fn next_frame(State(context): State<Context>, format: Format) -> Response {
    let Some(answer) = next_set(&context.link).await else { return no_frame_yet(&context.link) };
    match context.cache.bytes(format, &context.link, answer).await {
        Some(bytes) => {
            let no_store = HeaderValue::from_static("no-store");
            ([(CONTENT_TYPE, format.content_type()), (CACHE_CONTROL, no_store)], bytes).into_response()
        }
        None => line(StatusCode::INTERNAL_SERVER_ERROR, "the light set could not be encoded"),
    }
}

/// Says whether frames are coming.
pub(super) async fn health(State(context): State<Context>) -> Response {
    let latest = context.link.subscribe().borrow().clone();
    let Some(set) = latest else { return no_frame_yet(&context.link) };
    let age = context.link.staleness(&set);
    if u128::from(age.age_ms) <= LONGEST_WAIT.as_millis() {
        return line(StatusCode::OK, "ok");
    }
    line(StatusCode::SERVICE_UNAVAILABLE, &format!("the last frame is {} ms old: {}", age.age_ms, age.reason))
}

async fn next_set(link: &Link) -> Option<Answer> {
    let mut latest = link.subscribe();
    let in_time = tokio::time::timeout(LONGEST_WAIT, latest.changed()).await.is_ok();
    let set = latest.borrow().clone()?;
    let stale = (!in_time).then(|| link.staleness(&set));
    Some(Answer { set, stale })
}

fn no_frame_yet(link: &Link) -> Response {
    let reason = link.failure().unwrap_or_else(|| "the source has not given a burst".into());
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, &format!("no frame yet: {reason}"));
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

impl Cache {
    /// The bytes of `answer`: whoever comes first encodes, the others wait for it.
    async fn bytes(&self, format: Format, link: &Arc<Link>, answer: Answer) -> Option<Bytes> {
        let key = (answer.set.frame, answer.stale.as_ref().map(|s| s.age_ms / STALE_STEP_MS));
        let mut encoded = self.formats[format as usize].lock().await;
        if encoded.key == Some(key) {
            return Some(encoded.bytes.clone());
        }
        // The last frame's length and an eighth: one allocation a frame.
        let room = encoded.bytes.len() + encoded.bytes.len() / 8;
        let bytes = if answer.set.lights.len() > MANY_LIGHTS {
            let link = Arc::clone(link);
            let work = move || encode(format, &link, &answer, room);
            tokio::task::spawn_blocking(work).await.ok()??
        } else {
            encode(format, link, &answer, room)?
        };
        *encoded = Encoded { key: Some(key), bytes };
        Some(encoded.bytes.clone())
    }
}

fn encode(format: Format, link: &Link, answer: &Answer, room: usize) -> Option<Bytes> {
    let began = Instant::now();
    let stale = answer.stale.as_ref().map(Staleness::on_wire);
    let bytes = format.encode(&answer.set.on_wire(link.run(), stale), room)?;
    link.set_encode_us(u32::try_from(began.elapsed().as_micros()).unwrap_or(u32::MAX));
    Some(Bytes::from(bytes))
}
