//! The state of the processing thread and of the source of bursts.

use super::lock;
use hemilux_core::wire::{Degraded, FrameFault, FramesLeftOut};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tokio::sync::watch;

/// The state of the processing thread and of the source, and the request to stop.
#[derive(Debug)]
pub struct ThreadStatus {
    failure: Mutex<Option<String>>,
    turns: AtomicU64,
    stopping: AtomicBool,
    /// True after the end of the processing thread.
    ended: watch::Sender<bool>,
    /// Number of frames since the start that were left out of the merge, by [`FrameFault::index`].
    left_out: [AtomicU64; FrameFault::ALL.len()],
    quality: Mutex<QualityStatus>,
}

/// The present steps by which the quality is lowered, and the numbers of changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QualityStatus {
    /// The kinds of quality reductions that are in effect.
    pub steps: Degraded,
    /// Number of times since the start that the quality was lowered by a step.
    pub down: u64,
    /// Number of times since the start that the quality was raised by a step.
    pub up: u64,
}

impl Default for ThreadStatus {
    fn default() -> Self {
        Self {
            failure: Mutex::new(None),
            turns: AtomicU64::new(0),
            stopping: AtomicBool::new(false),
            ended: watch::Sender::new(false),
            left_out: Default::default(),
            quality: Mutex::default(),
        }
    }
}

impl ThreadStatus {
    /// Returns the fault of the source; `None` while the source delivers bursts.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        lock(&self.failure).clone()
    }

    pub(super) fn set_failure(&self, reason: Option<String>) {
        *lock(&self.failure) = reason;
    }

    /// Returns the number of iterations of the processing thread, with or without a burst: at least two per second while the thread runs.
    #[must_use]
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    pub(super) fn count_turn(&self) {
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Requests that the processing thread ends after its present frame.
    pub(super) fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    /// Returns the name of each kind of contradiction between a frame and its burst, and the number of frames that were not merged because of
    /// it since the start.
    pub fn frames_left_out(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let counts = self.left_out.iter().map(|count| count.load(Ordering::Relaxed));
        FrameFault::ALL.iter().map(|fault| fault.name()).zip(counts)
    }

    pub(super) fn count_left_out(&self, frames: &FramesLeftOut) {
        for frame in frames.iter() {
            self.left_out[frame.fault.index()].fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the present steps by which the quality is lowered, and the numbers of changes since the start.
    #[must_use]
    pub fn quality(&self) -> QualityStatus {
        *lock(&self.quality)
    }

    pub(super) fn set_quality(&self, quality: QualityStatus) {
        *lock(&self.quality) = quality;
    }

    /// Waits for the end of the processing thread.
    pub async fn ended(&self) {
        let _ = self.ended.subscribe().wait_for(|ended| *ended).await;
    }

    pub(super) fn set_ended(&self) {
        self.ended.send_replace(true);
    }
}
