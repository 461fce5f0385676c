//! The state of a connection: the progress of its client, and whether the server has closed it.

use super::tcp;
use futures_util::task::AtomicWaker;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, Weak};
use std::task::Context;
use std::time::Instant;
use tokio::net::TcpStream;

/// Time of a blocked write after which a connection counts as stalled, milliseconds.
const STALLED_MS: u64 = 1000;

/// Rank of a connection by the progress of its client, ascending: at a limit, the connection of the lowest rank is displaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Rank {
    /// The connection has no complete request so far; the field is the time of its arrival.
    Unfinished(u64),
    /// The connection is between two requests; the field is the time at which its last answer ended.
    Idle(u64),
    /// An answer on the connection is blocked because the client does not read; the field is the time at which
    /// the answer was blocked.
    Stalled(u64),
    /// A request on the connection is being answered; the field is the number of bytes that the client has
    /// received.
    Answering(u64),
}

/// Progress of a connection, shared between its stream, its requests and the limiter.
#[derive(Debug)]
pub(in crate::server) struct Activity {
    epoch: Instant,
    /// Number of requests of the connection with complete heads.
    requests: AtomicU64,
    /// Number of requests of the connection that are being answered.
    answering: AtomicU64,
    /// Number of bytes of answers that the kernel has accepted for the client.
    taken: AtomicU64,
    /// Time of the connection's last change between idle and answering, milliseconds since `epoch`.
    changed_ms: AtomicU64,
    /// Time at which the write in progress was blocked, milliseconds since `epoch`; [`u64::MAX`] while no write
    /// is blocked.
    blocked_ms: AtomicU64,
    is_cut: AtomicBool,
    waker: AtomicWaker,
    /// The connection's socket, while it is open.
    socket: OnceLock<Weak<TcpStream>>,
}

impl Activity {
    /// Returns the state of a new connection; times count from `epoch`.
    pub(super) fn new(epoch: Instant) -> Arc<Self> {
        let activity = Self {
            epoch,
            requests: AtomicU64::new(0),
            answering: AtomicU64::new(0),
            taken: AtomicU64::new(0),
            changed_ms: AtomicU64::new(0),
            blocked_ms: AtomicU64::new(u64::MAX),
            is_cut: AtomicBool::new(false),
            waker: AtomicWaker::new(),
            socket: OnceLock::new(),
        };
        activity.changed_ms.store(activity.now_ms(), Relaxed);
        Arc::new(activity)
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.epoch.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Counts a request of the connection as being answered until the returned value is dropped.
    pub(in crate::server) fn begin(self: &Arc<Self>) -> Answering {
        self.requests.fetch_add(1, Relaxed);
        self.answering.fetch_add(1, Relaxed);
        self.changed_ms.store(self.now_ms(), Relaxed);
        Answering(Arc::clone(self))
    }

    /// Returns the number of requests of the connection with complete heads.
    pub(super) fn requests(&self) -> u64 {
        self.requests.load(Relaxed)
    }

    /// Adds `bytes` to the number of bytes that the client has received; a blocked write has then ended.
    pub(super) fn progress(&self, bytes: usize) {
        self.taken.fetch_add(bytes as u64, Relaxed);
        self.blocked_ms.store(u64::MAX, Relaxed);
    }

    /// Records that a write is blocked from now on, unless a write is blocked already.
    pub(super) fn blocked(&self) {
        let _ = self.blocked_ms.compare_exchange(u64::MAX, self.now_ms(), Relaxed, Relaxed);
    }

    /// Returns the rank of the connection, by which the limiter selects the one to displace.
    pub(super) fn rank(&self) -> Rank {
        let blocked = self.blocked_ms.load(Relaxed);
        if self.now_ms().saturating_sub(STALLED_MS) >= blocked {
            Rank::Stalled(blocked)
        } else if self.answering.load(Relaxed) > 0 {
            Rank::Answering(self.taken.load(Relaxed))
        } else if self.requests() == 0 {
            Rank::Unfinished(self.changed_ms.load(Relaxed))
        } else {
            Rank::Idle(self.changed_ms.load(Relaxed))
        }
    }

    /// Stores the socket of the connection, which [`Activity::cut`] resets.
    pub(super) fn attach(&self, stream: &Arc<TcpStream>) {
        let _ = self.socket.set(Arc::downgrade(stream));
    }

    /// Returns the time for which a write of the connection has been blocked, milliseconds; 0 while none is
    /// blocked.
    pub(super) fn blocked_for_ms(&self) -> u64 {
        self.now_ms().saturating_sub(self.blocked_ms.load(Relaxed))
    }

    /// Ends the connection: reads and writes of its stream fail from now on. The kernel resets the socket, also if the program ends
    /// before the connection's task runs again.
    pub(super) fn cut(&self) {
        if let Some(stream) = self.socket.get().and_then(Weak::upgrade) {
            tcp::reset_on_close(&stream);
        }
        self.is_cut.store(true, Relaxed);
        self.waker.wake();
    }

    /// Returns true if the connection was cut. Otherwise a later [`Activity::cut`] wakes the task of `cx`.
    pub(super) fn poll_cut(&self, cx: &Context<'_>) -> bool {
        self.waker.register(cx.waker());
        self.is_cut.load(Relaxed)
    }
}

/// A request of a connection that is being answered; it ends on drop.
#[derive(Debug)]
pub(in crate::server) struct Answering(Arc<Activity>);

impl Drop for Answering {
    fn drop(&mut self) {
        self.0.changed_ms.store(self.0.now_ms(), Relaxed);
        self.0.answering.fetch_sub(1, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_rank_by_the_progress_of_their_clients() {
        let activity = Activity::new(Instant::now());
        assert!(matches!(activity.rank(), Rank::Unfinished(_)), "no request yet");
        let request = activity.begin();
        activity.progress(100);
        assert_eq!(activity.rank(), Rank::Answering(100), "one request");
        drop(request);
        assert!(matches!(activity.rank(), Rank::Idle(_)), "answered");
        activity.blocked_ms.store(0, Relaxed);
        let activity = Activity {
            epoch: Instant::now() - std::time::Duration::from_secs(2),
            ..Arc::into_inner(activity).expect("one owner")
        };
        assert_eq!(activity.rank(), Rank::Stalled(0), "blocked for two seconds");
        let order =
            [Rank::Unfinished(9), Rank::Idle(7), Rank::Stalled(3), Rank::Answering(0), Rank::Answering(1)];
        assert!(order.is_sorted(), "{order:?}");
    }
}
