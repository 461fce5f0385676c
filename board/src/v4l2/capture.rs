//! A streaming camera that returns one frame at a time with its exposure.

use super::access::failed;
use super::arrivals::Arrivals;
use super::exposure::{ControlUnit, ExposureSetting};
use super::formats::Picture;
use super::frame::{Counters, Filled, RawFrame, Taken};
use super::measured::Verdict;
use super::numbers::Numbers;
use super::schedule::{Known, MAX_DELAY, Schedule, is_after};
use super::setup::{self, Agreed, Options, Setup};
use super::verify::{CodeCurve, Verifier};
use super::view::View;
use super::{Call, CameraError, Kernel, Node, luma, persist};
use crate::exposure_plan::TimeRange;
use hemilux_core::Response;
use rustix::io::Errno;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Longest time, and longest number of frame periods, without a frame: the camera has failed when both have passed, as in libcamera.
pub(super) const SILENCE: (Duration, f64) = (Duration::from_secs(1), 5.0);

/// Control delay, frames after the next one, that is assumed when the delay is neither known nor measurable:
/// that of most sensors.
const USUAL_DELAY: u32 = 2;

/// Number of successive refused exposure writes after which the camera is opened again.
const MOST_REFUSED: u32 = 30;

/// Latest time for a control write, in frame periods after the newest frame was due: the next frame may begin before a later write acts.
pub(super) const IN_TIME: f64 = 0.6;

/// A streaming camera. It stops the stream and closes all nodes on drop.
pub struct Camera {
    pub(super) path: PathBuf,
    pub(super) setup: Setup,
    pub(super) schedule: Schedule,
    /// True if the schedule's delay was measured or is known, false if it is assumed.
    pub(super) sure: bool,
    curve: CodeCurve,
    verifier: Option<Verifier>,
    pub(super) codes: Vec<f32>,
    pub(super) counters: Counters,
    pub(super) numbers: Numbers,
    pub(super) last: Option<u32>,
    /// Number of successive failures to fetch a frame from the driver.
    pub(super) unfetched: u32,
    /// First frame after which the next exposure may be written; set while the first frame of an exposure is
    /// uncertain.
    held_until: Option<u32>,
    /// Number of successive frames whose sequence numbers do not rise.
    pub(super) repeats: u32,
    pub(super) arrivals: Arrivals,
    /// Number of successive writes of the exposure control that the driver refused.
    refused: u32,
}

impl Camera {
    /// Opens the camera of `options`, negotiates its format and exposures, starts the stream and measures the
    /// control delay.
    ///
    /// # Errors
    /// [`CameraError`] of the step that failed; all nodes are closed again.
    pub fn open(kernel: &mut dyn Kernel, options: &Options) -> Result<Self, CameraError> {
        let setup = setup::open(kernel, options)?;
        let usual = if setup.picture.is_raw() { Response::Linear } else { Response::Srgb };
        let most = setup.picture.max_code();
        let (black, white) = options.levels.map_or((setup.black, 1.0), |l| (l.black / most, l.white / most));
        let curve = CodeCurve { response: options.response.unwrap_or(usual), black, white };
        let seconds: Vec<f64> = setup.settings.iter().map(|s| s.seconds).collect();
        let known = options.delay.or(setup.delay);
        let mut camera = Self {
            path: options.path.clone(),
            schedule: Schedule::new(seconds.len(), 0, known.unwrap_or(USUAL_DELAY)),
            sure: known.is_some(),
            verifier: verifier(&setup, curve),
            curve,
            codes: Vec::new(),
            counters: Counters::default(),
            numbers: Numbers::default(),
            last: None,
            unfetched: 0,
            held_until: None,
            repeats: 0,
            arrivals: Arrivals::new(setup.period_s, kernel.now_ns()),
            refused: 0,
            setup,
        };
        camera.start(kernel)?;
        if known.is_none() && camera.setup.knob.is_some() && seconds.len() > 1 {
            camera.find_delay(kernel)?;
        }
        camera.counters = Counters::default();
        Ok(camera)
    }

