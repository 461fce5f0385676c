//! Accepts connections and serves HTTP on each.

use super::activity::{Activity, Answering};
use super::limiter::{ConnectionLimiter, Permit};
use super::stream::ClientStream;
use super::tcp::{self, Enlarged, Queues};
use super::{Limits, stopped};
use crate::server::App;
use crate::server::client_key::ClientKey;
use crate::server::counts::Counts;
use crate::server::proxy::Proxies;
use axum::Router;
use axum::body::{Body, Bytes, HttpBody};
use axum::http::header::CONNECTION;
use axum::http::{HeaderValue, Request};
use axum::response::Response;
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::convert::Infallible;
use std::error::Error;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// Largest head of a request, bytes; browsers send about one kilobyte.
const HEAD_BYTES: usize = 16 << 10;

/// Length of the pieces in which the body of an answer is sent, bytes.
const PIECE_BYTES: usize = 64 << 10;

/// Pause after the system call `accept` has failed, for example for lack of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// The answer to a connection beyond the limit on connections.
const BUSY: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\nContent-Length: 21\r\n\r\ntoo many connections\n";

/// Accepts TCP connections within the limits of the server.
pub(super) struct Acceptor {
    router: Router,
    counts: Arc<Counts>,
    proxies: Arc<Proxies>,
    limits: Limits,
    stop: watch::Receiver<bool>,
    limiter: Arc<ConnectionLimiter>,
}

impl Acceptor {
    pub(super) fn new(app: App, limits: Limits, limiter: Arc<ConnectionLimiter>) -> Self {
        let App { router, counts, stop, proxies, memory } = app;
        memory.relieve_by(&limiter);
        Self { router, counts, proxies, limits, stop: stop.subscribe(), limiter }
    }

    pub(super) async fn run(self, listener: TcpListener) {
        let mut stop = self.stop.clone();
        loop {
            let arrival = tokio::select! {
                arrival = listener.accept() => arrival,
                () = stopped(&mut stop) => return,
            };
            match arrival {
                Ok((stream, from)) => self.admit(stream, from),
                Err(error) => {
                    tracing::debug!("accept: {error}");
                    self.counts.refused("accept");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn admit(&self, stream: TcpStream, from: SocketAddr) {
        let address = from.ip().to_canonical();
        let client = (!self.proxies.contains(address)).then(|| ClientKey::of(address));
        let Some(permit) = self.limiter.try_acquire(client) else {
            self.counts.refused("connections");
            // The send buffer of a new socket has space for [`BUSY`].
            let _ = stream.try_write(BUSY);
            return;
        };
        tcp::prepare(&stream, self.limits.stall);
        let stream = Arc::new(stream);
        let guard = ConnectionGuard::new(permit, address, &stream, Arc::clone(&self.counts));
        tokio::spawn(serve_connection(stream, self.router.clone(), self.limits, self.stop.clone(), guard));
    }
}

/// The permit and the counters of a connection, held until the connection is closed; a WebSocket holds them after the HTTP exchange has ended.
#[derive(Debug)]
pub(in crate::server) struct ConnectionGuard {
    permit: Permit,
    /// The IP address of the other end of the connection: a client or a proxy.
    pub(in crate::server) address: IpAddr,
    pub(in crate::server) queues: Queues,
    counts: Arc<Counts>,
}

impl ConnectionGuard {
    fn new(permit: Permit, address: IpAddr, stream: &Arc<TcpStream>, counts: Arc<Counts>) -> Arc<Self> {
        permit.activity().attach(stream);
        counts.accepted.fetch_add(1, Relaxed);
        counts.open.fetch_add(1, Relaxed);
        Arc::new(Self { permit, address, queues: Queues::of(stream), counts })
    }

    /// Counts this connection of a proxy under `client`, whose request the proxy forwards.
    pub(in crate::server) fn assign(&self, client: ClientKey) {
        self.permit.assign(client);
    }

    /// Marks the connection as answering a request until the returned value is dropped.
    pub(in crate::server) fn begin(&self) -> Answering {
        self.activity().begin()
    }

    fn activity(&self) -> &Arc<Activity> {
        self.permit.activity()
    }
}

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.counts.open.fetch_sub(1, Relaxed);
    }
}

/// The body of an answer in pieces of [`PIECE_BYTES`]: the connection counts as answering until the last piece is being sent.
struct AnswerBody {
    body: Body,
    /// Bytes of the piece in progress that are not sent yet.
    rest: Bytes,
    _answering: Answering,
    _enlarged: Option<Enlarged>,
}

impl HttpBody for AnswerBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        if self.rest.is_empty() {
            let frame = match ready!(Pin::new(&mut self.body).poll_frame(cx)) {
                Some(Ok(frame)) => frame,
                end => return Poll::Ready(end),
            };
            match frame.into_data() {
                Ok(data) => self.rest = data,
                Err(other) => return Poll::Ready(Some(Ok(other))),
            }
        }
        let length = self.rest.len().min(PIECE_BYTES);
        Poll::Ready(Some(Ok(Frame::data(self.rest.split_to(length)))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (inner, rest) = (self.body.size_hint(), self.rest.len() as u64);
        let mut hint = SizeHint::new();
        hint.set_lower(inner.lower() + rest);
        if let Some(upper) = inner.upper() {
            hint.set_upper(upper + rest);
        }
        hint
    }
}

/// Serves one connection until the client or the server closes it.
async fn serve_connection(
    stream: Arc<TcpStream>,
    router: Router,
    limits: Limits,
    mut stop: watch::Receiver<bool>,
    guard: Arc<ConnectionGuard>,
) {
    let service = TowerToHyperService::new(router);
    let answer = service_fn(|request: Request<Incoming>| {
        let answering = guard.begin();
        let is_last = guard.activity().requests() >= limits.requests;
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Arc::clone(&guard));
        let (answer, theirs) = (service.call(request), Arc::clone(&guard));
        async move {
            let mut response: Response = answer.await?;
            if is_last {
                response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
            }
            let length = response.body().size_hint().exact().unwrap_or(0);
            let enlarged = theirs.queues.enlarge(length);
            let wrap =
                |body| AnswerBody { body, rest: Bytes::new(), _answering: answering, _enlarged: enlarged };
            Ok::<_, Infallible>(response.map(wrap))
        }
    });
    let stream = ClientStream::new(stream, limits.stall, Arc::clone(guard.activity()));
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.head)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), answer)
        .with_upgrades();
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = stopped(&mut stop) => {
            connection.as_mut().graceful_shutdown();
            let ended = connection.as_mut().await;
            // Without a reset, the kernel would keep unsent data after the end of the program.
            if guard.queues.is_backlogged(0) {
                guard.activity().cut();
            }
            ended
        }
    };
    if let Err(error) = ended {
        guard.counts.refused(reason_of(&error));
        tracing::debug!("connection: {error}");
    }
}

/// Returns the reason under which the end of a connection with `error` is counted; most errors are
/// disconnections by clients.
fn reason_of(error: &hyper::Error) -> &'static str {
    let kind = error.source().and_then(|e| e.downcast_ref::<io::Error>()).map(io::Error::kind);
    match kind {
        Some(io::ErrorKind::ConnectionAborted) => "displaced",
        Some(io::ErrorKind::TimedOut) => "slow",
        _ if error.is_timeout() => "slow",
        _ if error.is_parse() || error.is_parse_too_large() => "malformed",
        _ => "gone",
    }
}
