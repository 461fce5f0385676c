//! Light sets for a renderer: a thread requests each set of a probe, reconnects after a failure, and keeps the newest set.
//!
//! ```no_run
//! use hemilux::client::{Client, Options};
//! use std::time::{Duration, Instant};
//!
//! // Blocking: each new set.
//! let client = Client::connect(&Options::new("http://127.0.0.1:8080"))?;
//! while let Some(set) = client.next(Duration::from_secs(5)) {
//!     println!("frame {}: {} lights", set.frame, set.lights.len());
//! }
//! // A signal for each new set, and lights for each frame that is drawn.
//! let options = Options { lights: Some(8), ..Options::new("http://127.0.0.1:8080") };
//! let client = Client::connect_with(&options, |set| println!("{}", set.frame))?;
//! let mut lights = Vec::new();
//! client.interpolated(Instant::now(), &mut lights);
//! # Ok::<(), hemilux::client::ClientError>(())
//! ```

mod fetch;
mod interpolate;
mod set;

pub use set::Set;

use fetch::{Fetcher, Trouble};
pub use hemilux_core::light::Light;
pub use hemilux_core::wire::Coordinates;
use interpolate::interpolate;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Pause after the first of successive failures; each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// Longest pause between two attempts to connect to the probe.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Longest interval between the arrivals of two sets over which lights are interpolated. After a longer one, lights change at once.
const LONGEST_BLEND: Duration = Duration::from_secs(1);

/// The requested light sets, and the address of the probe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// The probe's address, `http://HOST:PORT`.
    pub url: String,
    /// The axes of the directions and harmonics in the sets.
    pub coordinates: Coordinates,
    /// Largest number of lights in a set; `None` for all lights of the probe's set.
    pub lights: Option<usize>,
    /// True if sets include spherical harmonics of the light that the directional lights do not represent.
    pub ambient: bool,
    /// True if lights are fitted as uniform discs of their radius; `None` for the probe's own setting.
    pub soft: Option<bool>,
    /// Timeout of a request for a set, after which the request is repeated. The probe answers within 1.5 s.
    pub timeout: Duration,
}

impl Options {
    /// Returns the options for all lights in the axes of the probe at `url`, with a timeout of two seconds.
    #[must_use]
    pub fn new(url: &str) -> Self {
        let (coordinates, timeout) = (Coordinates::Probe, Duration::from_secs(2));
        Self { url: url.into(), coordinates, lights: None, ambient: false, soft: None, timeout }
    }
}

/// Reasons why a client cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The URL is not that of a probe.
    #[error("probe '{0}': found another address, expected http://HOST:PORT")]
    BadUrl(String),
    /// The operating system cannot start a thread.
    #[error("the client's thread: found {0}, expected it to start")]
    Thread(std::io::Error),
}

/// The state of the connection to the probe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// No light set has been received yet.
    Connecting,
    /// The connection is open and light sets are received.
    Live,
    /// The probe answers, but its source has stopped.
    Stale(String),
    /// The probe does not answer, for the contained reason. Requests are repeated.
    Lost(String),
}

/// A connection to a probe. When it is dropped, its thread ends after the pending answer, and no further set is signalled.
#[derive(Debug)]
pub struct Client {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    sets: Mutex<Sets>,
    news: Condvar,
    stopping: AtomicBool,
}

/// The newest light set and the one before, and memory for the next set.
#[derive(Debug)]
struct Sets {
    latest: Option<Arc<Set>>,
    previous: Option<Arc<Set>>,
    spare: Option<Arc<Set>>,
    arrived: Instant,
    interval: Duration,
    /// Number of sets that have been received, by which waiting threads detect a new set.
    count: u64,
    state: State,
}

impl Client {
    /// Starts the thread that requests light sets of a probe.
    ///
    /// # Errors
    /// [`ClientError`] for a wrong URL, or if no thread can be started. A probe that does not answer is not an error: see
    /// [`Client::state`].
    pub fn connect(options: &Options) -> Result<Self, ClientError> {
        Self::connect_with(options, |_| {})
    }

    /// Starts the thread that requests light sets of a probe and calls `signal` with each new set.
    ///
    /// # Errors
    /// [`ClientError`] for a wrong URL, or if no thread can be started. A probe that does not answer is not an error: see
    /// [`Client::state`].
    pub fn connect_with(
        options: &Options,
        signal: impl FnMut(&Set) + Send + 'static,
    ) -> Result<Self, ClientError> {
        let fetcher = Fetcher::try_new(options)?;
        let sets = Sets {
            latest: None,
            previous: None,
            spare: None,
            arrived: Instant::now(),
            interval: Duration::ZERO,
            count: 0,
            state: State::Connecting,
        };
        let shared = Arc::new(Shared {
            sets: Mutex::new(sets),
            news: Condvar::new(),
            stopping: AtomicBool::new(false),
        });
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("hemilux-client".into());
        thread.spawn(move || follow(&theirs, fetcher, signal)).map_err(ClientError::Thread)?;
        Ok(Self { shared })
    }

