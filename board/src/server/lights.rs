//! `/v1/lights`, `/data`, `/xml` and `/lights.json`: the next finished frame, encoded once per frame for all requests with equal parameters.

use super::connection::stopped;
use super::memory::LONGEST;
use super::query::{Wanted, wanted};
use super::sets::Missing;
use super::{Context, line, xr};
use crate::clock;
use crate::export::{Form, encode};
use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::{Selection, Served};
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER, VARY};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use hemilux_core::wire::{self, Stale};
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for the next frame, below the two seconds after which clients repeat a request.
pub(super) const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// Number of bytes that an answer usually has beside its lights.
const HEAD_BYTES: usize = 4096;

/// The file name by which USD refers to the map: that of `/v1/map.exr`, when both are saved in one folder.
const MAP: &str = "./map.exr";

/// A form of the light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Format {
    Json,
    Text,
    Xml,
    Binary,
    /// JSON as a server-sent event.
    Event,
    /// The values of a WebXR light estimate.
    Estimate,
    /// A file of another program, of [`Form::Csv`] and the scenes.
    File(Form),
}

impl Format {
    /// What `format=` accepts.
    pub(super) const NAMED: [(&str, Self); 9] = [
        ("json", Self::Json),
        ("text", Self::Text),
        ("xml", Self::Xml),
        ("binary", Self::Binary),
        ("csv", Self::File(Form::Csv)),
        ("glb", Self::File(Form::Glb)),
        ("usda", Self::File(Form::Usda)),
        ("rad", Self::File(Form::Radiance)),
        ("mitsuba", Self::File(Form::Mitsuba)),
    ];

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(n, _)| *n == name).map(|(_, format)| *format)
    }

    /// Whether the form holds ambient light beside lights.
    pub(super) fn has_ambient(self) -> bool {
        matches!(self, Self::Json | Self::Binary | Self::Event | Self::Estimate)
    }

    /// Number of bytes that a light usually does not exceed.
    const fn bytes_per_light(self) -> usize {
        match self {
            Self::Binary => 40,
            Self::Text | Self::File(Form::Csv) => 110,
            Self::Xml => 130,
            Self::Json | Self::Event | Self::File(Form::Radiance) => 180,
            Self::File(Form::Mitsuba) => 310,
            Self::Estimate => 0,
            Self::File(_) => 450,
        }
    }

    /// Number of bytes that a set of `lights` lights usually does not exceed.
    pub(super) const fn expected_length(self, lights: usize) -> usize {
        HEAD_BYTES + self.bytes_per_light() * lights
    }

    /// Largest number of lights of an answer.
    fn most_lights(self) -> usize {
        (LONGEST - HEAD_BYTES).checked_div(self.bytes_per_light()).unwrap_or(usize::MAX)
    }

    fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json | Self::Estimate => "application/json",
            Self::Text => "text/plain; charset=utf-8",
            Self::Xml => "application/xml",
            Self::Binary => "application/vnd.hemilux.lights",
            Self::Event => "text/event-stream",
            Self::File(form) => form.media_type(),
        })
    }

    /// Writes `set` into a buffer with room for `room` bytes; `None` only for a programming error, since writing to memory does not fail.
    pub(super) fn encode(self, set: &wire::LightSet<'_>, room: usize) -> Option<Vec<u8>> {
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
            Self::File(form) => return encode(form, set, Some(MAP), &mut bytes).ok().map(|()| bytes),
            Self::Estimate => {
                bytes.extend_from_slice(xr::document(set).as_bytes());
                Ok(())
            }
        };
        written.ok().map(|()| bytes)
    }
}

/// The id of an event, which a client sends back as Last-Event-ID when it reconnects.
pub(super) fn event_id(run: &str, frame: u64) -> String {
    format!("{run}-{frame}")
}

/// A set to answer with.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    pub(super) set: Arc<OwnedSet>,
    pub(super) stale: Option<Stale<String>>,
}

impl Answer {
    /// `set` with its present age: stale when older than [`LONGEST_WAIT`], or when `is_late`.
    pub(super) fn of(link: &Link, set: Arc<OwnedSet>, is_late: bool) -> Self {
        let age = link.staleness(&set);
        let stale = (is_late || u128::from(age.age_ms) > LONGEST_WAIT.as_millis()).then_some(age);
        Self { set, stale }
    }