    /// Returns the path of the camera's device node.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the layout of the camera's frames.
    #[must_use]
    pub fn picture(&self) -> &Picture {
        &self.setup.picture
    }

    /// Returns the exposure settings of the burst that the camera accepted, ascending; with a stand-in control,
    /// in the requested order.
    #[must_use]
    pub fn settings(&self) -> &[ExposureSetting] {
        &self.setup.settings
    }

    /// Returns the exposure times of the burst in seconds, ascending: measured values where brightness ratios contradict the control, else
    /// the control's values.
    #[must_use]
    pub fn seconds(&self) -> Vec<f64> {
        let deviating = self.verifier.as_ref().map(Verifier::measured);
        let measured = |slot| deviating.filter(|m| m.deviates(slot)).and_then(|m| m.seconds(slot));
        let settings = self.setup.settings.iter().enumerate();
        settings.map(|(slot, s)| measured(slot).unwrap_or(s.seconds)).collect()
    }

    /// Returns the indices into [`Self::settings`] of the exposures whose measured time differs from the control's by more than 10 %.
    #[must_use]
    pub fn measured(&self) -> Vec<usize> {
        let deviates = |slot: &usize| self.verifier.as_ref().is_some_and(|v| v.measured().deviates(*slot));
        (0..self.setup.settings.len()).filter(deviates).collect()
    }

    /// Returns the exposure times that the exposure control accepts at the camera's frame rate; `None` if the
    /// exposures cannot be set.
    #[must_use]
    pub fn range(&self) -> Option<TimeRange> {
        self.setup.range.filter(|_| self.setup.knob.is_some())
    }

    /// Replaces the exposures of the burst by the control's nearest values to `wished_s`, seconds, while the camera streams. Frames have no
    /// known exposure until the first of the new exposures acts. If the camera accepts none of the new exposures, false is returned and the
    /// present ones stay.
    ///
    /// # Errors
    /// [`CameraError`] of a request that failed: the camera must then be closed and opened again.
    pub fn set_exposures(&mut self, kernel: &mut dyn Kernel, wished_s: &[f64]) -> Result<bool, CameraError> {
        let settings = setup::renegotiate(&mut self.setup, wished_s);
        if settings.is_empty() {
            return Ok(false);
        }
        self.schedule = Schedule::new(settings.len(), 0, self.schedule.delay());
        self.schedule.doubt_initial();
        self.setup.settings = settings;
        self.verifier = verifier(&self.setup, self.curve);
        self.write_repeatedly(kernel, self.last.unwrap_or(u32::MAX))?;
        Ok(true)
    }

    /// Returns the number of times that measured exposures replaced the control's values since the camera was opened.
    #[must_use]
    pub fn exposure_changes(&self) -> u64 {
        self.verifier.as_ref().map_or(0, |v| v.measured().changes())
    }

    /// Returns the relative code of black, 0 to 1, for sensors in the table; otherwise 0.
    #[must_use]
    pub fn black(&self) -> f64 {
        self.setup.black
    }

    /// Returns response and levels of the camera's codes.
    #[must_use]
    pub fn curve(&self) -> CodeCurve {
        self.curve
    }

    /// Returns the part of the sensor that pictures cover, if the driver or the table of sensors has it.
    #[must_use]
    pub fn view(&self) -> Option<View> {
        self.setup.view
    }

    /// Returns the requested properties of the camera, each with the requested and the granted value.
    #[must_use]
    pub fn agreed(&self) -> &[Agreed] {
        &self.setup.agreed
    }

    /// Returns the control delay, if it is known: the number of frames between the next frame and the first one on which a written control
    /// acts.
    #[must_use]
    pub fn delay(&self) -> Option<u32> {
        self.sure.then(|| self.schedule.delay())
    }

