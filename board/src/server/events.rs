//! `/v1/events` and `/v1/socket`: a light set per frame, sent when it is finished. A slow client skips frames and does not delay other clients;
//! the next set that it gets is the newest.

use super::access;
use super::answer::LONGEST_WAIT;
use super::connection::{ConnectionGuard, Enlarged, stopped};
use super::files::accepts_gzip;
use super::format::{Format, event_id};
use super::lights::{since_ready, wait_for_tier};
use super::origin::{Cause, Sender};
use super::query::{SetQuery, Variant, wanted};
use super::sets::Missing;
use super::{Context, line, packed};
use crate::light_set::OwnedSet;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::http::header::{CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, VARY};
use axum::http::{Extensions, HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Largest message that a WebSocket client may send, bytes; the protocol needs no messages of clients.
const MESSAGE_BYTES: usize = 1 << 10;

/// Largest message of a WebSocket client that is read, bytes; a larger one ends the connection without a close
/// code.
const READ_BYTES: usize = 64 << 10;

/// Longest time for the exchange of the close frames of a WebSocket.
const CLOSE_TIME: Duration = Duration::from_secs(1);

/// Interval at which the backlog of a slow client of a stream is checked.
const BACKLOG_PAUSE: Duration = Duration::from_millis(20);

/// Longest time without a set for a slow client of a stream: the measured backlog may exceed the actual one.
const LONGEST_SKIP: Duration = Duration::from_millis(1200);

/// Server-sent field that sets a client's delay before it connects again, milliseconds.
const RETRY: &str = "retry: 1000\n\n";

/// The light sets that one client of a stream gets, and the state of their delivery.
struct Feed {
    context: Context,
    variant: Variant,
    latest: watch::Receiver<Option<Arc<OwnedSet>>>,
    /// The client's connection; `None` for a request without a socket.
    connection: Option<Arc<ConnectionGuard>>,
    /// The id of the last event that the client has received; `None` before its first event.
    has: Option<String>,
    is_first: bool,
    /// Length of the last light set that was sent to the client, bytes.
    length: usize,
    /// Enlarged send buffer of the connection, held while light sets are long.
    enlarged: Option<Enlarged>,
    sent: Instant,
}

/// The next item that a stream sends.
enum Next {
    Set(Bytes),
    /// There is no light set yet; the stream sends a comment.
    None,
    /// The server shuts down, and the stream ends.
    Stop,
}

impl Feed {
    fn new(
        context: Context,
        variant: Variant,
        connection: Option<Arc<ConnectionGuard>>,
        has: Option<String>,
    ) -> Self {
        context.counts.streams.fetch_add(1, Relaxed);
        let latest = context.link.sets().subscribe();
        Self {
            context,
            variant,
            latest,
            connection,
            has,
            is_first: true,
            length: 0,
            enlarged: None,
            sent: Instant::now(),
        }
    }

    /// Returns the bytes of the next light set. If the client does not have the newest set, it is returned at once, else the set of the
    /// next frame for which the client has received enough of the last sets. After [`LONGEST_WAIT`] without a frame, the last set is
    /// returned again, marked stale.
    async fn next(&mut self) -> Next {
        let mut stop = self.context.stop.subscribe();
        let (ready, id) = loop {
            let is_late = if std::mem::take(&mut self.is_first) && self.has_news() {
                false
            } else {
                tokio::select! {
                    () = stopped(&mut stop) => return Next::Stop,
                    is_late = self.wait() => is_late,
                }
            };
            self.latest.mark_unchanged();
            let is_late = !wait_for_tier(&self.context, self.variant.selection).await || is_late;
            let ready =
                match self.context.answers.sets.newest(self.variant, &self.context.link, is_late).await {
                    Ok(ready) => ready,
                    Err(Missing::NoSet | Missing::Full) => return Next::None,
                    Err(Missing::Fault | Missing::TooLong(_)) => return Next::Stop,
                };
            let id = event_id(self.context.link.run(), ready.set.frame);
            // A set that was published between the notification and the read has been sent already.
            if is_late || self.has.as_ref() != Some(&id) {
                break (ready, id);
            }
        };
        self.has = Some(id);
        if !ready.is_stale {
            self.context.counts.delivered(since_ready(&ready.set));
        }
        (self.length, self.sent) = (ready.bytes.len(), Instant::now());
        if self.enlarged.is_none() {
            let length = self.length as u64;
            self.enlarged = self.connection.as_ref().and_then(|c| c.queues.enlarge(length));
        }
        Next::Set(ready.bytes)
    }

    /// Waits for a newer light set and for space in the queue of the client's connection; returns true if no newer
    /// set came within [`LONGEST_WAIT`].
    async fn wait(&self) -> bool {
        let newer = self.context.link.sets().newer(&self.latest);
        let is_late = tokio::time::timeout(LONGEST_WAIT, newer).await.is_err();
        // A slow client skips the light sets of the time of this loop and then gets the newest one.
        while self.is_backlogged() {
            tokio::time::sleep(BACKLOG_PAUSE).await;
        }
        is_late
    }

    /// Returns true if light sets are queued on the connection to the client.
    fn is_backlogged(&self) -> bool {
        let is_recent = self.sent.elapsed() < LONGEST_SKIP;
        is_recent && self.connection.as_ref().is_some_and(|c| c.queues.is_backlogged(2 * self.length))
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

/// Parses the query parameters of a stream.
fn variant(uri: &Uri, fixed: Option<Format>) -> Result<Variant, String> {
    match wanted(uri, &HeaderMap::new(), fixed) {
        Ok(SetQuery { variant: Variant { format: Format::File(form), .. }, .. }) => {
            Err(format!("found format {}, expected json, text, xml or binary in a stream", form.name()))
        }
        Ok(SetQuery { variant, after: None }) => Ok(variant),
        Ok(_) => Err("found after, expected none: a stream begins with the newest set".into()),
        Err(found) => Err(found.unwrap_or_default()),
    }
}

/// Answers with a stream of server-sent events; the data of each event is a light set as JSON.
pub(super) async fn events(
    State(context): State<Context>,
    uri: Uri,
    headers: HeaderMap,
    extensions: Extensions,
) -> Response {
    let mut variant = match variant(&uri, Some(Format::Event)) {
        Ok(variant) => variant,
        Err(found) => return line(StatusCode::BAD_REQUEST, &found),
    };
    let is_packed = accepts_gzip(&headers);
    if is_packed {
        variant.format = Format::PackedEvent;
    }
    let part = move |text: &'static str| {
        let bytes = || packed::part(text.as_bytes()).into();
        if is_packed { bytes() } else { Bytes::from_static(text.as_bytes()) }
    };
    let has = headers.get("last-event-id").and_then(|v| v.to_str().ok()).map(Into::into);
    let feed = Feed::new(context, variant, extensions.get().cloned(), has);
    let sets = futures_util::stream::unfold(feed, move |mut feed| async move {
        let bytes = match feed.next().await {
            Next::Set(bytes) => bytes,
            // The stream sends a comment: if the client has disconnected, the transmission fails and ends the
            // stream.
            Next::None => part(": no frame yet\n\n"),
            Next::Stop => return None,
        };
        Some((Ok::<_, Infallible>(bytes), feed))
    });
    let head: &[u8] = if is_packed { &packed::STREAM_HEAD } else { &[] };
    let first = futures_util::stream::iter([Ok(Bytes::from([head, &part(RETRY)].concat()))]);
    let no_buffer = (HeaderName::from_static("x-accel-buffering"), HeaderValue::from_static("no"));
    let head = [
        (CONTENT_TYPE, HeaderValue::from_static("text/event-stream")),
        (CACHE_CONTROL, HeaderValue::from_static("no-store")),
        (VARY, HeaderValue::from_static("accept-encoding")),
        no_buffer,
    ];
    let mut response = (head, Body::from_stream(first.chain(sets))).into_response();
    if is_packed {
        response.headers_mut().insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}

/// Upgrades the connection to a WebSocket: each message is a light set, as text unless `format=binary`.
pub(super) async fn socket(
    State(context): State<Context>,
    sender: Sender,
    extensions: Extensions,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    // Browsers let any page open a WebSocket to any server, and send the origin of the page.
    if sender.cause(&context.admission.origins) == Cause::ForeignPage {
        return access::foreign(&context, "a WebSocket opened by a page of another site");
    }
    let Ok(upgrade) = upgrade else {
        return line(
            StatusCode::UPGRADE_REQUIRED,
            "this is a WebSocket; GET /v1/events and /v1/lights need none",
        );
    };
    let variant = match variant(&sender.uri, None) {
        Ok(variant) => variant,
        Err(found) => return line(StatusCode::BAD_REQUEST, &found),
    };
    // The connection's permit is held until the socket is closed.
    let connection: Option<Arc<ConnectionGuard>> = extensions.get().cloned();
    let answering = connection.as_ref().map(|connection| connection.begin());
    // Messages above [`MESSAGE_BYTES`] are refused with close code 1009, see [`unless_closed`].
    let upgrade = upgrade.max_message_size(READ_BYTES).max_frame_size(READ_BYTES).write_buffer_size(0);
    upgrade.on_upgrade(move |socket| async move {
        push(socket, Feed::new(context, variant, connection, None)).await;
        drop(answering);
    })
}

/// Reasons why a WebSocket ends.
enum End {
    /// The client has closed the WebSocket or the connection.
    Client,
    /// The client has sent a message of more than [`MESSAGE_BYTES`].
    TooLarge,
}

/// Sends light sets until the client or the server ends the WebSocket.
async fn push(mut socket: WebSocket, mut feed: Feed) {
    let end = loop {
        let bytes = match unless_closed(&mut socket, feed.next()).await {
            Ok(Next::Set(bytes)) => bytes,
            Ok(Next::None) => continue,
            Ok(Next::Stop) => break (close_code::AWAY, "the probe stops"),
            Err(End::TooLarge) => break (close_code::SIZE, "messages of more than 1,024 bytes are refused"),
            // The library sends the answer to the client's close frame during the next read.
            Err(End::Client) => return finish(socket).await,
        };
        let message = if feed.variant.format == Format::Binary {
            Message::Binary(bytes)
        } else {
            // All forms but the binary one are UTF-8.
            Message::Text(Utf8Bytes::try_from(bytes).unwrap_or_default())
        };
        if socket.send(message).await.is_err() {
            return;
        }
    };
    let (code, reason) = end;
    let _ = socket.send(Message::Close(Some(CloseFrame { code, reason: reason.into() }))).await;
    finish(socket).await;
}

/// Exchanges close frames: reads until the client has ended the connection, at most for [`CLOSE_TIME`].
async fn finish(mut socket: WebSocket) {
    let rest = async { while let Some(Ok(_)) = socket.recv().await {} };
    let _ = tokio::time::timeout(CLOSE_TIME, rest).await;
}

/// Waits for `next` and meanwhile ignores messages of the client of at most [`MESSAGE_BYTES`]; returns an error
/// if the WebSocket ends.
async fn unless_closed<T>(socket: &mut WebSocket, next: impl Future<Output = T>) -> Result<T, End> {
    tokio::pin!(next);
    loop {
        tokio::select! {
            next = &mut next => return Ok(next),
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) if text.len() > MESSAGE_BYTES => return Err(End::TooLarge),
                Some(Ok(Message::Binary(bytes))) if bytes.len() > MESSAGE_BYTES => return Err(End::TooLarge),
                Some(Ok(Message::Close(_)) | Err(_)) | None => return Err(End::Client),
                Some(Ok(_)) => {}
            },
        }
    }
}
