//! The processing thread: takes bursts from a source, runs the pipeline and publishes the newest light set.
//!
//! The thread never waits for a client: results go through a latest-value channel ([`Link::subscribe`]), changes of the settings come in
//! through a mailbox and take effect with the next frame. After the first frames it allocates nothing (`board/tests/allocations.rs`).

pub mod compare;
mod config;
mod mailbox;
mod ring;
pub mod settings;
pub mod tiers;
mod views;
mod worker;

pub use config::{Config, EXTRAPOLATIONS, Refusal, extrapolation_name};
pub use mailbox::Applied;
pub use settings::Change;
pub use views::{BurstView, Given, MapView, Slot, Views};
pub use worker::Worker;

use crate::light_set::OwnedSet;
use crate::pipeline::PipelineError;
use crate::source::Source;
use crate::timing::Timings;
use compare::Comparison;
use hemilux_core::wire::Stale;
use mailbox::Mailbox;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;
use tiers::Tiers;
use tokio::sync::{Notify, watch};

/// Why the probe could not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The source and the settings do not make a pipeline.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The operating system gave no thread.
    #[error("the processing thread: found {0}, expected it to start")]
    Thread(std::io::Error),
}

/// The state that the processing thread and the server share.
#[derive(Debug)]
pub struct Link {
    run: String,
    source: String,
    started: Instant,
    latest: watch::Sender<Option<Arc<OwnedSet>>>,
    /// Notifies waiters of a new set in FIFO order.
    notify: Notify,
    mailbox: Mailbox,
    failure: Mutex<Option<String>>,
    timings: Mutex<Timings>,
    encode_us: AtomicU32,
    stopping: AtomicBool,
    /// True when the processing thread has ended.
    ended: watch::Sender<bool>,
    turns: AtomicU64,
    views: Views,
    comparison: Comparison,
    tiers: Tiers,
    exposures: Mutex<Exposures>,
}

/// The exposures of the source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exposures {
    /// As they are now, seconds, rising.
    pub seconds: Vec<f64>,
    /// Why they cannot be changed, if so.
    pub fixed: Option<&'static str>,
}

impl Link {
    fn new(source: String, config: Config, exposures: Exposures) -> Self {
        Self {
            run: run_id(),
            source,
            started: Instant::now(),
            latest: watch::Sender::new(None),
            notify: Notify::new(),
            timings: Mutex::new(Timings::new(config.budgets)),
            tiers: Tiers::new(&config.pipeline, config.tiers),
            mailbox: Mailbox::new(config),
            failure: Mutex::new(None),
            encode_us: AtomicU32::new(0),
            stopping: AtomicBool::new(false),
            ended: watch::Sender::new(false),
            turns: AtomicU64::new(0),
            views: Views::default(),
            comparison: Comparison::default(),
            exposures: Mutex::new(exposures),
        }
    }

    /// Changes at every start of the probe.
    #[must_use]
    pub fn run(&self) -> &str {
        &self.run
    }