    /// Returns the interval between two frames of the camera.
    #[must_use]
    pub fn period(&self) -> Duration {
        Duration::from_secs_f64(self.setup.period_s)
    }

    /// Returns the counters of the frames since the camera was opened.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Waits at most `timeout` for the next complete frame, copies it to `frame` and writes the exposure that is due; returns false if no
    /// complete frame came.
    ///
    /// # Errors
    /// [`CameraError`] of a request that failed: the camera must then be closed and opened again.
    pub fn next(
        &mut self,
        kernel: &mut dyn Kernel,
        timeout: Duration,
        frame: &mut RawFrame,
    ) -> Result<bool, CameraError> {
        let Some(filled) = self.dequeue(kernel, timeout)? else { return Ok(false) };
        if filled.good {
            self.write_due(kernel, filled.buffer.sequence)?;
        }
        self.finish(&filled, frame)
    }

    /// Checks a frame, copies it if it is complete, and returns its buffer to the driver.
    fn finish(&mut self, filled: &Filled, frame: &mut RawFrame) -> Result<bool, CameraError> {
        let buffer = &filled.buffer;
        let good = self.read(filled, &mut frame.bytes);
        self.queue(buffer.index)?;
        if good {
            self.counters.frames += 1;
            let timestamp_ns = self.arrivals.time_ns();
            let (slot, known) = self.identify(buffer.sequence);
            self.counters.note(known);
            frame.taken = Taken { sequence: buffer.sequence, timestamp_ns, slot, known };
        }
        Ok(good)
    }

    /// Copies or decodes a complete frame into `bytes` and stores samples of its brightness in `codes`.
    pub(super) fn read(&mut self, filled: &Filled, bytes: &mut Vec<u8>) -> bool {
        if !filled.good {
            return false;
        }
        let (picture, used) = (&self.setup.picture, filled.buffer.bytes_used as usize);
        let all = self.setup.video.bytes(filled.buffer.index);
        let all = if picture.jpeg.is_some() { all.get(..used).unwrap_or(all) } else { all };
        let is_read = picture.read(all, bytes);
        if is_read {
            luma::sample(&picture.layout, bytes, &mut self.codes);
        }
        self.counters.broken.damaged += u64::from(!is_read);
        is_read
    }

    /// Returns whether the exposure control sets a time.
    pub(super) fn is_timed(&self) -> bool {
        self.setup.knob.as_ref().is_some_and(|k| k.unit != ControlUnit::StandIn)
    }

    /// Limits the burst to its middle exposure, because the exposure control does not act in the documented
    /// way, as `got` describes.
    pub(super) fn keep_one(&mut self, kernel: &mut dyn Kernel, got: &str) -> Result<(), CameraError> {
        let asked = "longer exposures for larger values".into();
        self.setup.agreed.push(Agreed { what: "exposure control", asked, got: got.into() });
        self.write(kernel, u32::MAX, self.setup.settings.len() / 2)?;
        self.setup.settings = vec![ExposureSetting::whole(self.setup.period_s)];
        (self.setup.knob, self.verifier, self.sure) = (None, None, false);
        self.schedule = Schedule::new(1, 0, self.schedule.delay());
        Ok(())
    }

    /// Returns the exposure of frame `sequence`, whose brightness samples are in `codes`.
    fn identify(&mut self, sequence: u32) -> (Option<usize>, Known) {
        let slot = self.schedule.exposure_of(sequence);
        if self.setup.knob.is_none() {
            return (Some(0), Known::Unknown);
        }
        let guess = if self.sure { Known::Predicted } else { Known::Unknown };
        let Some(verifier) = &mut self.verifier else { return (slot, guess) };
        match verifier.compare(sequence, &mut self.codes, &self.schedule) {
            Verdict::Agrees => (slot, Known::Verified),
            Verdict::Measured => (slot, Known::Measured),
            Verdict::CannotTell | Verdict::Near => (slot, guess),
            Verdict::Differs => {
                self.counters.mismatches += 1;
                if let Some(delay) = verifier.better_delay(&self.schedule) {
                    self.schedule.set_delay(delay);
                    (self.counters.resyncs, self.sure) = (self.counters.resyncs + 1, true);
                }
                (None, Known::Unknown)
            }
        }
    }

