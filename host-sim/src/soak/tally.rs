//! Counts of the replies that the clients of a soak test receive, and the fluxes of the published sets, with which replies are compared.

use hemilux::clock;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Number of newest published sets whose fluxes are stored for comparison with replies.
const KEPT: usize = 1 << 14;

/// Longest wait of [`Tally::check`] for the publication of a set that a client has received.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Step of the age in stale sets, milliseconds: the server encodes a stale set once per step.
const AGE_STEP_MS: u64 = 100;

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
    /// Number of replies that are marked stale.
    pub stale: AtomicU64,
    /// Number of replies that are not marked stale although their set is not newer than the request.
    pub unmarked: AtomicU64,
    pub errors: AtomicU64,
    pub changes: AtomicU64,
    pub rude: AtomicU64,
    worst_us: AtomicU64,
    published: Mutex<Newest>,
    words: Mutex<Vec<String>>,
    changed: Mutex<BTreeSet<&'static str>>,
}

/// Values of a published set with which replies are compared.
#[derive(Clone, Copy, Default)]
pub(super) struct Published {
    /// Scalar flux, red, green, blue.
    pub flux: [f32; 3],
    /// End of the burst, CLOCK_MONOTONIC, nanoseconds.
    pub timestamp_ns: u64,
}

/// The newest sets; the set of frame `f` has the index `f` modulo [`KEPT`].
struct Newest {
    frames: u64,
    sets: Vec<Published>,
}

/// What a client knows when it requests a set.
#[derive(Clone, Copy)]
pub(super) struct Before {
    /// Sets of frames from this number on are newer than the request; other sets must be marked stale.
    pub first_new: u64,
    /// Time of the request, CLOCK_MONOTONIC, nanoseconds; 0 for sets that are received without a request.
    pub asked_ns: u64,
}

/// Values of a set in a reply.
pub(super) struct Reply {
    pub frame: u64,
    /// Scalar flux; `None` for forms that lack it.
    pub flux: Option<[f32; 3]>,
    /// Age of a set that is marked stale, milliseconds.
    pub stale_ms: Option<u64>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Tally {
    pub fn new() -> Self {
        // An entry that is not zero makes the memory resident from the start.
        let unused = Published { timestamp_ns: u64::MAX, ..Published::default() };
        Self {
            over: AtomicBool::new(false),
            replies: AtomicU64::new(0),
            checked: AtomicU64::new(0),
            stale: AtomicU64::new(0),
            unmarked: AtomicU64::new(0),
            errors: AtomicU64::new(0),
            changes: AtomicU64::new(0),
            rude: AtomicU64::new(0),
            worst_us: AtomicU64::new(0),
            published: Mutex::new(Newest { frames: 0, sets: vec![unused; KEPT] }),
            words: Mutex::default(),
            changed: Mutex::default(),
        }
    }

    /// Stores the values of a published set; frame numbers must ascend.
    pub fn publish(&self, frame: u64, set: Published) {
        let mut published = lock(&self.published);
        published.sets[frame as usize % KEPT] = set;
        published.frames = frame + 1;
    }

    /// Returns what is known before a request is sent.
    pub fn before(&self) -> Before {
        Before { first_new: lock(&self.published).frames, asked_ns: clock::monotonic_ns() }
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
            eprintln!("soak: error: {what}");
            words.push(what);
        }
    }

    /// Counts an error with the description `what` unless `holds`.
    fn require(&self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.error(what());
        }
    }

    /// Returns the descriptions of the first errors of the clients.
    pub fn words(&self) -> Vec<String> {
        lock(&self.words).clone()
    }

    /// Compares a reply with the published set of its frame: the flux, the mark of a stale set and its age.
    pub fn check(&self, path: &str, before: Before, reply: &Reply) {
        let received_ns = clock::monotonic_ns();
        let known = match self.published(reply.frame) {
            Ok(Some(known)) => known,
            Ok(None) => return,
            Err(what) => return self.error(format!("{path}: {what}")),
        };
        self.checked.fetch_add(1, Ordering::Relaxed);
        let frame = reply.frame;
        if let Some(flux) = reply.flux {
            let is_same = known.flux.iter().zip(flux).all(|(a, b)| (a - b).abs() <= SAME * a.abs());
            self.require(is_same, || {
                format!("{path}: frame {frame} has the flux {flux:?}, expected {:?}", known.flux)
            });
        }
        let age_ms = |ns: u64| ns.saturating_sub(known.timestamp_ns) / 1_000_000;
        let [least, most] = [age_ms(before.asked_ns).saturating_sub(AGE_STEP_MS), age_ms(received_ns)];
        match reply.stale_ms {
            Some(age) => {
                self.stale.fetch_add(1, Ordering::Relaxed);
                self.require((least..=most).contains(&age), || {
                    format!("{path}: frame {frame} has an age of {age} ms, expected {least} to {most} ms")
                });
            }
            None if frame < before.first_new => {
                self.unmarked.fetch_add(1, Ordering::Relaxed);
                self.error(format!("{path}: frame {frame} of {most} ms is not marked stale"));
            }
            None => {}
        }
    }

    /// Returns the published set of `frame`; `None` if it is no longer stored. Waits for the publication of a set that a client has received
    /// already.
    fn published(&self, frame: u64) -> Result<Option<Published>, String> {
        let began = Instant::now();
        while began.elapsed() < LONGEST_WAIT {
            let published = lock(&self.published);
            if frame < published.frames {
                let is_kept = published.frames - frame <= KEPT as u64;
                return Ok(is_kept.then(|| published.sets[frame as usize % KEPT]));
            }
            drop(published);
            std::thread::sleep(Duration::from_micros(100));
        }
        Err(format!("frame {frame}, which was not published"))
    }
}
