//! The memory of answers that are kept or being sent, which slow clients could otherwise let grow without bound.

use super::connection::ConnectionLimiter;
use axum::body::Bytes;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, Weak};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Most bytes of all answers, the next one included.
const LIMIT: usize = 14 << 20;

/// Part of [`LIMIT`] that only answers of at most [`SMALL`] bytes may use, so that large ones never delay them.
const RESERVE: usize = 4 << 20;

/// Length of a small answer, bytes.
const SMALL: usize = 2 << 20;

/// Bytes of all answers up to which the next one is made whatever its length: caches keep as much while no client is served.
const IDLE: usize = super::sets::KEPT_BYTES + super::picture_cache::KEPT_BYTES;

/// Time of a blocked write after which a connection is cut for want of memory, milliseconds.
const BLOCKED_MS: u64 = 300;

/// Longest time between two searches for blocked connections.
const PAUSE: Duration = Duration::from_millis(50);

/// Time after which a request is refused for want of memory.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Counts the bytes of answers.
#[derive(Debug, Default)]
pub(super) struct AnswerMemory {
    live: Arc<Live>,
    limiter: OnceLock<Arc<ConnectionLimiter>>,
}

/// The bytes of an answer, counted until they are dropped.
#[derive(Debug)]
pub(super) struct Held {
    bytes: Vec<u8>,
    live: Arc<Live>,
}

/// Number of bytes of all answers.
#[derive(Debug, Default)]
struct Live {
    bytes: AtomicUsize,
    /// Notified when bytes are dropped.
    dropped: Notify,
}

impl Live {
    /// Whether an answer of about `length` bytes may be made.
    fn admits(&self, length: usize) -> bool {
        let limit = if length > SMALL { LIMIT - RESERVE } else { LIMIT };
        let live = self.bytes.load(Relaxed);
        live <= IDLE || live + length <= limit
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.live.bytes.fetch_sub(self.bytes.capacity(), Relaxed);
        self.live.dropped.notify_waiters();
    }
}

/// A share of an answer's bytes.
struct Share(Arc<Held>);

impl AsRef<[u8]> for Share {
    fn as_ref(&self) -> &[u8] {
        &self.0.bytes
    }
}

/// The bytes of an answer as a body.
pub(super) fn body(held: &Arc<Held>) -> Bytes {
    Bytes::from_owner(Share(Arc::clone(held)))
}

/// The bytes of an answer that a cache keeps: by itself, or only as long as a client is being sent them.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    strong: Option<Arc<Held>>,
    weak: Weak<Held>,
}

impl Kept {
    pub(super) fn new(held: &Arc<Held>) -> Self {
        Self { strong: Some(Arc::clone(held)), weak: Arc::downgrade(held) }
    }

    pub(super) fn find(&self) -> Option<Bytes> {
        self.weak.upgrade().map(|held| body(&held))
    }

    /// Number of bytes that are here only because they are kept.
    pub(super) fn len(&self) -> usize {
        self.strong.as_ref().map_or(0, |held| held.bytes.len())
    }

    /// Keeps the bytes no longer than they are being sent.
    pub(super) fn release(&mut self) {
        self.strong = None;
    }
}

impl AnswerMemory {
    /// Tells which connections are to be cut for want of memory.
    pub(super) fn relieve_by(&self, limiter: &Arc<ConnectionLimiter>) {
        let _ = self.limiter.set(Arc::clone(limiter));
    }

    pub(super) fn hold(&self, bytes: Vec<u8>) -> Arc<Held> {
        self.live.bytes.fetch_add(bytes.capacity(), Relaxed);
        Arc::new(Held { bytes, live: Arc::clone(&self.live) })
    }

    /// Waits until an answer of about `length` bytes may be made, and cuts connections that do not read while it may not. `None` after
    /// [`PATIENCE`].
    pub(super) async fn reserve(&self, length: usize) -> Option<()> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let dropped = self.live.dropped.notified();
            tokio::pin!(dropped);
            dropped.as_mut().enable();
            if self.live.admits(length) {
                return Some(());
            }
            if Instant::now() >= deadline {
                return None;
            }
            if let Some(limiter) = self.limiter.get() {
                limiter.cut_blocked(BLOCKED_MS);
            }
            let _ = tokio::time::timeout(PAUSE, dropped).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;
    use std::task::{Context, Wake, Waker};

    #[tokio::test]
    async fn memory_is_counted_until_the_last_share_is_dropped() {
        let memory = AnswerMemory::default();
        let held = memory.hold(vec![1; LIMIT]);
        let (mut kept, sent) = (Kept::new(&held), body(&held));
        drop(held);
        assert_eq!(memory.reserve(1).await, None, "full");
        kept.release();
        assert_eq!(kept.find().map(|bytes| bytes.len()), Some(LIMIT), "still being sent");
        drop(sent);
        assert!(kept.find().is_none() && memory.reserve(1).await.is_some(), "gone");
    }

    #[tokio::test]
    async fn large_answers_leave_memory_to_small_ones() {
        let memory = AnswerMemory::default();
        let held = memory.hold(vec![1; LIMIT - RESERVE]);
        assert_eq!(memory.reserve(SMALL + 1).await, None, "a large one");
        assert!(memory.reserve(SMALL).await.is_some(), "a small one");
        drop(held);
        assert!(memory.reserve(2 * LIMIT).await.is_some(), "any one when nothing else is held");
    }

    #[tokio::test]
    async fn a_dropped_answer_wakes_a_waiting_one() {
        struct Flag(AtomicBool);
        impl Wake for Flag {
            fn wake(self: Arc<Self>) {
                self.0.store(true, Relaxed);
            }
        }
        let memory = AnswerMemory::default();
        let held = memory.hold(vec![1; LIMIT]);
        let flag = Arc::new(Flag(AtomicBool::new(false)));
        let waker = Waker::from(Arc::clone(&flag));
        let mut waiting = std::pin::pin!(memory.reserve(1));
        assert!(waiting.as_mut().poll(&mut Context::from_waker(&waker)).is_pending(), "full");
        flag.0.store(false, Relaxed);
        drop(held);
        assert!(flag.0.load(Relaxed), "woken at once, not by the timer");
        assert_eq!(waiting.await, Some(()), "there is memory");
    }
}
