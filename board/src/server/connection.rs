//! Connections: their number, their idle and stall timeouts, and shutdown.

use super::App;
use super::counts::Counts;
use super::limiter::{ConnectionLimiter, LimitReached, Permit};
use super::stall::StallTimeout;
use axum::Router;
use axum::body::Body;
use axum::http::header::CONNECTION;
use axum::http::{HeaderValue, Request};
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// Threads that serve requests: one can encode a set while the other serves.
const THREADS: usize = 2;

/// Bytes of a request's head; browsers send about one kilobyte.
const HEAD_BYTES: usize = 16 << 10;

/// Pause after `accept` has failed, for example for lack of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// The answer to a connection over the limit.
const BUSY: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\nContent-Length: 21\r\n\r\ntoo many connections\n";

/// Limits on clients' use of resources.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at a time: each takes a file descriptor and some 30 KB.
    pub connections: usize,
    /// Connections at a time from one address (of IPv6: one network of 64 bits).
    pub per_address: usize,
    /// Requests on one connection, after which the server closes it.
    pub requests: u64,
    /// Timeout for the head of a request, and for the idle time between requests.
    pub head: Duration,
    /// Timeout for an answer of which the client accepts no byte.
    pub stall: Duration,
    /// Timeout for the shutdown of all connections: longer than a request waits for a frame.
    pub grace: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 256,
            per_address: 32,
            requests: 100_000,
            head: Duration::from_secs(5),
            stall: Duration::from_secs(10),
            grace: Duration::from_millis(2500),
        }
    }
}

/// A running server on its own threads. Dropping it aborts it, [`Running::stop`] shuts it down.
pub struct Running {
    address: SocketAddr,
    limits: Limits,
    runtime: Runtime,
    stop: Arc<watch::Sender<bool>>,
    limiter: Arc<ConnectionLimiter>,
    accepting: JoinHandle<()>,
}

/// SIGINT and SIGTERM, caught from now on.
pub struct Signals {
    interrupt: Signal,
    terminate: Signal,
}

/// Serves `app` on `listener`.
///
/// # Errors
/// The operating system gives no threads or refuses the listener.
pub fn start(listener: std::net::TcpListener, app: App, limits: Limits) -> io::Result<Running> {
    let runtime = Builder::new_multi_thread()
        .worker_threads(THREADS)
        .thread_name("hemilux-http")
        .enable_all()
        .build()?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let listener = runtime.block_on(async { TcpListener::from_std(listener) })?;
    let App { router, stop, counts } = app;
    let limiter = ConnectionLimiter::new(limits.connections, limits.per_address);
    let acceptor = Acceptor { router, counts, limits, stop: stop.subscribe(), limiter: Arc::clone(&limiter) };
    let accepting = runtime.spawn(acceptor.run(listener));
    Ok(Running { address, limits, runtime, stop, limiter, accepting })
}

impl Running {
    /// The address that it listens on.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Catches SIGINT and SIGTERM.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn signals(&self) -> io::Result<Signals> {
        let _inside = self.runtime.enter();
        Ok(Signals {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
        })
    }

    /// Waits for SIGINT or SIGTERM.
    pub fn wait(&self, signals: &mut Signals) {
        self.runtime.block_on(async {
            tokio::select! {
                _ = signals.interrupt.recv() => (),
                _ = signals.terminate.recv() => (),
            }
        });
    }

    /// Accepts no more connections, answers waiting requests and returns when all connections are closed, or after [`Limits::grace`].
    pub fn stop(self) {
        self.stop.send_replace(true);
        let gone = self.runtime.block_on(async {
            let _ = self.accepting.await;
            tokio::time::timeout(self.limits.grace, self.limiter.wait_empty()).await.is_ok()
        });
        if !gone {
            tracing::warn!("connections that did not end in {} ms were cut", self.limits.grace.as_millis());
        }
        self.runtime.shutdown_background();
    }
}

/// Accepts connections.
struct Acceptor {
    router: Router,
    counts: Arc<Counts>,
    limits: Limits,
    stop: watch::Receiver<bool>,
    limiter: Arc<ConnectionLimiter>,
}

impl Acceptor {
    async fn run(self, listener: TcpListener) {
        let mut stop = self.stop.clone();
        loop {
            let arrival = tokio::select! {
                arrival = listener.accept() => arrival,
                () = stopped(&mut stop) => return,
            };
            match arrival {
                Ok((stream, from)) => self.admit(stream, from),
                Err(error) => {
                    tracing::warn!("a connection could not be taken: {error}");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn admit(&self, stream: TcpStream, from: SocketAddr) {
        let permit = match self.limiter.try_acquire(from.ip()) {
            Ok(permit) => permit,
            Err(full) => {
                let reason =
                    if full == LimitReached::All { "connections" } else { "connections of one address" };
                self.counts.refused(reason);
                // A fresh socket has room for this; if not, closing it must do.
                let _ = stream.try_write(BUSY);
                return;
            }
        };
        let guard = ConnectionGuard::new(permit, Arc::clone(&self.counts));
        tokio::spawn(serve_connection(stream, self.router.clone(), self.limits, self.stop.clone(), guard));
    }
}

/// Waits for the shutdown of the server.
pub(super) async fn stopped(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await;
}

/// The permit and the count of a connection, which a WebSocket keeps after the HTTP exchange has ended.
#[derive(Debug)]
pub(super) struct ConnectionGuard {
    _permit: Permit,
    counts: Arc<Counts>,
}

impl ConnectionGuard {
    fn new(permit: Permit, counts: Arc<Counts>) -> Arc<Self> {
        counts.accepted.fetch_add(1, Relaxed);
        counts.open.fetch_add(1, Relaxed);
        Arc::new(Self { _permit: permit, counts })
    }
}

impl Drop for ConnectionGuard {
    fn drop(&mut self) {
        self.counts.open.fetch_sub(1, Relaxed);
    }
}

/// Serves one connection until either side ends it.
async fn serve_connection(
    stream: TcpStream,
    router: Router,
    limits: Limits,
    mut stop: watch::Receiver<bool>,
    guard: Arc<ConnectionGuard>,
) {
    // Without it the end of an answer may wait 40 ms for the client's acknowledgement.
    let _ = stream.set_nodelay(true);
    let (asked, shared_guard) = (AtomicU64::new(0), Arc::clone(&guard));
    let service = TowerToHyperService::new(router);
    let answer = service_fn(|request: Request<Incoming>| {
        let is_last = asked.fetch_add(1, Relaxed) + 1 >= limits.requests;
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Arc::clone(&shared_guard));
        let answer = service.call(request);
        async move {
            let mut response: Response = answer.await?;
            if is_last {
                response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
            }
            Ok::<_, Infallible>(response)
        }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.head)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(StallTimeout::new(stream, limits.stall)), answer)
        .with_upgrades();
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = stopped(&mut stop) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        guard.counts.refused(reason_of(&error));
        tracing::debug!("connection: {error}");
    }
}

/// The reason under which the end of a connection is counted; most are clients that disconnected.
fn reason_of(error: &hyper::Error) -> &'static str {
    if error.is_timeout() {
        "slow"
    } else if error.is_parse() || error.is_parse_too_large() {
        "malformed"
    } else {
        "gone"
    }
}
