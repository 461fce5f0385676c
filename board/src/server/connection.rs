//! Connections: how many, how long they may dawdle, and how they end.

use super::App;
use super::counts::Counts;
use super::crowd::{Crowd, Full, Seat};
use super::patience::Patient;
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

/// Threads that serve: one encodes while the other goes on.
const THREADS: usize = 2;

/// Bytes of a request's head; browsers send about one kilobyte.
const HEAD_BYTES: usize = 16 << 10;

/// Pause after a connection could not be taken, as when the process has no more file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// What a connection over the limit is told.
const BUSY: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\nContent-Length: 21\r\n\r\ntoo many connections\n";

/// Bounds on what clients may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at a time: each takes a file descriptor and some 30 KB.
    pub connections: usize,
    /// Connections at a time from one address (of IPv6: one network of 64 bits).
    pub per_address: usize,
    /// Requests on one connection, after which the client has to make another: nobody keeps a place for ever.
    pub requests: u64,
    /// Longest time to send a request's head, and to say nothing between requests.
    pub head: Duration,
    /// Longest time without taking any of an answer.
    pub stall: Duration,
    /// Longest time to finish at shutdown: more than a request waits for a frame.
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

/// A server at work, on threads of its own; dropping it ends it at once, [`Running::stop`] ends it well.
pub struct Running {
    address: SocketAddr,
    limits: Limits,
    runtime: Runtime,
    stop: Arc<watch::Sender<bool>>,
    crowd: Arc<Crowd>,
    accepting: JoinHandle<()>,
}

/// SIGINT and SIGTERM, caught from now on.
pub struct Signals {
    interrupt: Signal,
    terminate: Signal,
}

/// Serves `app` to whoever connects to `listener`.
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
    let crowd = Crowd::new(limits.connections, limits.per_address);
    let door = Door { router, counts, limits, stop: stop.subscribe(), crowd: Arc::clone(&crowd) };
    let accepting = runtime.spawn(door.open(listener));
    Ok(Running { address, limits, runtime, stop, crowd, accepting })
}

impl Running {
    /// Where it listens.
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

    /// Takes no more connections, answers whoever waits and returns when all have gone, or after [`Limits::grace`].
    pub fn stop(self) {
        self.stop.send_replace(true);
        let gone = self.runtime.block_on(async {
            let _ = self.accepting.await;
            tokio::time::timeout(self.limits.grace, self.crowd.gone()).await.is_ok()
        });
        if !gone {
            tracing::warn!("connections that did not end in {} ms were cut", self.limits.grace.as_millis());
        }
        self.runtime.shutdown_background();
    }
}

/// What lets connections in.
struct Door {
    router: Router,
    counts: Arc<Counts>,
    limits: Limits,
    stop: watch::Receiver<bool>,
    crowd: Arc<Crowd>,
}

impl Door {
    async fn open(self, listener: TcpListener) {
        let mut stop = self.stop.clone();
        loop {
            let arrival = tokio::select! {
                arrival = listener.accept() => arrival,
                () = told(&mut stop) => return,
            };
            match arrival {
                Ok((stream, from)) => self.let_in(stream, from),
                Err(error) => {
                    tracing::warn!("a connection could not be taken: {error}");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn let_in(&self, stream: TcpStream, from: SocketAddr) {
        let seat = match self.crowd.seat(from.ip()) {
            Ok(seat) => seat,
            Err(full) => {
                let reason = if full == Full::All { "connections" } else { "connections of one address" };
                self.counts.refused(reason);
                // A fresh socket has room for this; if not, closing it must do.
                let _ = stream.try_write(BUSY);
                return;
            }
        };
        let visit = Visit::new(seat, Arc::clone(&self.counts));
        tokio::spawn(attend(stream, self.router.clone(), self.limits, self.stop.clone(), visit));
    }
}

/// Waits until the server is told to stop, or is gone.
pub(super) async fn told(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await;
}

/// A connection's place and count; a WebSocket keeps it after HTTP has ended.
#[derive(Debug)]
pub(super) struct Visit {
    _seat: Seat,
    counts: Arc<Counts>,
}

impl Visit {
    fn new(seat: Seat, counts: Arc<Counts>) -> Arc<Self> {
        counts.accepted.fetch_add(1, Relaxed);
        counts.open.fetch_add(1, Relaxed);
        Arc::new(Self { _seat: seat, counts })
    }
}

impl Drop for Visit {
    fn drop(&mut self) {
        self.counts.open.fetch_sub(1, Relaxed);
    }
}

/// Serves one connection until either side ends it.
async fn attend(
    stream: TcpStream,
    router: Router,
    limits: Limits,
    mut stop: watch::Receiver<bool>,
    visit: Arc<Visit>,
) {
    // Without it the end of an answer may wait 40 ms for the client's acknowledgement.
    let _ = stream.set_nodelay(true);
    let (asked, guest) = (AtomicU64::new(0), Arc::clone(&visit));
    let service = TowerToHyperService::new(router);
    let answer = service_fn(|request: Request<Incoming>| {
        let is_last = asked.fetch_add(1, Relaxed) + 1 >= limits.requests;
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Arc::clone(&guest));
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
        .serve_connection(TokioIo::new(Patient::new(stream, limits.stall)), answer)
        .with_upgrades();
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = told(&mut stop) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        visit.counts.refused(reason_of(&error));
        tracing::debug!("connection: {error}");
    }
}

/// Why a connection ended badly, as the counts name it; most are clients that went away, which is nobody's fault.
fn reason_of(error: &hyper::Error) -> &'static str {
    if error.is_timeout() {
        "slow"
    } else if error.is_parse() || error.is_parse_too_large() {
        "malformed"
    } else {
        "gone"
    }
}
