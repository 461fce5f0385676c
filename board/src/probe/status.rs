//! The state of the processing thread and of the source.

use super::lock;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tokio::sync::watch;

/// The state of the processing thread and of the source, and the request to stop.
#[derive(Debug)]
pub struct ThreadStatus {
    failure: Mutex<Option<String>>,
    turns: AtomicU64,
    stopping: AtomicBool,
    /// True when the processing thread has ended.
    ended: watch::Sender<bool>,
}

impl Default for ThreadStatus {
    fn default() -> Self {
        Self {
            failure: Mutex::new(None),
            turns: AtomicU64::new(0),
            stopping: AtomicBool::new(false),
            ended: watch::Sender::new(false),
        }
    }
}

impl ThreadStatus {
    /// The fault of the source; `None` while the source delivers bursts.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        lock(&self.failure).clone()
    }

    pub(super) fn set_failure(&self, reason: Option<String>) {
        *lock(&self.failure) = reason;
    }

    /// Number of iterations of the processing thread, with or without a burst: at least two per second while the thread runs.
    #[must_use]
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    pub(super) fn count_turn(&self) {
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Requests the end of the processing thread.
    pub(super) fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    /// Waits for the end of the processing thread.
    pub async fn ended(&self) {
        let _ = self.ended.subscribe().wait_for(|ended| *ended).await;
    }

    pub(super) fn set_ended(&self) {
        self.ended.send_replace(true);
    }
}
