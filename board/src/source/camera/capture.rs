//! The capture thread of a camera: fetches frames, assembles bursts and reports the reason when there are none.

use super::assemble::Assembler;
use super::shared::{CaptureState, RawBurst, Request, Shared};
use super::terms::Terms;
use crate::camera_status::{CameraStatus, ExposureStatus, ViewStatus};
use crate::v4l2::capture::Camera;
use crate::v4l2::frame::{Broken, Counters, RawFrame};
use crate::v4l2::setup::Agreed;
use crate::v4l2::supervise::{Outcome, Supervisor};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Number of rounds of all exposures without a burst after which the thread reports the reason: three seconds at 30 Hz with three
/// exposures.
const MOST_ROUNDS: u64 = 30;

/// Fetches frames and assembles bursts until `shared.stop`; `burst` is the memory of the first burst.
pub(super) fn run(supervisor: Supervisor, burst: RawBurst, shared: &Shared) {
    let terms = Arc::clone(&burst.terms);
    let mut capture = Capture {
        supervisor,
        shared,
        assembler: Assembler::default(),
        frame: RawFrame::default(),
        burst,
        terms,
        streaming: false,
        is_sliding: false,
        resyncs: 0,
        changes: 0,
        requests: 0,
        unused: Unused::default(),
        past: Counters::default(),
    };
    while !shared.stop.load(Ordering::Relaxed) {
        capture.step();
    }
}

/// Number of frames since the last burst that made no burst, by kind.
#[derive(Clone, Copy, Debug, Default)]
struct Unused {
    complete: u64,
    /// Counts of broken frames at the time of the last burst.
    broken: Broken,
    reported: bool,
}

struct Capture<'a> {
    supervisor: Supervisor,
    shared: &'a Shared,
    assembler: Assembler,
    frame: RawFrame,
    burst: RawBurst,
    terms: Arc<Terms>,
    streaming: bool,
    /// Whether each frame is handed over by itself.
    is_sliding: bool,
    /// Numbers of delay corrections and of measured exposures that have been logged.
    resyncs: u64,
    changes: u64,
    /// Number of the last request for other exposures that the thread has taken.
    requests: u64,
    unused: Unused,
    /// Sums of the counters of all streams of the camera that have ended.
    past: Counters,
}

