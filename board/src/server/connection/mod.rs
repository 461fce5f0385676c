//! Connections: start and shutdown of the server, and the limits on clients.

mod acceptor;
mod activity;
mod limiter;
mod stream;
mod tcp;

pub(super) use acceptor::ConnectionGuard;
pub(super) use limiter::ConnectionLimiter;
pub(super) use tcp::Enlarged;

use super::App;
use super::counts::Counts;
use crate::allocator;
use acceptor::Acceptor;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// Number of threads of the server that serve requests.
const THREADS: usize = 2;

/// Largest number of threads for blocking work: the systemd unit allows 64 tasks in all.
const BLOCKING_THREADS: usize = 8;

/// Number of file descriptors reserved for other uses than connections: cameras, files, and those of the
/// runtime.
const OTHER_DESCRIPTORS: u64 = 64;

/// Longest wait at the server's shutdown for the end of connections that were cut.
const CUT: Duration = Duration::from_millis(100);

/// Longest time after which the server returns freed memory to the system.
const TRIM: Duration = Duration::from_secs(60);

/// Number of answers after which it does so earlier, at most once in [`TRIM_CHECK`].
const TRIM_ANSWERS: u64 = 1000;

/// Interval at which the number of answers is read.
const TRIM_CHECK: Duration = Duration::from_secs(1);

/// Limits on the resources that clients use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Largest number of open connections: each takes a file descriptor, about 30 KB in the process and about 30 KB in the kernel.
    pub connections: usize,
    /// Largest number of open connections of one client (for IPv6: of one /64 network). A further connection displaces the client's
    /// connection of the lowest rank.
    pub per_address: usize,
    /// Largest number of requests on one connection, after which the server closes it.
    pub requests: u64,
    /// Timeout for the head of a request, and for the idle time of a connection between two requests.
    pub head: Duration,
    /// Timeout for an answer of which the client accepts no byte.
    pub stall: Duration,
    /// Time from the start of the server's shutdown after which the remaining connections are reset.
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
            grace: Duration::from_millis(500),
        }
    }
}

impl Limits {
    /// Returns these limits with the number of connections reduced to the available file descriptors, after raising the process's limit on
    /// descriptors where possible.
    ///
    /// # Errors
    /// The limit of the process is too low for `OTHER_DESCRIPTORS` file descriptors and one connection.
    pub fn within_descriptors(self) -> io::Result<Self> {
        let wanted = self.connections as u64 + OTHER_DESCRIPTORS;
        let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
        let most = maximum.map_or(wanted, |maximum| maximum.min(wanted));
        let raised = current.is_some_and(|current| current < most)
            && setrlimit(Resource::Nofile, Rlimit { current: Some(most), maximum }).is_ok();
        let allowed = if raised { most } else { current.unwrap_or(wanted).min(wanted) };
        let connections =
            usize::try_from(allowed.saturating_sub(OTHER_DESCRIPTORS)).unwrap_or(self.connections);
        if connections == 0 {
            let text = format!(
                "a limit of {allowed} file descriptors, expected more than {OTHER_DESCRIPTORS} (ulimit -n)"
            );
            return Err(io::Error::other(text));
        }
        Ok(Self { connections: connections.min(self.connections), ..self })
    }
}

/// A running server on threads of its own. Dropping it aborts the server, [`Running::stop`] shuts it down.
pub struct Running {
    address: SocketAddr,
    limits: Limits,
    runtime: Runtime,
    stop: Arc<watch::Sender<bool>>,
    limiter: Arc<ConnectionLimiter>,
    accepting: JoinHandle<()>,
}

/// The streams of the signals SIGINT, SIGTERM and SIGHUP that the process receives.
pub struct Signals {
    interrupt: Signal,
    terminate: Signal,
    hang_up: Signal,
}

/// Event that ended the wait of [`Running::wait`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The process received SIGINT or SIGTERM.
    Stop,
    /// SIGHUP was received: the configuration file must be read again.
    Reload,
    /// The future that was passed to [`Running::wait`] has ended.
    Ended,
}

