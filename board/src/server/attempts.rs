//! Limits the rate at which each client may guess the token of the server.

use super::client_key::ClientKey;
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Number of wrong credentials that a client may send without a pause.
const BURST: u32 = 10;

/// Interval at which a client may send further wrong credentials after [`BURST`]: 30 per minute.
const INTERVAL: Duration = Duration::from_secs(2);

/// Largest number of clients with recorded failures; beyond it, the client whose failures expire first is
/// dropped.
const CLIENTS: usize = 1024;

/// Failed attempts of each client to guess the token.
#[derive(Debug, Default)]
pub(super) struct Attempts {
    /// The time at which all failures of a client are expired: each failure delays it by [`INTERVAL`].
    forgiven: Mutex<HashMap<ClientKey, Instant>>,
}

impl Attempts {
    /// Returns the time from `now` on for which the credentials of `client` are not checked; `None` if they are
    /// checked now.
    pub(super) fn blocked(&self, client: ClientKey, now: Instant) -> Option<Duration> {
        let forgiven = self.forgiven.lock().unwrap_or_else(PoisonError::into_inner);
        let left = forgiven.get(&client)?.saturating_duration_since(now);
        left.checked_sub(INTERVAL * (BURST - 1)).filter(|wait| !wait.is_zero())
    }

    /// Counts an attempt of `client` with wrong credentials.
    pub(super) fn failed(&self, client: ClientKey, now: Instant) {
        let mut forgiven = self.forgiven.lock().unwrap_or_else(PoisonError::into_inner);
        if forgiven.len() >= CLIENTS && !forgiven.contains_key(&client) {
            forgiven.retain(|_, until| *until > now);
            let oldest = forgiven.iter().min_by_key(|(_, until)| **until).map(|(client, _)| *client);
            if let Some(oldest) = oldest.filter(|_| forgiven.len() >= CLIENTS) {
                forgiven.remove(&oldest);
            }
        }
        let until = forgiven.entry(client).or_insert(now);
        *until = (*until).max(now) + INTERVAL;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    #[test]
    fn after_a_burst_of_failures_that_client_alone_must_wait() {
        let (attempts, now) = (Attempts::default(), Instant::now());
        let client = |n: u32| ClientKey::of(Ipv4Addr::from(n).into());
        let mut guesses = 0;
        // One guess every ten milliseconds, for a minute.
        for step in 0..6000 {
            let now = now + Duration::from_millis(10 * step);
            if attempts.blocked(client(1), now).is_none() {
                attempts.failed(client(1), now);
                guesses += 1;
            }
        }
        assert_eq!(guesses, 10 + 29, "a burst, then one every two seconds");
        assert_eq!(attempts.blocked(client(2), now), None, "another client");
        for n in 0..5000 {
            attempts.failed(client(n), now);
        }
        assert!(attempts.forgiven.lock().expect("no panic").len() <= CLIENTS, "bounded");
    }
}
