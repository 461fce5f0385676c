//! A real camera: a thread takes its frames and keeps the newest complete burst, so that slow processing neither shifts the exposures
//! nor piles frames up.

mod assemble;
mod spec;

pub use spec::{CameraSpec, HELP};

use super::{Source, SourceError};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::recorded::{LensFile, RecordedError, read_lens};
use crate::v4l2::capture::{Camera, Counters, RawFrame};
use crate::v4l2::formats::Picture;
use crate::v4l2::setup::Agreed;
use crate::v4l2::supervise::{Outcome, Supervisor};
use crate::v4l2::verify::Levels;
use crate::v4l2::{CameraError, Kernel};
use assemble::Assembler;
use glam::DVec2;
use hemilux_core::format::{Format, Matrix, Yuv};
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::merge::Exposure;
use hemilux_core::response::Response;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait for a burst in one call.
const WAIT: Duration = Duration::from_millis(250);

/// Why a camera could not become a source.
#[derive(Debug, thiserror::Error)]
pub enum OpenCameraError {
    /// The options.
    #[error("{0}")]
    Options(String),
    /// The lens file.
    #[error(transparent)]
    Lens(#[from] RecordedError),
    /// The lens is for other pictures.
    #[error("{path}: found a lens of {} x {} pixels, expected {} x {} as the camera gives", found.0, found.1, expected.0, expected.1)]
    LensSize {
        /// The lens file.
        path: PathBuf,
        /// What it is for.
        found: (u32, u32),
        /// What the camera gives.
        expected: (u32, u32),
    },
    /// The camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The operating system gave no thread.
    #[error("the capture thread: found {0}, expected it to start")]
    Thread(std::io::Error),
}

/// A burst as the camera gave it.
#[derive(Clone, Debug, Default)]
pub struct RawBurst {
    /// One frame for each exposure, ascending.
    pub frames: Vec<RawFrame>,
    /// Their exposure times.
    pub seconds: Vec<f64>,
}

/// What the capture thread and the others share.
#[derive(Debug, Default)]
struct State {
    burst: RawBurst,
    fresh: bool,
    /// Why there are no frames, while there are none.
    down: Option<String>,
    counters: Counters,
    reopened: u64,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    news: Condvar,
    stop: AtomicBool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Bursts of a camera.
#[derive(Debug)]
pub struct CameraSource {
    calibration: Calibration,
    picture: Picture,
    exposures: Vec<Exposure>,
    agreed: Vec<Agreed>,
    lens: Option<LensFile>,
    raw: RawBurst,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl CameraSource {
    /// Opens the camera and starts taking its frames.
    ///
    /// # Errors
    /// [`OpenCameraError`].
    pub fn open(kernel: Box<dyn Kernel>, spec: &CameraSpec) -> Result<Self, OpenCameraError> {
        let mut options = spec.options().map_err(OpenCameraError::Options)?;
        let lens = spec.lens().map(|path| read_lens(&path).map(|lens| (path, lens))).transpose()?;
        options.levels = lens.as_ref().and_then(|(_, lens)| levels(lens, options.fourcc));
        let supervisor = Supervisor::open(kernel, options)?;
        let picture = *supervisor.picture();
        if let Some((path, lens)) = &lens
            && lens.size != [picture.width, picture.height]
        {
            let (found, expected) = (lens.size.into(), (picture.width, picture.height));
            return Err(OpenCameraError::LensSize { path: path.clone(), found, expected });
        }
        let lens = lens.map(|(_, lens)| lens);
        let camera = supervisor.camera().expect("a supervisor begins with its camera up");
        let seconds: Vec<f64> = camera.settings().iter().map(|s| s.seconds).collect();
        let calibration = calibration(&picture, camera.black(), lens.as_ref());
        let agreed = camera.agreed().to_vec();
        let shared = Arc::new(Shared::default());
        let thread = std::thread::Builder::new().name("hemilux-camera".into());
        let theirs = Arc::clone(&shared);
        let thread = thread.spawn(move || capture(supervisor, &theirs)).map_err(OpenCameraError::Thread)?;
        let exposures = seconds.iter().map(|s| Exposure { seconds: *s, gain: 1.0 }).collect();
        Ok(Self {
            calibration,
            picture,
            exposures,
            agreed,
            lens,
            raw: RawBurst::default(),
            shared,
            thread: Some(thread),
        })
    }

    /// What was asked of the camera and what was got.
    #[must_use]
    pub fn agreed(&self) -> &[Agreed] {
        &self.agreed
    }

    /// How raw frames are to be read.
    #[must_use]
    pub fn picture(&self) -> &Picture {
        &self.picture
    }

    /// The lens file, where there is one.
    #[must_use]
    pub fn lens(&self) -> Option<&LensFile> {
        self.lens.as_ref()
    }

    /// What happened to frames, and how many times the camera came back.
    #[must_use]
    pub fn counters(&self) -> (Counters, u64) {
        let state = self.shared.lock();
        (state.counters, state.reopened)
    }

    /// Waits for the newest burst as the camera gave it.
    ///
    /// # Errors
    /// [`SourceError`].
    pub fn next_raw(&mut self) -> Result<&RawBurst, SourceError> {
        let state = self.shared.lock();
        let idle = |s: &mut State| !s.fresh && s.down.is_none();
        let waited = self.shared.news.wait_timeout_while(state, WAIT, idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.fresh {
            state.fresh = false;
            std::mem::swap(&mut state.burst, &mut self.raw);
            return Ok(&self.raw);
        }
        Err(state.down.clone().map_or(SourceError::NotYet, SourceError::Gone))
    }
}

impl Source for CameraSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.exposures.clone()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.next_raw()?;
        let RawBurst { frames, seconds } = &self.raw;
        burst.frames.truncate(frames.len());
        for (i, (raw, seconds)) in frames.iter().zip(seconds).enumerate() {
            if burst.frames.len() == i {
                burst.frames.push(Frame {
                    exposure: Exposure { seconds: *seconds, gain: 1.0 },
                    pixels: Pixels::U8(Vec::new()),
                });
            }
            burst.frames[i].exposure = Exposure { seconds: *seconds, gain: 1.0 };
            match &mut burst.frames[i].pixels {
                Pixels::U8(bytes) => bytes.clone_from(&raw.bytes),
                other => *other = Pixels::U8(raw.bytes.clone()),
            }
        }
        burst.timestamp_ns = frames.iter().map(|f| f.taken.timestamp_ns).max().unwrap_or(0);
        Ok(())
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

/// Takes frames until told to stop.
fn capture(mut supervisor: Supervisor, shared: &Shared) {
    let (mut frame, mut assembler, mut burst) =
        (RawFrame::default(), Assembler::default(), RawBurst::default());
    let (mut streaming, mut resyncs) = (false, 0);
    while !shared.stop.load(Ordering::Relaxed) {
        if !streaming && let Some(camera) = supervisor.camera() {
            streaming = true;
            burst.seconds = camera.settings().iter().map(|s| s.seconds).collect();
            assembler.reset(burst.seconds.len());
            shared.lock().down = None;
        }
        match supervisor.step(&mut frame) {
            Outcome::Frame if assembler.push(&mut frame) => {
                assembler.take(&mut burst.frames);
                let mut state = shared.lock();
                let seconds = burst.seconds.clone();
                std::mem::swap(&mut state.burst, &mut burst);
                burst.seconds = seconds;
                state.fresh = true;
                state.reopened = supervisor.reopened();
                state.counters = supervisor.camera().map(Camera::counters).unwrap_or_default();
                let found = state.counters.resyncs;
                drop(state);
                shared.news.notify_all();
                if found > resyncs {
                    tracing::warn!(
                        "the camera's exposures act {:?} frames after the next one: put right",
                        supervisor.camera().and_then(Camera::delay)
                    );
                }
                resyncs = found;
            }
            Outcome::Frame | Outcome::Nothing => {}
            Outcome::Down(reason) => {
                streaming = false;
                let mut state = shared.lock();
                (state.down, state.fresh) = (Some(reason), false);
                drop(state);
                shared.news.notify_all();
            }
        }
    }
}

/// What a lens file says of codes, relative to the largest.
fn levels(lens: &LensFile, fourcc: Option<u32>) -> Option<Levels> {
    let (black, white) = lens.levels?;
    let bits = fourcc.and_then(crate::v4l2::formats::layout).map_or(8, |l| l.bits());
    let most = f64::from((1u32 << bits) - 1);
    Some(Levels { response: lens.response, black: black / most, white: white / most })
}

/// From the lens file and, for what it does not say, from the picture: sensors are linear, cameras' own pictures follow sRGB more or less.
fn calibration(picture: &Picture, black: f64, lens: Option<&LensFile>) -> Calibration {
    let most = f64::from((1u32 << picture.layout.bits()) - 1);
    let usual = if picture.layout.is_raw() { Response::Linear } else { Response::Srgb };
    let told = lens.filter(|l| l.response_table.is_some());
    let (black, white) = lens.and_then(|l| l.levels).unwrap_or((black * most, most));
    let matrix = if picture.bt709 { Matrix::Bt709 } else { Matrix::Bt601 };
    let yuv = Yuv { limited: !picture.full_range, matrix };
    Calibration {
        lens: lens.map_or_else(|| assumed_lens(picture), |l| l.lens),
        width: picture.width,
        height: picture.height,
        response: told.map_or(usual, |l| l.response),
        scale: 1.0,
        black,
        white,
        white_balance: [1.0; 3],
        format: Format::from_fourcc(picture.fourcc.to_le_bytes(), yuv)
            .expect("the formats of cameras are the core's"),
        bytes_per_line: picture.stride as usize,
    }
}

/// An equidistant fisheye that sees 180 degrees across the shorter side: what a lens is taken for until it is calibrated.
fn assumed_lens(picture: &Picture) -> Lens {
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let mut vignetting = [0.0; 8];
    vignetting[0] = 1.0;
    let lens = Lens::try_new(Intrinsics {
        model: Model::Equidistant,
        centre_px: DVec2::new((width - 1.0) / 2.0, (height - 1.0) / 2.0),
        focal_px: DVec2::splat(width.min(height) / std::f64::consts::PI),
        skew_px: 0.0,
        max_theta: std::f64::consts::FRAC_PI_2,
        vignetting,
    });
    lens.expect("an equidistant lens of 180 degrees is a lens")
}