    /// Writes the exposure that is due after frame `sequence`, unless newer frames are already queued or [`IN_TIME`] has passed.
    fn write_due(&mut self, kernel: &mut dyn Kernel, sequence: u32) -> Result<(), CameraError> {
        if self.setup.knob.is_none() || self.setup.settings.len() < 2 {
            return Ok(());
        }
        if self.held_until.is_some_and(|until| is_after(until, sequence)) {
            return Ok(());
        }
        let behind = persist(|| self.setup.video.wait(Duration::ZERO)).is_ok_and(|r| r.frame);
        if behind || self.lateness(kernel) > IN_TIME {
            self.counters.late += 1;
            return Ok(());
        }
        self.write(kernel, sequence, self.schedule.due(sequence))
    }

    /// Returns the number of frame periods that have passed since the newest frame was due.
    pub(super) fn lateness(&self, kernel: &dyn Kernel) -> f64 {
        self.arrivals.lateness(kernel.now_ns())
    }

    pub(super) fn write(
        &mut self,
        kernel: &mut dyn Kernel,
        sequence: u32,
        slot: usize,
    ) -> Result<(), CameraError> {
        let Setup { video, sensor, knob, settings, .. } = &mut self.setup;
        let (Some(knob), Some(setting)) = (knob, settings.get(slot)) else { return Ok(()) };
        let node: &mut dyn Node = sensor.as_deref_mut().unwrap_or(video.as_mut());
        if let Err(errno) = setup::write(node, &knob.info, setting) {
            return self.refuse(errno, sequence);
        }
        self.refused = 0;
        let late = self.lateness(kernel);
        let doubt = if late <= IN_TIME { 0 } else { late.ceil().min(f64::from(MAX_DELAY)) as u32 };
        // An exposure whose first frame is uncertain is kept for one further frame, whose exposure is certain.
        self.held_until = (doubt > 0).then(|| sequence.wrapping_add(1 + doubt));
        self.schedule.wrote(sequence, slot, doubt);
        Ok(())
    }

    /// Counts a write of the exposure control that the driver refused: each one costs a frame, and [`MOST_REFUSED`]
    /// successive ones are an error.
    fn refuse(&mut self, errno: Errno, sequence: u32) -> Result<(), CameraError> {
        self.refused += 1;
        self.counters.failed_writes += 1;
        if errno == Errno::NODEV {
            return Err(CameraError::Gone(self.path.clone()));
        }
        if errno == Errno::ACCESS {
            // The driver may refuse a write because an automatic mode controls the exposure again.
            setup::restore(&mut self.setup);
        }
        if self.refused > MOST_REFUSED {
            let expected = "a control that can be set while streaming";
            return Err(failed(&self.path, "writing the exposure", errno, expected));
        }
        self.schedule.failed(sequence);
        Ok(())
    }
}

/// Returns the comparison of brightness ratios for a camera of several exposures whose control sets a time;
/// `None` for other cameras.
fn verifier(setup: &Setup, curve: CodeCurve) -> Option<Verifier> {
    let is_timed = setup.knob.as_ref().is_some_and(|k| k.unit != ControlUnit::StandIn);
    let seconds: Vec<f64> = setup.settings.iter().map(|s| s.seconds).collect();
    (is_timed && seconds.len() > 1).then(|| Verifier::new(curve, &seconds))
}

impl Drop for Camera {
    fn drop(&mut self) {
        let _ = self.setup.video.call(Call::StreamOff);
    }
}
