//! Counters of the server, and the log of refusals: at most one line per reason and minute, with the number of refusals since the last line.

use super::paths::{PATHS, index_of};
use std::array;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Reasons for a refusal or for the end of a connection.
pub(super) const REASONS: [&str; 11] = [
    "malformed",
    "host",
    "foreign",
    "token",
    "connections",
    "slow",
    "unproven",
    "guessing",
    "memory",
    "displaced",
    "accept",
];

/// Number of classes of HTTP status codes, 1xx to 5xx.
pub(super) const CLASSES: usize = 5;

/// Upper bounds of the bins of the histogram of delivery times, microseconds: from the finished light set to the transfer
/// of the answer to the connection.
pub(super) const DELIVERY_US: [u64; 10] =
    [100, 250, 500, 1000, 2000, 5000, 10_000, 25_000, 100_000, 1_000_000];

/// Shortest time between two log lines about the same reason, milliseconds.
const QUIET_MS: u64 = 60_000;

/// Counters of the server. All but `open` and `streams` never decrease.
#[derive(Debug)]
pub(super) struct Counts {
    began: Instant,
    /// Number of answers by route and class of status; the last route counts the answers to unknown paths.
    pub(super) requests: [[AtomicU64; CLASSES]; PATHS.len() + 1],
    refused: [Refused; REASONS.len()],
    /// Number of open connections to the server.
    pub(super) open: AtomicU64,
    /// Number of connections accepted since the start of the server.
    pub(super) accepted: AtomicU64,
    /// Number of open streams of server-sent events and of open WebSockets.
    pub(super) streams: AtomicU64,
    /// Number of delivered light sets by delivery time; the last element counts times above the last bound.
    pub(super) delivery: [AtomicU64; DELIVERY_US.len() + 1],
    /// Sum of the delivery times of all light sets, microseconds.
    pub(super) delivery_us: AtomicU64,
}

#[derive(Debug, Default)]
struct Refused {
    count: AtomicU64,
    /// Value of `count` when the last line about this reason was logged.
    told: AtomicU64,
    /// Earliest time of the next log line about this reason, milliseconds since the start.
    quiet_until: AtomicU64,
}

impl Default for Counts {
    fn default() -> Self {
        Self {
            began: Instant::now(),
            requests: array::from_fn(|_| Default::default()),
            refused: Default::default(),
            open: AtomicU64::new(0),
            accepted: AtomicU64::new(0),
            streams: AtomicU64::new(0),
            delivery: Default::default(),
            delivery_us: AtomicU64::new(0),
        }
    }
}

impl Counts {
    /// Counts an answer to a request for `path` by route and class of `status`.
    pub(super) fn answered(&self, path: &str, status: u16) {
        let route = index_of(path).unwrap_or(PATHS.len());
        let class = usize::from(status / 100).clamp(1, CLASSES) - 1;
        self.requests[route][class].fetch_add(1, Relaxed);
    }

    /// Returns the number of answers.
    pub(super) fn answers(&self) -> u64 {
        self.requests.iter().flatten().map(|count| count.load(Relaxed)).sum()
    }

    /// Counts a light set that was sent `passed` after the set was finished.
    pub(super) fn delivered(&self, passed: Duration) {
        let us = u64::try_from(passed.as_micros()).unwrap_or(u64::MAX);
        let bucket = DELIVERY_US.iter().position(|bound| us <= *bound).unwrap_or(DELIVERY_US.len());
        self.delivery[bucket].fetch_add(1, Relaxed);
        self.delivery_us.fetch_add(us, Relaxed);
    }

    /// Counts a refusal under `reason`, one of [`REASONS`].
    pub(super) fn refused(&self, reason: &'static str) {
        let Some(refused) = REASONS.iter().position(|r| *r == reason).map(|i| &self.refused[i]) else {
            return;
        };
        let count = refused.count.fetch_add(1, Relaxed) + 1;
        let now = u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX);
        let until = refused.quiet_until.load(Relaxed);
        let mine = now >= until
            && refused.quiet_until.compare_exchange(until, now + QUIET_MS, Relaxed, Relaxed).is_ok();
        if mine {
            let since = count.saturating_sub(refused.told.swap(count, Relaxed));
            // An idle connection of a browser times out like one of a slow client.
            if reason == "slow" {
                tracing::info!("closed: {reason} ({since} since the last such line)");
            } else {
                tracing::warn!("refused: {reason} ({since} since the last such line)");
            }
        }
    }

    /// Returns the number of refusals since the start for each of [`REASONS`].
    pub(super) fn refusals(&self) -> impl Iterator<Item = (&'static str, u64)> {
        REASONS.iter().copied().zip(self.refused.iter().map(|r| r.count.load(Relaxed)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_is_logged_once_and_counted_always() {
        let counts = Counts::default();
        for _ in 0..1000 {
            counts.refused("token");
        }
        let token = &counts.refused[3];
        assert_eq!(
            (token.count.load(Relaxed), token.told.load(Relaxed)),
            (1000, 1),
            "logged at the first alone"
        );
        assert!(
            counts.refusals().all(|(reason, n)| n == if reason == "token" { 1000 } else { 0 }),
            "no other"
        );
    }

    #[test]
    fn times_fall_into_their_buckets() {
        let counts = Counts::default();
        for us in [0, 100, 101, 5_000_000] {
            counts.delivered(Duration::from_micros(us));
        }
        let found: Vec<_> = counts.delivery.iter().map(|n| n.load(Relaxed)).collect();
        assert_eq!(found, [2, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1], "bounds belong to the lower bucket");
    }
}
