//! Counts of the replies that the clients of a soak test receive, and the fluxes of the published sets, with which replies are compared.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of newest published sets whose fluxes are stored for comparison with replies.
const KEPT: usize = 1 << 16;

/// Longest wait of [`Tally::check`] for the publication of a set that a client has received.
const LONGEST_WAIT: Duration = Duration::from_secs(2);

/// Number of errors whose descriptions are stored.
const ERRORS: usize = 20;

/// Largest relative difference between a flux in a reply and the published flux: rounding of decimal digits.
const SAME: f32 = 1e-5;

/// Counters of all clients, and the fluxes of the published sets.
pub(super) struct Tally {
    /// True if the clients must end.
    pub over: AtomicBool,
    pub replies: AtomicU64,
    pub checked: AtomicU64,
    pub stale: AtomicU64,
    pub errors: AtomicU64,
    pub changes: AtomicU64,
    pub rude: AtomicU64,
    worst_us: AtomicU64,
    published: Mutex<Published>,
    words: Mutex<Vec<String>>,
    changed: Mutex<BTreeSet<&'static str>>,
}

/// Scalar fluxes (red, green, blue) of the newest sets; the flux of frame `f` has the index `f` modulo [`KEPT`].
struct Published {
    frames: u64,
    flux: Vec<[f32; 3]>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Tally {
    pub fn new() -> Self {
        Self {
            over: AtomicBool::new(false),
            replies: AtomicU64::new(0),
            checked: AtomicU64::new(0),
            stale: AtomicU64::new(0),
            errors: AtomicU64::new(0),
            changes: AtomicU64::new(0),
            rude: AtomicU64::new(0),
            worst_us: AtomicU64::new(0),
            published: Mutex::new(Published { frames: 0, flux: vec![[0.0; 3]; KEPT] }),
            words: Mutex::default(),
            changed: Mutex::default(),
        }
    }

    /// Stores the flux of a published set; frame numbers must ascend.
    pub fn publish(&self, frame: u64, flux: [f32; 3]) {
        let mut published = lock(&self.published);
        published.flux[frame as usize % KEPT] = flux;
        published.frames = frame + 1;
    }

    /// Counts a reply that arrived `took` after its request.
    pub fn reply(&self, took: Duration) {
        self.replies.fetch_add(1, Ordering::Relaxed);
        self.worst_us.fetch_max(took.as_micros() as u64, Ordering::Relaxed);
    }

    /// Returns the longest time from a request to its reply.
    pub fn worst(&self) -> Duration {
        Duration::from_micros(self.worst_us.load(Ordering::Relaxed))
    }

    /// Counts an accepted change of a setting.
    pub fn change(&self, setting: &'static str) {
        self.changes.fetch_add(1, Ordering::Relaxed);
        lock(&self.changed).insert(setting);
    }

    /// Returns the number of settings that clients have changed at least once.
    pub fn settings(&self) -> usize {
        lock(&self.changed).len()
    }

    /// Counts an error of a client and stores its description; after the end of the run errors do not count.
    pub fn error(&self, what: String) {
        // The server stops before the last clients end.
        if self.over.load(Ordering::Relaxed) {
            return;
        }
        self.errors.fetch_add(1, Ordering::Relaxed);
        let mut words = lock(&self.words);
        if words.len() < ERRORS {
            words.push(what);
        }
    }

    /// Counts a comparison of a client; the comparison counts as an error with the description `what` unless `holds`.
    pub fn require(&self, holds: bool, what: impl FnOnce() -> String) {
        self.checked.fetch_add(1, Ordering::Relaxed);
        if !holds {
            self.error(what());
        }
    }

    /// Returns the descriptions of the first errors of the clients.
    pub fn words(&self) -> Vec<String> {
        lock(&self.words).clone()
    }

    /// Compares the scalar flux of a reply with the published set of its frame.
    pub fn check(&self, path: &str, frame: u64, flux: [f32; 3], is_stale: bool) {
        self.stale.fetch_add(u64::from(is_stale), Ordering::Relaxed);
        let began = Instant::now();
        let known = loop {
            let published = lock(&self.published);
            if frame < published.frames {
                // The flux of an older set is no longer stored; the set was published, which is correct.
                let is_kept = published.frames - frame <= KEPT as u64;
                break is_kept.then(|| published.flux[frame as usize % KEPT]);
            }
            drop(published);
            if began.elapsed() > LONGEST_WAIT {
                return self.error(format!("{path}: frame {frame}, which was not published"));
            }
            std::thread::sleep(Duration::from_micros(100));
        };
        let Some(known) = known else { return };
        let is_same = known.iter().zip(flux).all(|(a, b)| (a - b).abs() <= SAME * a.abs());
        self.require(is_same, || format!("{path}: frame {frame} has the flux {flux:?}, expected {known:?}"));
    }
}