    /// The newest set of `selection`, if there is a set; the probe's own one where that of the selection is not made yet.
    pub(super) fn newest(link: &Link, selection: Selection, is_late: bool) -> Option<Self> {
        let own = link.sets().latest()?;
        let set = match link.tiers().request(selection) {
            Served::Set(set) => set,
            Served::Own | Served::NotYet(_) => own,
        };
        Some(Self::of(link, set, is_late))
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
    let is_late = !wait_for_set(&context, after).await || !wait_for_tier(&context, variant.selection).await;
    let ready = match context.answers.sets.newest(variant, &context.link, is_late).await {
        Ok(ready) => ready,
        Err(Missing::NoSet) => return no_frame_yet(&context.link),
        Err(Missing::Full) => return too_much(&context),
        Err(Missing::TooLong(lights)) => return too_long(variant.format, lights),
        Err(Missing::Fault) => {
            return line(StatusCode::INTERNAL_SERVER_ERROR, "the light set could not be encoded");
        }
    };
    if !ready.is_stale && after.is_none() {
        context.counts.delivered(since_ready(&ready.set));
    }
    let no_store = HeaderValue::from_static("no-store");
    let head = [(CONTENT_TYPE, variant.format.content_type()), (CACHE_CONTROL, no_store)];
    let mut response = (head, ready.bytes).into_response();
    if fixed.is_none() {
        response.headers_mut().append(VARY, HeaderValue::from_static("Accept"));
    }
    response
}

/// The refusal of a request whose answer would take too much memory.
pub(super) fn too_much(context: &Context) -> Response {
    context.counts.refused("memory");
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, "too many large answers are being sent");
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

/// The refusal of a form that is too long for `lights` lights.
fn too_long(format: Format, lights: usize) -> Response {
    let most = format.most_lights();
    let advice = format!(
        "{lights} lights are too many for this form, which may have {most}: add lights={most}, or format=binary"
    );
    line(StatusCode::BAD_REQUEST, &advice)
}

/// Time since `set` was finished.
pub(super) fn since_ready(set: &OwnedSet) -> Duration {
    let ready_ns = set.timestamp_ns + 1000 * u64::from(set.latency.total);
    Duration::from_nanos(clock::monotonic_ns().saturating_sub(ready_ns))
}

/// Answers 200 while the newest frame is at most [`LONGEST_WAIT`] old, else 503.
pub(super) async fn health(State(context): State<Context>) -> Response {
    let latest = context.link.sets().latest();
    let Some(set) = latest else { return no_frame_yet(&context.link) };
    let age = context.link.staleness(&set);
    if u128::from(age.age_ms) <= LONGEST_WAIT.as_millis() {
        return line(StatusCode::OK, "ok");
    }
    line(StatusCode::SERVICE_UNAVAILABLE, &format!("the last frame is {} ms old: {}", age.age_ms, age.reason))
}

/// Waits for a set of another frame than `after`, or for the next one; whether there is one. Another frame than `after` that is there
/// already is newer, or of another run of the probe. Does not wait longer than [`LONGEST_WAIT`] or beyond the server's shutdown.
pub(super) async fn wait_for_set(context: &Context, after: Option<u64>) -> bool {
    let latest = context.link.sets().subscribe();
    let known = latest.borrow().as_ref().map(|set| set.frame);
    if known.is_some() && after.is_some() && known != after {
        return true;
    }
    let mut stop = context.stop.subscribe();
    tokio::select! {
        waited = tokio::time::timeout(LONGEST_WAIT, context.link.sets().newer(&latest)) => waited.is_ok(),
        () = stopped(&mut stop) => false,
    }
}

/// Waits for the first set of the tier that serves `selection`, at most [`LONGEST_WAIT`]; whether there is one.
pub(super) async fn wait_for_tier(context: &Context, selection: Selection) -> bool {
    let deadline = tokio::time::Instant::now() + LONGEST_WAIT;
    let mut stop = context.stop.subscribe();
    loop {
        let latest = context.link.sets().subscribe();
        if !matches!(context.link.tiers().request(selection), Served::NotYet(_)) {
            return true;
        }
        tokio::select! {
            waited = tokio::time::timeout_at(deadline, context.link.sets().newer(&latest)) => {
                if waited.is_err() {
                    return false;
                }
            }
            () = stopped(&mut stop) => return false,
        }
    }
}

pub(super) fn no_frame_yet(link: &Link) -> Response {
    let reason = link.status().failure().unwrap_or_else(|| "the source has not given a burst".into());
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, &format!("no frame yet: {reason}"));
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}