impl Capture<'_> {
    fn step(&mut self) {
        if !self.streaming {
            self.begin();
        }
        let counters = self.counters();
        let outcome = self.follow_request().unwrap_or_else(|| self.supervisor.step(&mut self.frame));
        match outcome {
            Outcome::Frame => {
                self.take_over_exposures();
                self.follow_window();
                if self.assembler.push(&mut self.frame) {
                    self.publish();
                } else {
                    self.unused.complete += 1;
                }
            }
            Outcome::Nothing => {}
            Outcome::Down(reason) => {
                self.streaming = false;
                self.past = self.past.plus(&counters);
                self.report(Some(reason));
            }
        }
        self.report_useless();
    }

    /// Sets the exposures that were requested last; returns the failure of the camera, if it fails.
    fn follow_request(&mut self) -> Option<Outcome> {
        let Request { number, seconds } = self.shared.lock().request.take()?;
        self.requests = number;
        let failure = self.supervisor.set_exposures(&seconds);
        if let Some(camera) = self.supervisor.camera().filter(|_| self.streaming) {
            (self.terms, self.changes) = (Arc::new(Terms::of(camera, number)), 0);
            self.assembler.reset(self.terms.seconds.len());
        }
        failure
    }

    /// Adopts the negotiated terms of a camera that has started to stream.
    fn begin(&mut self) {
        let Some(camera) = self.supervisor.camera() else { return };
        (self.streaming, self.unused, self.changes) = (true, Unused::default(), 0);
        self.terms = Arc::new(Terms::of(camera, self.requests));
        for Agreed { what, asked, got } in camera.agreed() {
            let path = camera.path().display();
            match *what {
                "control" | "controls" => tracing::warn!("{path}: found {what} {got}, expected {asked}"),
                _ => tracing::info!("{path}: {what}: {asked} requested, {got} granted"),
            }
        }
        self.assembler.reset(self.terms.seconds.len());
        self.shared.lock().down = None;
    }

    /// Replaces the exposure times of the next bursts by the measured ones.
    fn take_over_exposures(&mut self) {
        let Some(camera) = self.supervisor.camera() else { return };
        if camera.exposure_changes() == self.changes {
            return;
        }
        self.changes = camera.exposure_changes();
        let (told, path) = (Arc::clone(&self.terms), camera.path().display());
        self.terms = Arc::new(Terms::of(camera, self.requests));
        self.assembler.reset(self.terms.seconds.len());
        let ms = |s: &[f64]| s.iter().map(|s| format!("{:.2}", s * 1e3)).collect::<Vec<_>>().join(", ");
        tracing::warn!(
            "{path}: found exposures of {} ms by brightness, expected {} ms: the measured ones are used",
            ms(&self.terms.seconds),
            ms(&told.seconds)
        );
    }

    /// Returns the counters of all frames since the source was opened.
    fn counters(&self) -> Counters {
        self.supervisor.camera().map(Camera::counters).unwrap_or_default()
    }

    /// Starts again with a whole burst if the sets are to be those of bursts instead of frames, or of frames instead of bursts: of a sliding
    /// window, the assembler has the newest frame alone.
    fn follow_window(&mut self) {
        let is_sliding = self.shared.is_sliding.load(Ordering::Relaxed);
        if is_sliding != self.is_sliding {
            self.is_sliding = is_sliding;
            self.assembler.reset(self.terms.seconds.len());
        }
    }

    fn publish(&mut self) {
        if !self.is_sliding {
            self.assembler.take(&mut self.burst.frames);
            self.burst.terms = Arc::clone(&self.terms);
        }
        let counters = self.counters();
        let all = self.past.plus(&counters);
        let camera = self.supervisor.camera();
        let mut state = self.shared.lock();
        (state.reopened, state.counters) = (self.supervisor.reopened(), all);
        if self.is_sliding {
            state.new |= self.assembler.take_new(&mut state.burst.frames);
            state.burst.terms = Arc::clone(&self.terms);
        } else {
            std::mem::swap(&mut state.burst, &mut self.burst);
            state.new = u16::MAX;
        }
        if let Some(camera) = camera {
            let reopened = self.supervisor.reopened();
            let CaptureState { burst, status, .. } = &mut *state;
            describe(status, camera, burst, &all);
            status.reopened = reopened;
        }
        (state.fresh, state.down) = (true, None);
        drop(state);
        self.shared.news.notify_all();
        if counters.resyncs > self.resyncs {
            let delay = camera.and_then(Camera::delay);
            tracing::warn!("the camera's exposures act {delay:?} frames after the next one: corrected");
        }
        self.resyncs = counters.resyncs;
        self.unused = Unused { broken: counters.broken, ..Unused::default() };
    }

    /// Reports once the reason why many successive frames made no burst.
    fn report_useless(&mut self) {
        let Some(camera) = self.supervisor.camera() else { return };
        let broken = camera.counters().broken.since(&self.unused.broken);
        let rounds = MOST_ROUNDS * self.terms.seconds.len() as u64;
        if !self.unused.reported && self.unused.complete + broken.total() >= rounds {
            self.unused.reported = true;
            let why = useless(camera, self.unused.complete, &broken);
            self.report(Some(why));
        }
    }

    fn report(&self, down: Option<String>) {
        let mut state = self.shared.lock();
        (state.down, state.fresh) = (down, false);
        drop(state);
        self.shared.news.notify_all();
    }
}

/// Writes the state of `camera` after `burst` to `status`, reusing the memory of `status`.
fn describe(status: &mut CameraStatus, camera: &Camera, burst: &RawBurst, counters: &Counters) {
    status.exposures.clear();
    let settings = camera.settings().iter().zip(&burst.terms.seconds).zip(&burst.frames);
    status.exposures.extend(settings.map(|((setting, seconds), frame)| ExposureStatus {
        asked_s: setting.asked_s,
        seconds: *seconds,
        known: frame.taken.known.name(),
    }));
    status.delay_frames = camera.delay();
    status.view = camera.view().map(|v| ViewStatus { share: v.share(), crop: v.crop, binning: v.binning });
    (status.known, status.frames) = (counters.known, counters.counts());
    (status.late_writes, status.failed_writes) = (counters.late, counters.failed_writes);
    (status.mismatches, status.resyncs) = (counters.mismatches, counters.resyncs);
}

/// Returns the reason why frames made no burst: `complete` frames without a known exposure, or `broken` frames.
fn useless(camera: &Camera, complete: u64, broken: &Broken) -> String {
    let (path, wrong) = (camera.path().display(), camera.counters().mismatches);
    let count = complete + broken.total();
    if broken.total() > complete {
        return format!(
            "{path}: found no burst in {count} frames ({broken}), expected complete frames: another cable, port or power supply, a \
             smaller size= or a lower rate="
        );
    }
    format!(
        "{path}: found no burst in {count} frames, {wrong} of them brighter or darker than their exposures predict, expected exposures that can \
         be told apart: a lens file with the camera's [response], or fewer exposures"
    )
}
