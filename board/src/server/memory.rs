//! Limits on the memory of encoded answers that are cached or being sent, which would otherwise grow without bound with slow
//! clients.

use super::connection::ConnectionLimiter;
use axum::body::Bytes;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, Weak};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::Instant;

/// Length up to which an answer counts as small, bytes. Small and large answers have separate limits, so that large ones never delay small
/// ones.
const SMALL: usize = 2 << 20;

/// Limits on the total length of all small answers, and of all large ones, bytes.
const LIMITS: [usize; 2] = [6 << 20, 10 << 20];

/// Total length of all answers up to which an answer of any length is made, bytes: the size of the caches while no client is
/// served.
const IDLE: usize = KEPT_SET_BYTES + KEPT_PICTURE_BYTES;

/// Largest number of bytes of encoded light sets that stay cached while no client is being sent them.
pub(super) const KEPT_SET_BYTES: usize = 4 << 20;

/// Total length of the pictures that stay cached, bytes; a larger picture is shared only while it is being sent.
pub(super) const KEPT_PICTURE_BYTES: usize = 1 << 20;

/// Length of the longest answer that is made, bytes.
pub(super) const LONGEST: usize = 12 << 20;

/// Time of a blocked write after which a connection is closed when memory is short, milliseconds.
const BLOCKED_MS: u64 = 300;

/// Longest time between two searches for blocked connections while memory is short.
const PAUSE: Duration = Duration::from_millis(50);

/// Time after which a request that waits for memory is refused.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Counts the bytes of all encoded answers against the limits.
#[derive(Debug, Default)]
pub(super) struct AnswerMemory {
    live: Arc<[Live; 2]>,
    limiter: OnceLock<Arc<ConnectionLimiter>>,
}

/// The bytes of an encoded answer, counted against the limits until they are dropped.
#[derive(Debug)]
pub(super) struct Held {
    bytes: Vec<u8>,
    live: Arc<[Live; 2]>,
}

/// Returns the index in [`LIMITS`] of the limit for an answer of `length` bytes: 0 for small answers, 1 for
/// large ones.
const fn kind(length: usize) -> usize {
    (length > SMALL) as usize
}

/// Total length of the answers of one kind, small or large, that are cached or being sent, bytes.
#[derive(Debug, Default)]
struct Live {
    bytes: AtomicUsize,
    /// Notified when the bytes of an answer are dropped.
    dropped: Notify,
}

impl Live {
    /// Adds `length` bytes to the total and returns true, if the total then stays within `limit`.
    fn try_add(&self, length: usize, limit: usize) -> bool {
        let add = |live| (live <= IDLE || live + length <= limit).then_some(live + length);
        self.bytes.fetch_update(Relaxed, Relaxed, add).is_ok()
    }

    fn subtract(&self, length: usize) {
        self.bytes.fetch_sub(length, Relaxed);
        self.dropped.notify_waiters();
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let length = self.bytes.capacity();
        self.live[kind(length)].subtract(length);
    }
}

/// Memory reserved for an answer that is being encoded.
#[derive(Debug)]
pub(super) struct Reserved {
    length: usize,
    live: Arc<[Live; 2]>,
}

impl Reserved {
    /// Counts the encoded `bytes` in place of the reserved length, against the limit for answers of their
    /// length, and frees the part of their block that is not used.
    pub(super) fn hold(self, mut bytes: Vec<u8>) -> Arc<Held> {
        bytes.shrink_to_fit();
        let length = bytes.capacity();
        self.live[kind(length)].bytes.fetch_add(length, Relaxed);
        Arc::new(Held { bytes, live: Arc::clone(&self.live) })
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        self.live[kind(self.length)].subtract(self.length);
    }
}

/// A reference to the bytes of an encoded answer.
struct BodyBytes(Arc<Held>);

impl AsRef<[u8]> for BodyBytes {
    fn as_ref(&self) -> &[u8] {
        &self.0.bytes
    }
}

/// Returns the bytes of an encoded answer as the body of a response.
pub(super) fn body(held: &Arc<Held>) -> Bytes {
    Bytes::from_owner(BodyBytes(Arc::clone(held)))
}

