//! The memory of answers that are kept or being sent, which slow clients could otherwise let grow without bound.

use super::connection::ConnectionLimiter;
use axum::body::Bytes;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, OnceLock, Weak};
use std::time::Duration;

/// Bytes of all answers above which connections that do not read are cut before another answer is made.
const LIMIT: usize = 16 << 20;

/// Time of a blocked write after which a connection is cut for want of memory, milliseconds.
const BLOCKED_MS: u64 = 300;

/// Time between two looks at the memory.
const PAUSE: Duration = Duration::from_millis(50);

/// Number of looks before a request is refused.
const LOOKS: u32 = 30;

/// Counts the bytes of answers.
#[derive(Debug, Default)]
pub(super) struct AnswerMemory {
    live: Arc<AtomicUsize>,
    limiter: OnceLock<Arc<ConnectionLimiter>>,
}

/// The bytes of an answer, counted until they are dropped.
#[derive(Debug)]
pub(super) struct Held {
    bytes: Vec<u8>,
    live: Arc<AtomicUsize>,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.live.fetch_sub(self.bytes.capacity(), Relaxed);
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
        self.live.fetch_add(bytes.capacity(), Relaxed);
        Arc::new(Held { bytes, live: Arc::clone(&self.live) })
    }

    /// Waits until another answer may be made, and cuts connections that do not read while there is too little memory for it.
    pub(super) async fn room(&self) -> Option<()> {
        for _ in 0..LOOKS {
            if self.live.load(Relaxed) < LIMIT {
                return Some(());
            }
            if let Some(limiter) = self.limiter.get() {
                limiter.cut_blocked(BLOCKED_MS);
            }
            tokio::time::sleep(PAUSE).await;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn memory_is_counted_until_the_last_share_is_dropped() {
        let memory = AnswerMemory::default();
        let held = memory.hold(vec![1; LIMIT]);
        let (mut kept, sent) = (Kept::new(&held), body(&held));
        drop(held);
        assert_eq!(memory.room().await, None, "full");
        kept.release();
        assert_eq!(kept.find().map(|bytes| bytes.len()), Some(LIMIT), "still being sent");
        drop(sent);
        assert!(kept.find().is_none() && memory.room().await.is_some(), "gone");
    }
}
