//! Connections: how many, how long they may dawdle, and how they end.

use super::patience::Patient;
use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
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
    stop: watch::Sender<bool>,
    room: Arc<Semaphore>,
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
pub fn start(listener: std::net::TcpListener, app: Router, limits: Limits) -> io::Result<Running> {
    let runtime = Builder::new_multi_thread()
        .worker_threads(THREADS)
        .thread_name("hemilux-http")
        .enable_all()
        .build()?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let listener = runtime.block_on(async { TcpListener::from_std(listener) })?;
    let stop = watch::Sender::new(false);
    let room = Arc::new(Semaphore::new(limits.connections));
    let door = Door { app, limits, stop: stop.subscribe(), room: Arc::clone(&room) };
    let accepting = runtime.spawn(door.open(listener));
    Ok(Running { address, limits, runtime, stop, room, accepting })
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
        let all = u32::try_from(self.limits.connections).unwrap_or(u32::MAX);
        let gone = self.runtime.block_on(async {
            let _ = self.accepting.await;
            tokio::time::timeout(self.limits.grace, self.room.acquire_many(all)).await.is_ok()
        });
        if !gone {
            tracing::warn!("connections that did not end in {} ms were cut", self.limits.grace.as_millis());
        }
        self.runtime.shutdown_background();
    }
}

/// What lets connections in.
struct Door {
    app: Router,
    limits: Limits,
    stop: watch::Receiver<bool>,
    room: Arc<Semaphore>,
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
                Ok((stream, _)) => self.let_in(stream),
                Err(error) => {
                    tracing::warn!("a connection could not be taken: {error}");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    fn let_in(&self, stream: TcpStream) {
        let Ok(permit) = Arc::clone(&self.room).try_acquire_owned() else {
            // A fresh socket has room for this; if not, closing it must do.
            let _ = stream.try_write(BUSY);
            return;
        };
        tokio::spawn(attend(stream, self.app.clone(), self.limits, self.stop.clone(), permit));
    }
}

/// Waits until the server is told to stop, or is gone.
async fn told(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await;
}

/// Serves one connection until either side ends it.
async fn attend(
    stream: TcpStream,
    app: Router,
    limits: Limits,
    mut stop: watch::Receiver<bool>,
    permit: OwnedSemaphorePermit,
) {
    // Without it the end of an answer may wait 40 ms for the client's acknowledgement.
    let _ = stream.set_nodelay(true);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.head)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(Patient::new(stream, limits.stall)), TowerToHyperService::new(app));
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = told(&mut stop) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!("connection: {error}");
    }
    drop(permit);
}