/// Starts the threads that answer the connections of `listener` with `app`, within `limits`.
///
/// # Errors
/// The operating system cannot start threads or refuses the listener.
pub fn start(listener: std::net::TcpListener, app: App, limits: Limits) -> io::Result<Running> {
    let runtime = Builder::new_multi_thread()
        .worker_threads(THREADS)
        .max_blocking_threads(BLOCKING_THREADS)
        .thread_name("hemilux-http")
        .enable_all()
        .build()?;
    tcp::prepare_listener(&listener)?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let listener = runtime.block_on(async { TcpListener::from_std(listener) })?;
    let limiter = ConnectionLimiter::new(limits.connections, limits.per_address);
    let (stop, counts) = (Arc::clone(&app.stop), Arc::clone(&app.counts));
    let acceptor = Acceptor::new(app, limits, Arc::clone(&limiter));
    let accepting = runtime.spawn(acceptor.run(listener));
    runtime.spawn(return_memory(counts));
    Ok(Running { address, limits, runtime, stop, limiter, accepting })
}

/// Returns freed memory to the system after [`TRIM_ANSWERS`] answers or [`TRIM`], until the runtime ends. Answers and pipelines of different
/// sizes leave free pages between used blocks of the allocator's arena, which otherwise stay resident.
async fn return_memory(counts: Arc<Counts>) {
    let mut due = tokio::time::interval(TRIM_CHECK);
    let (mut returned, mut at) = (Instant::now(), 0);
    loop {
        due.tick().await;
        let answers = counts.answers();
        if answers - at >= TRIM_ANSWERS || returned.elapsed() >= TRIM {
            allocator::return_free_pages();
            (returned, at) = (Instant::now(), answers);
        }
    }
}

impl Running {
    /// Returns the address on which the server listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Catches the signals SIGINT, SIGTERM and SIGHUP of the process.
    ///
    /// # Errors
    /// The operating system refuses a signal handler.
    pub fn signals(&self) -> io::Result<Signals> {
        let _inside = self.runtime.enter();
        Ok(Signals {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hang_up: signal(SignalKind::hangup())?,
        })
    }

    /// Waits for a signal to the process or for the end of `other`.
    pub fn wait(&self, signals: &mut Signals, other: impl Future<Output = ()>) -> Event {
        self.runtime.block_on(async {
            tokio::select! {
                _ = signals.interrupt.recv() => Event::Stop,
                _ = signals.terminate.recv() => Event::Stop,
                _ = signals.hang_up.recv() => Event::Reload,
                () = other => Event::Ended,
            }
        })
    }

    /// Shuts the server down: it accepts no more connections, answers the requests in progress and returns when all connections are
    /// closed. After [`Limits::grace`], the remaining connections are reset.
    pub fn stop(self) {
        self.stop.send_replace(true);
        self.runtime.block_on(async {
            let _ = self.accepting.await;
            if tokio::time::timeout(self.limits.grace, self.limiter.wait_empty()).await.is_err() {
                tracing::warn!("reset connections that did not end in {} ms", self.limits.grace.as_millis());
                self.limiter.cut_all();
                let _ = tokio::time::timeout(CUT, self.limiter.wait_empty()).await;
            }
        });
        self.runtime.shutdown_background();
    }
}

/// Waits until the shutdown of the server begins.
pub(super) async fn stopped(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await;
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use super::*;
    use crate::allocator::tests::{FreedMemory, alone};

    #[test]
    fn after_a_thousand_answers_freed_memory_returns_to_the_system() {
        alone(
            "server::connection::tests::after_a_thousand_answers_freed_memory_returns_to_the_system",
            || {
                let runtime =
                    Builder::new_multi_thread().worker_threads(1).enable_time().build().expect("a runtime");
                let counts = Arc::new(Counts::default());
                runtime.spawn(return_memory(Arc::clone(&counts)));
                let memory = FreedMemory::new();
                (0..TRIM_ANSWERS).for_each(|_| counts.answered("/v1/lights", 200));
                let began = Instant::now();
                while !memory.is_returned() {
                    assert!(began.elapsed() < Duration::from_secs(30), "no memory was returned");
                    std::thread::sleep(Duration::from_millis(100));
                }
                runtime.shutdown_background();
            },
        );
    }
}
