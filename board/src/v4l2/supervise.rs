//! Recovery of a camera that is unplugged, whose driver stalls or whose device is in use by another program: the camera is closed and
//! opened again every second, without limit.

use super::capture::Camera;
use super::formats::Picture;
use super::frame::RawFrame;
use super::setup::Options;
use super::{CameraError, Kernel};
use std::time::Duration;

/// Time between two attempts to open the camera: long enough for a device to become ready, short enough for light sets that are at most two
/// seconds old.
const RETRY: Duration = Duration::from_secs(1);

/// Longest wait in [`Supervisor::step`], which bounds the latency of a shutdown.
const WAIT: Duration = Duration::from_millis(250);

/// Result of one call of [`Supervisor::step`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// A complete frame was received during the step.
    Frame,
    /// No frame was received during the step.
    Nothing,
    /// The camera is closed; the text is the reason.
    Down(String),
}

/// A camera that is opened again after each failure.
pub struct Supervisor {
    kernel: Box<dyn Kernel>,
    options: Options,
    camera: Option<Camera>,
    retry_ns: u64,
    /// Layout of the frames since the first opening. Later frames must have the same layout, since the tables of the
    /// lens depend on it.
    picture: Option<Picture>,
    reopened: u64,
}

impl Supervisor {
    /// Opens the camera for the first time.
    ///
    /// # Errors
    /// [`CameraError`]: a failure of the first opening is returned and not retried.
    pub fn open(kernel: Box<dyn Kernel>, options: Options) -> Result<Self, CameraError> {
        let mut new = Self { kernel, options, camera: None, retry_ns: 0, picture: None, reopened: 0 };
        new.bring_up()?;
        Ok(new)
    }

    /// Opens the camera; if it is missing or silent, returns a supervisor that retries as after a disconnection.
    ///
    /// # Errors
    /// [`CameraError`] for all failures but a missing or silent camera.
    pub fn open_or_wait(kernel: Box<dyn Kernel>, options: Options) -> Result<Self, CameraError> {
        let mut new = Self { kernel, options, camera: None, retry_ns: 0, picture: None, reopened: 0 };
        match new.bring_up() {
            Ok(()) | Err(CameraError::Gone(_) | CameraError::Silent { .. }) => Ok(new),
            Err(error) => Err(error),
        }
    }

    /// Returns the camera while it is open.
    #[must_use]
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    /// Returns the number of times that the camera was opened again.
    #[must_use]
    pub fn reopened(&self) -> u64 {
        self.reopened
    }

    /// Waits at most a quarter of a second for a frame, or for the time of the next attempt to open the camera.
    pub fn step(&mut self, frame: &mut RawFrame) -> Outcome {
        let Some(camera) = &mut self.camera else { return self.revive() };
        match camera.next(self.kernel.as_mut(), WAIT, frame) {
            Ok(true) => Outcome::Frame,
            Ok(false) => Outcome::Nothing,
            Err(error) => self.down(&error),
        }
    }

    /// Replaces the exposure times, `seconds`, of the open camera and of every later opening. Returns the failure of the camera,
    /// if it fails.
    pub fn set_exposures(&mut self, seconds: &[f64]) -> Option<Outcome> {
        self.options.exposures_s = seconds.to_vec();
        let set = self.camera.as_mut()?.set_exposures(self.kernel.as_mut(), seconds);
        set.err().map(|error| self.down(&error))
    }

    fn down(&mut self, error: &CameraError) -> Outcome {
        self.camera = None;
        self.retry_ns = self.kernel.now_ns().saturating_add(RETRY.as_nanos() as u64);
        Outcome::Down(error.to_string())
    }

    fn revive(&mut self) -> Outcome {
        let left = self.retry_ns.saturating_sub(self.kernel.now_ns());
        if left > 0 {
            self.kernel.sleep(WAIT.min(Duration::from_nanos(left)));
            return Outcome::Nothing;
        }
        let again = self.picture.is_some();
        match self.bring_up() {
            Ok(()) => {
                self.reopened += u64::from(again);
                Outcome::Nothing
            }
            Err(error) => self.down(&error),
        }
    }

    fn bring_up(&mut self) -> Result<(), CameraError> {
        let camera = Camera::open(self.kernel.as_mut(), &self.options)?;
        let picture = self.picture.get_or_insert(*camera.picture());
        if picture != camera.picture() {
            return Err(changed(&camera, picture));
        }
        // The measured delay and exposures are kept for the next opening; if they have changed, the comparison of
        // frames corrects them.
        self.options.delay = self.options.delay.or(camera.delay());
        self.camera = Some(camera);
        Ok(())
    }
}

fn changed(camera: &Camera, before: &Picture) -> CameraError {
    let tell = |p: &Picture| {
        format!("pictures of {} x {} {}", p.width(), p.height(), super::formats::name(p.fourcc))
    };
    let (found, expected) = (tell(camera.picture()), format!("{} as before", tell(before)));
    CameraError::Unfit { path: camera.path().into(), found, expected }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::Size;
    use crate::v4l2::fake::{FakeKernel, Fault, Script};

    #[test]
    fn fifty_disconnects_are_recovered_and_no_node_stays_open() {
        let faults = (1..=50u64).map(|n| (n * 200, Fault::Disconnect(Duration::from_millis(3500))));
        let kernel = FakeKernel::new(Script {
            faults: faults.collect(),
            loss: 0.05,
            interrupt: 11,
            ..Script::default()
        });
        let options = Options { size: Size::new(64, 48), ..Options::of("/dev/video0") };
        let mut supervisor = Supervisor::open(Box::new(kernel.clone()), options).expect("a camera");
        let (mut frame, mut reasons, mut frames) = (RawFrame::default(), Vec::new(), 0);
        while supervisor.reopened() < 50 || frames < 100 {
            let at_rest = supervisor.camera().is_none();
            match supervisor.step(&mut frame) {
                Outcome::Frame => frames = if supervisor.reopened() == 50 { frames + 1 } else { 0 },
                Outcome::Nothing => {}
                Outcome::Down(reason) => {
                    reasons.push(reason);
                    assert_eq!(kernel.held(), (0, 0), "closed while it is down");
                }
            }
            assert!(!at_rest || kernel.held().0 <= 1, "one camera at most");
        }
        // The reasons are one disconnection, and failed attempts after one, two and three seconds.
        assert_eq!(reasons.len(), 200, "one try a second");
        reasons.dedup();
        assert_eq!(reasons.len(), 1, "always in the same words, so that they are logged once: {reasons:?}");
        drop(supervisor);
        assert_eq!(kernel.held(), (0, 0), "all closed");
    }

    #[test]
    fn a_stalled_camera_is_opened_again() {
        let faults = vec![(300, Fault::Stall(Duration::from_secs(5)))];
        let kernel = FakeKernel::new(Script { faults, ..Script::default() });
        let options = Options { size: Size::new(64, 48), ..Options::of("/dev/video0") };
        let mut supervisor = Supervisor::open(Box::new(kernel), options).expect("a camera");
        let (mut frame, mut frames) = (RawFrame::default(), 0);
        while frames < 600 {
            frames += usize::from(supervisor.step(&mut frame) == Outcome::Frame);
        }
        assert_eq!(supervisor.reopened(), 1, "once");
    }
}