    /// Returns the newest light set; `None` before the first one.
    #[must_use]
    pub fn latest(&self) -> Option<Arc<Set>> {
        self.shared.lock().latest.clone()
    }

    /// Waits up to `patience` for a light set that is newer than the newest one at the time of the call; `None` if none has come by then.
    #[must_use]
    pub fn next(&self, patience: Duration) -> Option<Arc<Set>> {
        let sets = self.shared.lock();
        let before = sets.count;
        let waited = self.shared.news.wait_timeout_while(sets, patience, |sets| sets.count == before);
        let (sets, _) = waited.unwrap_or_else(PoisonError::into_inner);
        (sets.count != before).then(|| sets.latest.clone())?
    }

    /// Returns the state of the connection to the probe.
    #[must_use]
    pub fn state(&self) -> State {
        self.shared.lock().state.clone()
    }

    /// Writes the lights for the time `now` to `lights`: each light moves from its direction in the previous set to that in the newest set;
    /// lights are matched by id; new lights fade in and old ones out. The lights are delayed by one set and never extrapolated.
    pub fn interpolated(&self, now: Instant, lights: &mut Vec<Light>) {
        let sets = self.shared.lock();
        let (latest, previous) = (sets.latest.clone(), sets.previous.clone());
        let (passed, interval) = (now.saturating_duration_since(sets.arrived), sets.interval);
        drop(sets);
        let part = if interval.is_zero() { 1.0 } else { passed.as_secs_f32() / interval.as_secs_f32() };
        lights.clear();
        match (latest, previous) {
            (Some(latest), Some(previous)) if part < 1.0 => interpolate(&previous, &latest, part, lights),
            (Some(latest), _) => lights.extend_from_slice(&latest.lights),
            (None, _) => {}
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::Relaxed);
        self.shared.news.notify_all();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Sets> {
        self.sets.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Stores a received light set and notifies waiting threads; returns true if the set is of another frame than the last one.
    fn take(&self, set: Arc<Set>) -> bool {
        let mut sets = self.lock();
        let state = set.stale.as_ref().map_or(State::Live, |stale| State::Stale(stale.reason.clone()));
        let follows = sets.latest.as_ref().is_some_and(|l| l.run == set.run);
        let is_news = !follows || sets.latest.as_ref().is_some_and(|l| l.frame != set.frame);
        if is_news {
            let now = Instant::now();
            let passed = now.saturating_duration_since(sets.arrived);
            let blends = follows && passed <= LONGEST_BLEND;
            sets.interval = if blends { passed } else { Duration::ZERO };
            sets.arrived = now;
            sets.count += 1;
            let before = sets.latest.replace(set);
            sets.spare = std::mem::replace(&mut sets.previous, before);
        } else {
            sets.latest = Some(set);
        }
        sets.state = state;
        drop(sets);
        self.news.notify_all();
        is_news
    }

    /// Returns memory for the next light set: that of an earlier set without other owners, or new memory.
    fn spare(&self) -> Set {
        let spare = self.lock().spare.take();
        spare.and_then(|set| Arc::try_unwrap(set).ok()).unwrap_or_default()
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}

/// Requests light sets until the client is dropped.
fn follow(shared: &Shared, mut fetcher: Fetcher, mut signal: impl FnMut(&Set)) {
    let mut pause = FIRST_PAUSE;
    let mut after = None;
    while !shared.is_stopping() {
        match fetcher.next(after, shared.spare()) {
            Ok(set) => {
                pause = FIRST_PAUSE;
                after = Some(set.frame);
                let set = Arc::new(set);
                if shared.take(Arc::clone(&set)) && !shared.is_stopping() {
                    signal(&set);
                }
            }
            // A timeout is no refusal by the probe: the request is repeated without a pause.
            Err(Trouble::Silence) => shared.lock().state = State::Lost("no answer in time".into()),
            Err(Trouble::Other(reason)) => {
                shared.lock().state = State::Lost(reason);
                rest(shared, pause);
                pause = (2 * pause).min(LONGEST_PAUSE);
            }
        }
    }
}

/// Waits for the time `pause` or until the client is dropped.
fn rest(shared: &Shared, pause: Duration) {
    let sets = shared.lock();
    drop(shared.news.wait_timeout_while(sets, pause, |_| !shared.is_stopping()));
}
