//! `/v1/events` and `/v1/socket`: a light set per frame, pushed. A slow client misses frames and
//! delays no other client; the next set that it gets is the newest.

use super::connection::{ConnectionGuard, stopped};
use super::guard::is_foreign;
use super::lights::{Answer, Format, LONGEST_WAIT, event_id, since_ready};
use super::query::{Variant, Wanted, wanted};
use super::{Context, line};
use crate::probe::Published;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{Extensions, HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use tokio::sync::watch;

/// Largest message that a WebSocket client may send; none is needed.
const MESSAGE_BYTES: usize = 1 << 10;

/// Delay before a client reconnects.
const RETRY: &str = "retry: 1000\n\n";

/// The stream of newest light sets for one client.
struct Feed {
    context: Context,
    variant: Variant,
    latest: watch::Receiver<Option<Arc<Published>>>,
    /// The id of the client's last event, if any.
    has: Option<String>,
    is_first: bool,
}

impl Feed {
    fn new(context: Context, variant: Variant, has: Option<String>) -> Self {
        context.counts.streams.fetch_add(1, Relaxed);
        let latest = context.link.subscribe();
        Self { context, variant, latest, has, is_first: true }
    }

    /// The next set's bytes: at once if the client does not have the newest, else with the next frame, or after
    /// [`LONGEST_WAIT`] the last one again, marked stale. `None` when the server stops; no bytes before the first set.
    async fn next(&mut self) -> Option<Bytes> {
        let mut stop = self.context.stop.subscribe();
        let is_late = if std::mem::take(&mut self.is_first) && self.has_news() {
            self.latest.mark_unchanged();
            false
        } else {
            tokio::select! {
                () = stopped(&mut stop) => return None,
                waited = tokio::time::timeout(LONGEST_WAIT, self.context.link.newer(&self.latest)) => waited.is_err(),
            }
        };
        let link = &self.context.link;
        let Some(set) = self.latest.borrow_and_update().clone() else { return Some(Bytes::new()) };
        if !is_late {
            self.context.counts.delivered(since_ready(&set));
        }
        self.context.cache.bytes(self.variant, link, Answer::of(link, set, is_late)).await
    }

    fn has_news(&self) -> bool {
        let id = self.latest.borrow().as_ref().map(|set| event_id(self.context.link.run(), set.frame));
        id.is_some() && id != self.has
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.context.counts.streams.fetch_sub(1, Relaxed);
    }
}

/// Parses the parameters of a stream.
fn variant(uri: &Uri, fixed: Option<Format>) -> Result<Variant, String> {
    match wanted(uri, &HeaderMap::new(), fixed) {
        Ok(Wanted { variant, after: None }) => Ok(variant),
        Ok(_) => Err("found after, expected none: a stream begins with the newest set".into()),
        Err(found) => Err(found.unwrap_or_default()),
    }
}

/// Server-sent events: the data of each is a light set as JSON.
pub(super) async fn events(State(context): State<Context>, uri: Uri, headers: HeaderMap) -> Response {
    let variant = match variant(&uri, Some(Format::Event)) {
        Ok(variant) => variant,
        Err(found) => return line(StatusCode::BAD_REQUEST, &found),
    };
    let has = headers.get("last-event-id").and_then(|v| v.to_str().ok()).map(Into::into);
    let feed = Feed::new(context, variant, has);
    let sets = futures_util::stream::unfold(feed, |mut feed| async move {
        let bytes = feed.next().await?;
        // A comment, so that a client that has gone is noticed.
        let bytes = if bytes.is_empty() { Bytes::from_static(b": no frame yet\n\n") } else { bytes };
        Some((Ok::<_, Infallible>(bytes), feed))
    });
    let first = futures_util::stream::iter([Ok(Bytes::from_static(RETRY.as_bytes()))]);
    let no_buffer = (HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));
    let head = [
        (CONTENT_TYPE, HeaderValue::from_static("text/event-stream")),
        (CACHE_CONTROL, HeaderValue::from_static("no-store")),
        no_buffer,
    ];
    (head, Body::from_stream(first.chain(sets))).into_response()
}

/// A WebSocket: each message is a light set, text unless `format=binary`.
pub(super) async fn socket(
    State(context): State<Context>,
    uri: Uri,
    headers: HeaderMap,
    extensions: Extensions,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    // Browsers let any page open a WebSocket to anywhere.
    if is_foreign(&uri, &headers, &context.origins) {
        context.counts.refused("foreign");
        return line(StatusCode::FORBIDDEN, "a WebSocket opened by a page of another site");
    }
    let Ok(upgrade) = upgrade else {
        return line(
            StatusCode::UPGRADE_REQUIRED,
            "this is a WebSocket; GET /v1/events and /v1/lights need none",
        );
    };
    let variant = match variant(&uri, None) {
        Ok(variant) => variant,
        Err(found) => return line(StatusCode::BAD_REQUEST, &found),
    };
    // The connection's place is kept until the socket is closed.
    let guard = extensions.get::<Arc<ConnectionGuard>>().cloned();
    let upgrade = upgrade.max_message_size(MESSAGE_BYTES).max_frame_size(MESSAGE_BYTES).write_buffer_size(0);
    upgrade.on_upgrade(move |socket| async move {
        push(socket, Feed::new(context, variant, None)).await;
        drop(guard);
    })
}

/// Sends sets until either side ends it.
async fn push(mut socket: WebSocket, mut feed: Feed) {
    loop {
        let Some(bytes) = unless_closed(&mut socket, feed.next()).await else { return };
        let message = match bytes {
            Some(bytes) if bytes.is_empty() => continue,
            Some(bytes) if feed.variant.format == Format::Binary => Message::Binary(bytes),
            Some(bytes) => match Utf8Bytes::try_from(bytes) {
                Ok(text) => Message::Text(text),
                Err(_) => return,
            },
            None => {
                let away = CloseFrame { code: close_code::AWAY, reason: "the probe stops".into() };
                let _ = socket.send(Message::Close(Some(away))).await;
                return;
            }
        };
        if socket.send(message).await.is_err() {
            return;
        }
    }
}

/// Waits for `next` while ignoring the client's messages; `None` when the client closes the socket.
async fn unless_closed<T>(socket: &mut WebSocket, next: impl Future<Output = T>) -> Option<T> {
    tokio::pin!(next);
    loop {
        tokio::select! {
            next = &mut next => return Some(next),
            message = socket.recv() => match message {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return None,
                Some(Ok(_)) => {}
            },
        }
    }
}