/// The bytes of an answer in a cache: held by the cache, or, after [`Kept::release`], only as long as a client
/// is being sent them.
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

    /// Returns the number of bytes that the cache holds; 0 after [`Kept::release`].
    pub(super) fn len(&self) -> usize {
        self.strong.as_ref().map_or(0, |held| held.bytes.len())
    }

    /// Releases the cache's reference to the bytes, which then stay only while a client is being sent them.
    pub(super) fn release(&mut self) {
        self.strong = None;
    }
}

impl AnswerMemory {
    /// Sets the connection limiter, whose blocked connections are closed when memory is short.
    pub(super) fn relieve_by(&self, limiter: &Arc<ConnectionLimiter>) {
        let _ = self.limiter.set(Arc::clone(limiter));
    }

    /// Waits until there is memory for an answer of about `length` bytes, and meanwhile closes connections whose clients do not read.
    /// `None` if there is none after [`PATIENCE`].
    pub(super) async fn reserve(&self, length: usize) -> Option<Reserved> {
        let (live, limit) = (&self.live[kind(length)], LIMITS[kind(length)]);
        let deadline = Instant::now() + PATIENCE;
        loop {
            let dropped = live.dropped.notified();
            tokio::pin!(dropped);
            dropped.as_mut().enable();
            if live.try_add(length, limit) {
                return Some(Reserved { length, live: Arc::clone(&self.live) });
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

    const LARGE: usize = LIMITS[1];

    async fn hold(memory: &AnswerMemory, length: usize) -> Arc<Held> {
        memory.reserve(length).await.expect("memory").hold(vec![1; length])
    }

    #[tokio::test]
    async fn memory_is_counted_until_the_last_share_is_dropped() {
        let memory = AnswerMemory::default();
        let held = hold(&memory, LARGE).await;
        let (mut kept, sent) = (Kept::new(&held), body(&held));
        drop(held);
        assert!(memory.reserve(SMALL + 1).await.is_none(), "full");
        kept.release();
        assert_eq!(kept.find().map(|bytes| bytes.len()), Some(LARGE), "still being sent");
        drop(sent);
        assert!(kept.find().is_none() && memory.reserve(LARGE).await.is_some(), "gone");
        assert_eq!(memory.live[1].bytes.load(Relaxed), 0, "a reservation without an answer counts no longer");
    }

    #[tokio::test]
    async fn large_answers_leave_memory_to_small_ones() {
        let memory = AnswerMemory::default();
        let held = hold(&memory, LARGE).await;
        assert!(memory.reserve(SMALL + 1).await.is_none(), "a large one");
        assert!(memory.reserve(SMALL).await.is_some(), "a small one");
        drop(held);
        assert!(memory.reserve(2 * LARGE).await.is_some(), "any one when nothing else is held");
    }

    #[tokio::test]
    async fn an_answer_longer_than_expected_does_not_delay_small_ones() {
        let memory = AnswerMemory::default();
        let reserved = memory.reserve(1).await.expect("memory");
        let held = reserved.hold(vec![1; LARGE]);
        assert!(memory.reserve(SMALL).await.is_some(), "a small one");
        assert!(memory.reserve(SMALL + 1).await.is_none(), "it counts among the large ones");
        drop(held);
        let left = memory.live.each_ref().map(|live| live.bytes.load(Relaxed));
        assert_eq!(left, [0; 2], "nothing is left over");
    }

    #[tokio::test]
    async fn answers_that_are_being_made_count() {
        let memory = AnswerMemory::default();
        let making = memory.reserve(LARGE).await;
        assert!(memory.reserve(SMALL + 1).await.is_none(), "reserved");
        drop(making);
        assert!(memory.reserve(SMALL + 1).await.is_some(), "not any longer");
    }

    #[tokio::test]
    async fn a_dropped_answer_notifies_a_waiting_request() {
        struct Flag(AtomicBool);
        impl Wake for Flag {
            fn wake(self: Arc<Self>) {
                self.0.store(true, Relaxed);
            }
        }
        let memory = AnswerMemory::default();
        let held = hold(&memory, LARGE).await;
        let flag = Arc::new(Flag(AtomicBool::new(false)));
        let waker = Waker::from(Arc::clone(&flag));
        let mut waiting = std::pin::pin!(memory.reserve(SMALL + 1));
        assert!(waiting.as_mut().poll(&mut Context::from_waker(&waker)).is_pending(), "full");
        flag.0.store(false, Relaxed);
        drop(held);
        assert!(flag.0.load(Relaxed), "woken at once, not by the timer");
        assert!(waiting.await.is_some(), "there is memory");
    }
}
