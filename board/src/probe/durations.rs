//! Durations of the stages of a frame, shared between the processing thread and the server.

use super::lock;
use crate::timing::{Budgets, Timings};
use hemilux_core::wire::{Latency, Overrun};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

/// The durations of the stages of all frames since the start, and of the last encoding of a light set.
#[derive(Debug)]
pub struct DurationLog {
    timings: Mutex<Timings>,
    encode_us: AtomicU32,
}

impl DurationLog {
    pub(super) fn new(budgets: Budgets) -> Self {
        Self { timings: Mutex::new(Timings::new(budgets)), encode_us: AtomicU32::new(0) }
    }

    /// Returns the durations of each stage since the start, and the numbers of frames that exceeded the budget
    /// of a stage.
    #[must_use]
    pub fn timings(&self) -> Timings {
        lock(&self.timings).clone()
    }

    /// Stores the duration of an encoding of a light set, `us` microseconds, which the [`Latency`] of the next
    /// frame reports.
    pub fn set_encode_us(&self, us: u32) {
        self.encode_us.store(us, Ordering::Relaxed);
    }

    pub(super) fn encode_us(&self) -> u32 {
        self.encode_us.load(Ordering::Relaxed)
    }

    pub(super) fn start_frame(&self, now: Instant) {
        lock(&self.timings).start_frame(now);
    }

    /// Adds the durations of a frame; one of `every` bursts is processed. Returns the stages that exceeded their budgets.
    pub(super) fn add(&self, latency: &Latency, every: u32) -> Overrun {
        lock(&self.timings).add(latency, every)
    }

    pub(super) fn set_budgets(&self, budgets: Budgets) {
        lock(&self.timings).set_budgets(budgets);
    }
}
