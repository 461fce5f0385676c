//! A camera as a source: a thread fetches the camera's frames and keeps the newest complete burst, so that slow processing neither changes
//! the exposures nor queues frames.

mod assemble;
mod capture;
#[cfg(test)]
mod field_tests;
#[cfg(test)]
mod light_tests;
mod shared;
mod spec;
mod terms;
#[cfg(test)]
mod tests;

pub use shared::RawBurst;
pub use spec::{CameraSpec, HELP};
pub use terms::Terms;

use super::{Source, SourceError};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::camera_status::CameraStatus;
use crate::exposure_plan::TimeRange;
use crate::noise::Noise;
use crate::recorded::{LensFile, RecordedError, read_lens};
use crate::v4l2::frame::Counters;
use crate::v4l2::setup::{LensFit, Options};
use crate::v4l2::supervise::Supervisor;
use crate::v4l2::{CameraError, Kernel};
use hemilux_core::Exposure;
use hemilux_core::mains::{Lamps, whole_periods};
use shared::{CaptureState, Request, Shared};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait for a burst of the camera in one call of [`Source::next`].
const WAIT: Duration = Duration::from_millis(250);

/// Reasons why a camera cannot be a source.
#[derive(Debug, thiserror::Error)]
pub enum OpenCameraError {
    /// The options of the camera are invalid.
    #[error("{0}")]
    Options(String),
    /// The lens file of the camera cannot be read.
    #[error(transparent)]
    Lens(#[from] RecordedError),
    /// The camera cannot be opened.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The operating system cannot start the capture thread.
    #[error("the capture thread: found {0}, expected it to start")]
    Thread(std::io::Error),
}

/// A source of bursts from a camera.
#[derive(Debug)]
pub struct CameraSource {
    calibration: Calibration,
    lens: Option<LensFile>,
    raw: RawBurst,
    /// Exposure times that the camera's options state, seconds.
    own_s: Vec<f64>,
    /// True if the options name exposure times.
    is_named: bool,
    /// True if the options state that the exposures follow the light.
    is_auto: bool,
    lamps: Lamps,
    /// True if [`Source::set_exposures`] has replaced the exposure times of the options.
    is_set: bool,
    /// The newest request for exposure times to the capture thread.
    request: Request,
    /// One bit for each exposure whose frame in `raw` is new.
    new: u16,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl CameraSource {
    /// Opens the camera and starts the capture thread.
    ///
    /// # Errors
    /// [`OpenCameraError`] for wrong options, a lens file that cannot be read, or a camera that cannot be opened.
    pub fn open(kernel: Box<dyn Kernel>, spec: &CameraSpec) -> Result<Self, OpenCameraError> {
        Self::supervised(spec, |options| Supervisor::open(kernel, options))
    }

    /// Opens the camera like [`Self::open`], but waits for an absent camera in the background; until it is connected, the calibration is that
    /// of the requested camera.
    ///
    /// # Errors
    /// [`OpenCameraError`] for wrong options, a lens file that cannot be read, or a camera that is present and cannot be opened.
    pub fn open_or_wait(kernel: Box<dyn Kernel>, spec: &CameraSpec) -> Result<Self, OpenCameraError> {
        Self::supervised(spec, |options| Supervisor::open_or_wait(kernel, options))
    }

    fn supervised(
        spec: &CameraSpec,
        open: impl FnOnce(Options) -> Result<Supervisor, CameraError>,
    ) -> Result<Self, OpenCameraError> {
        let mut options = spec.options().map_err(OpenCameraError::Options)?;
        let lens = spec.lens().map(|path| read_lens(&path)).transpose()?;
        if let Some(lens) = &lens {
            let size = lens.size.into();
            options.lens = Some(LensFit { size, shown: lens.shown, lens: lens.lens });
            options.full_view = false;
            options.size = if spec.names("size") { options.size } else { size };
            (options.response, options.levels) = (lens.told_response(), lens.levels);
        }
        let (own_s, is_auto) = (options.exposures_s.clone(), options.follows_light);
        let is_named = spec.names("exposures") && !is_auto;
        let request = Request { number: 0, seconds: own_s.clone() };
        let assumed = Terms::assumed(&options);
        let supervisor = open(options)?;
        let terms = Arc::new(supervisor.camera().map_or(assumed, |camera| Terms::of(camera, 0)));
        let raw = RawBurst::none(&terms);
        let state = CaptureState {
            burst: RawBurst::none(&terms),
            new: 0,
            fresh: false,
            down: None,
            counters: Counters::default(),
            reopened: 0,
            status: CameraStatus::default(),
            request: None,
        };
        let shared = Arc::new(Shared {
            state: Mutex::new(state),
            news: Condvar::new(),
            is_sliding: AtomicBool::new(false),
            stop: AtomicBool::new(false),
        });
        let thread = std::thread::Builder::new().name("hemilux-camera".into());
        let theirs = Arc::clone(&shared);
        let burst = RawBurst::none(&terms);
        let thread = thread
            .spawn(move || capture::run(supervisor, burst, &theirs))
            .map_err(OpenCameraError::Thread)?;
        let calibration = terms.calibration(lens.as_ref());
        let (lamps, thread) = (Lamps::Auto, Some(thread));
        let (is_set, new) = (false, 0);
        Ok(Self {
            calibration,
            lens,
            raw,
            new,
            own_s,
            is_named,
            is_auto,
            lamps,
            is_set,
            request,
            shared,
            thread,
        })
    }

    /// Returns the exposure times without a setting, seconds: those that the options name, or the usual ones, of which the longest is a
    /// whole number of periods of the lamps.
    fn own_exposures(&self) -> Vec<f64> {
        let mut seconds = self.own_s.clone();
        if let Some(longest) = seconds.last_mut().filter(|_| !self.is_named) {
            *longest = whole_periods(*longest, self.lamps);
        }
        seconds
    }

    /// Requests exposure times, seconds, from the capture thread, unless they are those that were requested last.
    fn request(&mut self, seconds: Vec<f64>) {
        if self.terms().range.is_some() && self.request.seconds != seconds {
            self.request = Request { number: self.request.number + 1, seconds };
            self.shared.lock().request = Some(self.request.clone());
        }
    }

    /// Returns the negotiated terms of the camera.
    #[must_use]
    pub fn terms(&self) -> &Terms {
        &self.raw.terms
    }

    /// Returns the lens file of the camera, if one is given.
    #[must_use]
    pub fn lens(&self) -> Option<&LensFile> {
        self.lens.as_ref()
    }

    /// Returns the counters of the camera's frames, and the number of times that the camera was opened again.
    #[must_use]
    pub fn counters(&self) -> (Counters, u64) {
        let state = self.shared.lock();
        (state.counters, state.reopened)
    }

    /// Waits for the newest burst and returns its frames in the packing of the driver.
    ///
    /// # Errors
    /// [`SourceError`] if there is no burst or the camera is gone.
    pub fn next_raw(&mut self) -> Result<&RawBurst, SourceError> {
        let state = self.shared.lock();
        let idle = |s: &mut CaptureState| !s.fresh && s.down.is_none();
        let waited = self.shared.news.wait_timeout_while(state, WAIT, idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.fresh {
            state.fresh = false;
            let before = Arc::clone(&self.raw.terms);
            std::mem::swap(&mut state.burst, &mut self.raw);
            self.new = std::mem::take(&mut state.new);
            drop(state);
            if self.raw.terms != before {
                self.calibration = self.raw.terms.calibration(self.lens.as_ref());
            }
            return Ok(&self.raw);
        }
        Err(state.down.clone().map_or(SourceError::NotYet, SourceError::Gone))
    }
}

impl Source for CameraSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn noise(&self) -> Option<Noise> {
        self.lens.as_ref().and_then(|lens| lens.noise)
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        self.terms().range.is_none().then_some("the camera has no control that sets an exposure time")
    }

    /// Returns the range of exposure times; `None` also while bursts with exposures from before the last request may come, and while
    /// neither the control delay is known nor an exposure was verified.
    fn exposure_range(&self) -> Option<TimeRange> {
        let is_pending = self.terms().requests != self.request.number;
        let is_sure = {
            let status = &self.shared.lock().status;
            status.delay_frames.is_some() || status.known.verified > 0
        };
        let range = self.terms().range.filter(|_| is_sure && !is_pending);
        range.map(|range| range.of_whole_periods(self.lamps))
    }

    /// Returns what the options state; without `exposures=`, true where the response is known: that of a sensor, or of the lens file. With
    /// another response, radiances would depend on the exposures from which they are measured.
    fn follows_light(&self) -> bool {
        let is_told = self.lens.as_ref().is_some_and(|lens| lens.told_response().is_some());
        self.is_auto || (!self.is_named && (is_told || self.terms().picture.is_raw()))
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        if let (Some(why), Some(_)) = (self.fixed_exposures(), seconds) {
            return Err(format!("found exposures, expected none: {why}"));
        }
        self.is_set = seconds.is_some();
        let seconds = seconds.map_or_else(|| self.own_exposures(), <[f64]>::to_vec);
        self.request(seconds);
        Ok(())
    }

    fn set_lamps(&mut self, lamps: Lamps) {
        self.lamps = lamps;
        if !self.is_set {
            self.request(self.own_exposures());
        }
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.terms().seconds.iter().map(|seconds| Exposure { seconds: *seconds, gain: 1.0 }).collect()
    }

    fn camera(&self, status: &mut CameraStatus) -> bool {
        status.clone_from(&self.shared.lock().status);
        true
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.next_raw()?;
        (burst.before_ns, burst.timestamp_ns) = (self.raw.before_ns(), self.raw.timestamp_ns());
        burst.phase_ns = self.raw.shortest_ns();
        hand_over(&mut self.raw, self.new, burst);
        Ok(())
    }

    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        self.shared.is_sliding.store(is_sliding, Ordering::Relaxed);
        true
    }
}

impl Drop for CameraSource {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the capture thread panicked");
        }
    }
}

/// Moves the frames of `raw` that are `new`, one bit each, into `burst`, and the memory of `burst` into `raw`: a frame is copied once, from
/// the driver's buffer.
fn hand_over(raw: &mut RawBurst, new: u16, burst: &mut Burst) {
    let (frames, seconds) = (&mut raw.frames, &raw.terms.seconds);
    let empty = || Frame { exposure: Exposure { seconds: 1.0, gain: 1.0 }, pixels: Pixels::U8(Vec::new()) };
    burst.frames.resize_with(frames.len(), empty);
    for (index, ((raw, seconds), frame)) in frames.iter_mut().zip(seconds).zip(&mut burst.frames).enumerate()
    {
        frame.exposure = Exposure { seconds: *seconds, gain: 1.0 };
        if new >> (index & 15) & 1 == 0 {
            continue;
        }
        match &mut frame.pixels {
            Pixels::U8(bytes) => std::mem::swap(bytes, &mut raw.bytes),
            other => *other = Pixels::U8(std::mem::take(&mut raw.bytes)),
        }
    }
    burst.stale &= !new;
}
