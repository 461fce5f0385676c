//! Bursts in the packing of the driver, and their transfer from the capture thread.

use super::terms::Terms;
use crate::camera_status::CameraStatus;
use crate::v4l2::frame::{Counters, RawFrame};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// A burst in the packing of the driver.
#[derive(Clone, Debug)]
pub struct RawBurst {
    /// One frame for each exposure, ascending by exposure time.
    pub frames: Vec<RawFrame>,
    /// The negotiated terms of the camera that took the burst.
    pub terms: Arc<Terms>,
}

impl RawBurst {
    pub(super) fn none(terms: &Arc<Terms>) -> Self {
        Self { frames: Vec::new(), terms: Arc::clone(terms) }
    }

    /// Returns a CLOCK_MONOTONIC time before the first exposure of the burst began, nanoseconds: drivers take a frame's timestamp at the
    /// frame's start or on its arrival, at most a frame period and the exposure time later.
    #[must_use]
    pub fn before_ns(&self) -> u64 {
        let began = |(frame, s): (&RawFrame, &f64)| {
            frame.taken.timestamp_ns.saturating_sub(self.terms.period_ns).saturating_sub((s * 1e9) as u64)
        };
        self.frames.iter().zip(&self.terms.seconds).map(began).min().unwrap_or(0)
    }

    /// Returns the CLOCK_MONOTONIC timestamp of the frame with the shortest exposure, nanoseconds.
    #[must_use]
    pub fn shortest_ns(&self) -> u64 {
        let frames = self.frames.iter().zip(&self.terms.seconds);
        frames.min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(frame, _)| frame.taken.timestamp_ns)
    }

    /// Returns the CLOCK_MONOTONIC timestamp of the newest frame of the burst, nanoseconds.
    #[must_use]
    pub fn timestamp_ns(&self) -> u64 {
        self.frames.iter().map(|f| f.taken.timestamp_ns).max().unwrap_or(0)
    }
}

/// A client's request for other exposure times of the camera.
#[derive(Clone, Debug)]
pub(super) struct Request {
    /// Number of the request, from 1; 0 for the exposures with which the camera is opened.
    pub number: u64,
    /// Exposure times that are requested, seconds, ascending.
    pub seconds: Vec<f64>,
}

/// The newest burst of the capture thread and the state of its camera.
#[derive(Debug)]
pub(super) struct CaptureState {
    pub burst: RawBurst,
    /// One bit for each exposure whose frame in `burst` was not handed over yet.
    pub new: u16,
    pub fresh: bool,
    /// The reason why no frames arrive; `None` while frames arrive.
    pub down: Option<String>,
    /// Counters of the frames since the source was opened.
    pub counters: Counters,
    pub reopened: u64,
    pub status: CameraStatus,
    /// The newest request for exposure times that the capture thread has not taken.
    pub request: Option<Request>,
}

/// The state that the capture thread and the source share, its condition variable and the request to stop.
#[derive(Debug)]
pub(super) struct Shared {
    pub state: Mutex<CaptureState>,
    pub news: Condvar,
    /// Whether each frame is handed over by itself.
    pub is_sliding: AtomicBool,
    pub stop: AtomicBool,
}

impl Shared {
    pub fn lock(&self) -> MutexGuard<'_, CaptureState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