    /// The source's name.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.source
    }

    /// When the probe started.
    #[must_use]
    pub fn started(&self) -> Instant {
        self.started
    }

    /// A receiver of the newest set, if any; [`Link::newer`] waits for a newer one.
    #[must_use]
    pub fn subscribe(&self) -> watch::Receiver<Option<Arc<OwnedSet>>> {
        self.latest.subscribe()
    }

    /// Waits for a set newer than the last one that `seen` has read. Waiters are notified in FIFO order, so that clients that wait for every
    /// frame are not delayed by a burst of others.
    pub async fn newer(&self, seen: &watch::Receiver<Option<Arc<OwnedSet>>>) {
        loop {
            let notified = self.notify.notified();
            tokio::pin!(notified);
            // Queued before the check, so that no set is missed between them.
            notified.as_mut().enable();
            if seen.has_changed().unwrap_or(true) {
                return;
            }
            // The notification may be that of a set that was published before the check.
            notified.await;
        }
    }

    fn publish(&self, set: Arc<OwnedSet>) {
        self.latest.send_replace(Some(set));
        self.notify.notify_waiters();
    }

    /// A receiver of the settings in effect.
    #[must_use]
    pub fn applied(&self) -> watch::Receiver<Applied> {
        self.mailbox.applied()
    }

    /// Requests a change of the settings; returns the number of the [`Applied`] that answers it.
    ///
    /// # Errors
    /// [`Refusal`] for values that cannot be set; nothing changes then.
    pub fn change(&self, change: &Change) -> Result<u64, Refusal> {
        self.mailbox.post(change)
    }

    /// The age of `set`, and the reason why there is no newer one.
    #[must_use]
    pub fn staleness(&self, set: &OwnedSet) -> Stale<String> {
        let age_ns = crate::clock::monotonic_ns().saturating_sub(set.timestamp_ns);
        let reason = self.failure().unwrap_or_else(|| "no newer frame yet".into());
        Stale { age_ms: age_ns / 1_000_000, reason }
    }

    /// The fault of the source, if it has one.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        lock(&self.failure).clone()
    }

    /// Requests for exposures and maps.
    #[must_use]
    pub fn views(&self) -> &Views {
        &self.views
    }

    /// Requests for a second sampler's sets.
    #[must_use]
    pub fn comparison(&self) -> &Comparison {
        &self.comparison
    }

    /// Sets for clients that request other lights than the probe's own set has.
    #[must_use]
    pub fn tiers(&self) -> &Tiers {
        &self.tiers
    }

    /// The source's exposures.
    #[must_use]
    pub fn exposures(&self) -> Exposures {
        lock(&self.exposures).clone()
    }

    /// How long each stage has taken since the start, and how often longer than its budget.
    #[must_use]
    pub fn timings(&self) -> Timings {
        lock(&self.timings).clone()
    }

    fn set_failure(&self, reason: Option<String>) {
        *lock(&self.failure) = reason;
    }

    /// Remembers how long encoding took, for the next frame's report.
    pub fn set_encode_us(&self, us: u32) {
        self.encode_us.store(us, Ordering::Relaxed);
    }

    /// Counts the turns of the processing thread, with or without a burst: at least two a second while it is alive.
    #[must_use]
    pub fn turns(&self) -> u64 {
        self.turns.load(Ordering::Relaxed)
    }

    /// Waits for the end of the processing thread.
    pub async fn ended(&self) {
        let _ = self.ended.subscribe().wait_for(|ended| *ended).await;
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}

/// Locks `mutex`, also after a panic of another thread: no critical section leaves partial updates.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Five random characters, from the keys that the standard library takes for its hash tables.
fn run_id() -> String {
    const DIGITS: &[u8; 32] = b"0123456789abcdefghjkmnpqrstvwxyz";
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u64(crate::clock::monotonic_ns());
    let random = hasher.finish();
    (0..5).map(|i| char::from(DIGITS[(random >> (5 * i)) as usize % DIGITS.len()])).collect()
}

/// A running processing thread; dropping it stops it.
#[derive(Debug)]
pub struct Probe {
    link: Arc<Link>,
    thread: Option<JoinHandle<()>>,
}

impl Probe {
    /// Starts processing what `source`, called `name`, gives.
    ///
    /// # Errors
    /// [`StartError`].
    pub fn start(source: Box<dyn Source>, name: String, config: Config) -> Result<Self, StartError> {
        let mut worker = Worker::try_new(source, name, config)?;
        let link = worker.link();
        let thread = std::thread::Builder::new().name("hemilux-probe".into());
        let thread = thread.spawn(move || worker.run()).map_err(StartError::Thread)?;
        Ok(Self { link, thread: Some(thread) })
    }

    /// The shared state between the processing thread and the server.
    #[must_use]
    pub fn link(&self) -> Arc<Link> {
        Arc::clone(&self.link)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.link.stopping.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            if thread.join().is_err() {
                tracing::error!("the processing thread panicked");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn waiters_are_notified_in_fifo_order_and_a_newer_set_returns_at_once() {
        let link = Arc::new(Link::new("test".into(), Config::default(), Exposures::default()));
        let (woken, mut order) = tokio::sync::mpsc::unbounded_channel();
        // More than are woken in one go.
        for i in 0..100 {
            let (link, woken) = (Arc::clone(&link), woken.clone());
            tokio::spawn(async move {
                link.newer(&link.subscribe()).await;
                woken.send(i).expect("a listener");
            });
            tokio::task::yield_now().await;
        }
        let seen = link.subscribe();
        link.publish(Arc::default());
        for i in 0..100 {
            assert_eq!(order.recv().await, Some(i));
        }
        link.newer(&seen).await;
    }

    #[tokio::test]
    async fn stale_notification_does_not_wake_waiters() {
        let link = Arc::new(Link::new("test".into(), Config::default(), Exposures::default()));
        link.latest.send_replace(Some(Arc::default()));
        let waiting = tokio::spawn({
            let link = Arc::clone(&link);
            async move { link.newer(&link.subscribe()).await }
        });
        tokio::task::yield_now().await;
        link.notify.notify_waiters();
        for _ in 0..3 {
            tokio::task::yield_now().await;
        }
        assert!(!waiting.is_finished(), "the set was there before it asked");
        link.publish(Arc::default());
        waiting.await.expect("a newer set");
    }
}
