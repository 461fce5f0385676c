//! The processing thread: reads bursts from a source, runs the pipeline and publishes the newest light set.
//!
//! The thread never waits for a client: light sets go through a latest-value channel ([`SetChannel`]); changes of the settings arrive through
//! [`SettingsChannel`] and take effect with the next frame. After the first frames it allocates nothing (`board/tests/allocations.rs`).

pub mod compare;
mod config;
mod durations;
mod ladder;
mod light_follower;
mod made_for;
mod ring;
mod set_channel;
pub mod settings;
mod settings_channel;
mod status;
mod switch;
pub mod tiers;
mod views;
mod worker;

pub use config::{Config, EXTRAPOLATIONS, MERGES, Refusal, extrapolation_name, merge_name};
pub use durations::DurationLog;
pub use ladder::{FrameTime, Ladder, Quality};
pub use set_channel::SetChannel;
pub use settings::Change;
pub use settings_channel::{Applied, Exposures, SettingsChannel};
pub use status::{QualityStatus, ThreadStatus};
pub use views::{BurstView, Given, MapView, Slot, ViewRequest, Views};
pub(crate) use worker::RETRY_PAUSE;
pub use worker::Worker;

use crate::camera_status::CameraStatus;
use crate::light_set::OwnedSet;
use crate::pipeline::PipelineError;
use crate::source::Source;
use compare::Comparison;
use hemilux_core::wire::Stale;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;
use switch::{NextSource, SourceSwitch};
use tiers::Tiers;

/// Reasons for which the processing thread cannot start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The settings do not suit the calibration of the source.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The operating system cannot start a thread.
    #[error("the processing thread: found {0}, expected it to start")]
    Thread(std::io::Error),
}

/// The state that the processing thread and the server share.
#[derive(Debug)]
pub struct Link {
    run: String,
    source: SourceSwitch,
    started: Instant,
    sets: SetChannel,
    settings: SettingsChannel,
    status: ThreadStatus,
    durations: DurationLog,
    views: Views,
    comparison: Comparison,
    tiers: Tiers,
    camera: Mutex<Option<CameraStatus>>,
}

impl Link {
    fn new(source: String, config: Config, exposures: Exposures) -> Self {
        Self {
            run: run_id(),
            source: SourceSwitch::new(source),
            started: Instant::now(),
            sets: SetChannel::default(),
            durations: DurationLog::new(config.budgets),
            tiers: Tiers::new(&config.pipeline, config.tiers),
            settings: SettingsChannel::new(config, exposures),
            status: ThreadStatus::default(),
            views: Views::default(),
            comparison: Comparison::default(),
            camera: Mutex::new(None),
        }
    }

    /// Returns the identifier of this run of the program, which is another one after every start.
    #[must_use]
    pub fn run(&self) -> &str {
        &self.run
    }

    /// Returns the name of the source of bursts in use.
    #[must_use]
    pub fn source(&self) -> String {
        self.source.name()
    }

    /// Replaces the source of bursts, from the next burst on, by `source`, whose name for clients is `name`.
    pub fn switch(&self, source: Box<dyn Source>, name: String) {
        self.source.post(NextSource { source, name });
    }

    /// Returns the time at which the processing thread was started.
    #[must_use]
    pub fn started(&self) -> Instant {
        self.started
    }

    /// Returns the channel of the newest light set.
    #[must_use]
    pub fn sets(&self) -> &SetChannel {
        &self.sets
    }

    /// Returns the channel of the settings: requests of clients to the processing thread, and its answers.
    #[must_use]
    pub fn settings(&self) -> &SettingsChannel {
        &self.settings
    }

    /// Returns the state of the processing thread and of the source.
    #[must_use]
    pub fn status(&self) -> &ThreadStatus {
        &self.status
    }

    /// Returns the durations of the stages of all frames since the start.
    #[must_use]
    pub fn durations(&self) -> &DurationLog {
        &self.durations
    }

    /// Returns the channel of the requests for frames and maps, from which pictures are rendered.
    #[must_use]
    pub fn views(&self) -> &Views {
        &self.views
    }

    /// Returns the channel of the requests for light sets of a second sampler.
    #[must_use]
    pub fn comparison(&self) -> &Comparison {
        &self.comparison
    }

    /// Returns the tiers: light sets with fewer lights, or with another choice of ambient light or discs, than
    /// the probe's own set.
    #[must_use]
    pub fn tiers(&self) -> &Tiers {
        &self.tiers
    }

    /// Returns the state of the exposures and frames of the camera; `None` if the source is not a camera.
    #[must_use]
    pub fn camera(&self) -> Option<CameraStatus> {
        lock(&self.camera).clone()
    }

    /// Stores the state of the camera that `source` reads; `None` if `source` is not a camera.
    fn note_camera(&self, source: &dyn Source) {
        let mut camera = lock(&self.camera);
        let mut status = camera.take().unwrap_or_default();
        if source.camera(&mut status) {
            *camera = Some(status);
        }
    }

    /// Returns the age of `set`, and the reason why the processing thread has published no newer set.
    #[must_use]
    pub fn staleness(&self, set: &OwnedSet) -> Stale<String> {
        let age_ns = crate::clock::monotonic_ns().saturating_sub(set.timestamp_ns);
        let reason = self.status.failure().unwrap_or_else(|| "no newer frame yet".into());
        Stale { age_ms: age_ns / 1_000_000, reason }
    }
}

/// Locks `mutex`, also after a panic of another thread: no critical section leaves partial updates.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns five random characters. The random numbers are those that the standard library makes for the keys of
/// hash tables.
fn run_id() -> String {
    const DIGITS: &[u8; 32] = b"0123456789abcdefghjkmnpqrstvwxyz";
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u64(crate::clock::monotonic_ns());
    let random = hasher.finish();
    (0..5).map(|i| char::from(DIGITS[(random >> (5 * i)) as usize % DIGITS.len()])).collect()
}

/// A running processing thread; it stops on drop.
#[derive(Debug)]
pub struct Probe {
    link: Arc<Link>,
    thread: Option<JoinHandle<()>>,
}

impl Probe {
    /// Starts a thread that processes the bursts of `source`, whose name for clients is `name`.
    ///
    /// # Errors
    /// [`StartError`] where the settings do not suit the source, or the operating system starts no thread.
    pub fn start(source: Box<dyn Source>, name: String, config: Config) -> Result<Self, StartError> {
        let mut worker = Worker::try_new(source, name, config)?;
        let link = worker.link();
        let thread = std::thread::Builder::new().name("hemilux-probe".into());
        let thread = thread.spawn(move || worker.run()).map_err(StartError::Thread)?;
        Ok(Self { link, thread: Some(thread) })
    }

    /// Returns the state that the processing thread and the server share.
    #[must_use]
    pub fn link(&self) -> Arc<Link> {
        Arc::clone(&self.link)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.link.status.stop();
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            if thread.join().is_err() {
                tracing::error!("the processing thread panicked");
            }
        }
    }
}
