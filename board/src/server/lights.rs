//! `/v1/lights`, `/data`, `/xml` and `/lights.json`: the light set of the next finished frame, encoded once per frame for all requests with
//! equal parameters.

use super::answer::LONGEST_WAIT;
use super::connection::stopped;
use super::format::Format;
use super::query::{SetQuery, wanted};
use super::sets::Missing;
use super::{Context, line};
use crate::clock;
use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::{Selection, Served};
use axum::extract::State;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER, VARY};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use std::time::Duration;

/// Answers with the light set of the next finished frame, or after [`LONGEST_WAIT`] with that of the last
/// frame, marked stale.
pub(super) async fn answer(
    State(context): State<Context>,
    uri: Uri,
    headers: HeaderMap,
    fixed: Option<Format>,
) -> Response {
    let SetQuery { variant, after } = match wanted(&uri, &headers, fixed) {
        Ok(wanted) => wanted,
        Err(Some(found)) => return line(StatusCode::BAD_REQUEST, &found),
        Err(None) => {
            let text = "no format of the Accept header is supported, expected application/json, text/plain, application/xml, application/vnd.hemilux.lights";
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

/// Answers `/v1/xr` with the values of a WebXR light estimate: the main light of the next frame and the spherical harmonics of all other light.
pub(super) async fn estimate(state: State<Context>, uri: Uri) -> Response {
    if uri.query().is_some_and(|query| !query.is_empty()) {
        return line(StatusCode::BAD_REQUEST, "found parameters, expected none");
    }
    answer(state, uri, HeaderMap::new(), Some(Format::Estimate)).await
}

/// Counts and returns the refusal of a request whose answer would exceed the limit on the memory of answers.
pub(super) fn too_much(context: &Context) -> Response {
    context.counts.refused("memory");
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, "too many large answers are being sent");
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

/// Returns the refusal of a request in the form `format`, whose answer with `lights` lights would be too long.
fn too_long(format: Format, lights: usize) -> Response {
    let most = format.most_lights();
    let advice = format!(
        "{lights} lights are too many for this form, which may have {most}: add lights={most}, or format=binary"
    );
    line(StatusCode::BAD_REQUEST, &advice)
}

/// Returns the time since `set` was finished.
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

/// Waits for a light set whose frame is not `after`, or without `after` for the next set; returns true if there is one. A present set with
/// another frame number than `after` is newer, or of another run of the probe, and ends the wait at once. The wait lasts at most
/// [`LONGEST_WAIT`], and ends with the server's shutdown.
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

/// Waits at most [`LONGEST_WAIT`] for the first light set of the tier that serves `selection`; returns true if there
/// is one.
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
    let reason = link.status().failure().unwrap_or_else(|| "the source has not delivered a burst".into());
    let mut response = line(StatusCode::SERVICE_UNAVAILABLE, &format!("no frame yet: {reason}"));
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}
