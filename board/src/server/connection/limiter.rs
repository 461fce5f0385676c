//! Limits the number of connections, in total and per client. At a limit, a new connection displaces the connection of the
//! lowest rank.

use super::activity::{Activity, Rank};
use crate::server::client_key::ClientKey;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Grants permits for connections, up to a total number and a number per client.
#[derive(Debug)]
pub(in crate::server) struct ConnectionLimiter {
    epoch: Instant,
    total: usize,
    per_client: usize,
    state: Mutex<LimiterState>,
    /// Notified when the permit of a connection is released.
    released: tokio::sync::Notify,
}

#[derive(Debug, Default)]
struct LimiterState {
    next_id: u64,
    /// Number of connection permits that are not released, including those of displaced connections.
    permits: usize,
    /// Connections that count towards the limits, by the id of their permit.
    entries: HashMap<u64, Entry>,
}

#[derive(Debug)]
struct Entry {
    /// The client of the connection; `None` for a connection of a trusted proxy that is between two requests.
    client: Option<ClientKey>,
    activity: Arc<Activity>,
}

/// Permission for one open connection, released on drop.
#[derive(Debug)]
pub(in crate::server) struct Permit {
    limiter: Arc<ConnectionLimiter>,
    id: u64,
    activity: Arc<Activity>,
}

impl ConnectionLimiter {
    pub(super) fn new(total: usize, per_client: usize) -> Arc<Self> {
        let (state, released) = (Mutex::default(), tokio::sync::Notify::new());
        Arc::new(Self { epoch: Instant::now(), total, per_client, state, released })
    }

    /// Grants a permit to a new connection of `client`. Where a limit is reached, another connection is displaced; `None`
    /// where none may be displaced.
    pub(super) fn try_acquire(self: &Arc<Self>, client: Option<ClientKey>) -> Option<Permit> {
        let mut state = self.lock();
        state.make_room(client, self.per_client);
        if state.entries.len() >= self.total {
            state.displace_for(client)?;
        }
        let activity = Activity::new(self.epoch);
        let id = state.next_id;
        state.next_id += 1;
        state.permits += 1;
        state.entries.insert(id, Entry { client, activity: Arc::clone(&activity) });
        Some(Permit { limiter: Arc::clone(self), id, activity })
    }

    /// Closes the connections on which an answer has been blocked for `ms` milliseconds or longer.
    pub(in crate::server) fn cut_blocked(&self, ms: u64) {
        let mut state = self.lock();
        let is_blocked = |entry: &Entry| entry.activity.blocked_for_ms() >= ms;
        let blocked: Vec<_> =
            state.entries.iter().filter(|(_, e)| is_blocked(e)).map(|(id, _)| *id).collect();
        for id in blocked {
            state.displace(id);
        }
    }

    /// Closes all connections of all clients.
    pub(super) fn cut_all(&self) {
        self.lock().entries.values().for_each(|entry| entry.activity.cut());
    }

    /// Waits until the permits of all connections are released.
    pub(super) async fn wait_empty(&self) {
        loop {
            let released = self.released.notified();
            tokio::pin!(released);
            released.as_mut().enable();
            if self.lock().permits == 0 {
                return;
            }
            released.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, LimiterState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LimiterState {
    /// Returns the id of the connection of the lowest rank among those for which `is_meant` returns true.
    fn lowest(&self, is_meant: impl Fn(&Entry) -> bool) -> Option<u64> {
        let entries = self.entries.iter().filter(|(_, entry)| is_meant(entry));
        entries.min_by_key(|(id, entry)| (entry.activity.rank(), Reverse(**id))).map(|(id, _)| *id)
    }

    fn displace(&mut self, id: u64) -> Option<()> {
        self.entries.remove(&id).map(|entry| entry.activity.cut())
    }

    fn count(&self, client: Option<ClientKey>) -> usize {
        self.entries.values().filter(|entry| entry.client == client).count()
    }

    /// Displaces connections of `client` until `client` has fewer than `limit`.
    fn make_room(&mut self, client: Option<ClientKey>, limit: usize) {
        while client.is_some() && self.count(client) >= limit.max(1) {
            let Some(lowest) = self.lowest(|entry| entry.client == client) else { return };
            self.displace(lowest);
        }
    }

    /// Displaces a connection at the limit on all connections. If another client has more connections than `client`, and more than one, one
    /// of the client with the most is displaced; else one of `client`. If `client` has none and all others have one each, a connection that
    /// answers no request is displaced.
    fn displace_for(&mut self, client: Option<ClientKey>) -> Option<()> {
        let own = self.count(client);
        let most = self.entries.values().map(|entry| self.count(entry.client)).max()?;
        let lowest = if most > own.max(1) {
            self.lowest(|entry| self.count(entry.client) == most)
        } else if own > 0 {
            self.lowest(|entry| entry.client == client)
        } else {
            self.lowest(|entry| entry.activity.rank() < Rank::Stalled(0))
        };
        self.displace(lowest?)
    }
}

impl Permit {
    pub(in crate::server) fn activity(&self) -> &Arc<Activity> {
        &self.activity
    }

    /// Counts this connection of a proxy under `client`, whose request the proxy forwards.
    pub(in crate::server) fn assign(&self, client: ClientKey) {
        let mut state = self.limiter.lock();
        if state.entries.get(&self.id).is_none_or(|entry| entry.client == Some(client)) {
            return;
        }
        state.make_room(Some(client), self.limiter.per_client);
        if let Some(entry) = state.entries.get_mut(&self.id) {
            entry.client = Some(client);
        }
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut state = self.limiter.lock();
        state.entries.remove(&self.id);
        state.permits -= 1;
        drop(state);
        self.limiter.released.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::task::{Context, Waker};

    fn client(text: &str) -> Option<ClientKey> {
        Some(ClientKey::of(text.parse().expect("an address")))
    }

    fn is_cut(permit: &Permit) -> bool {
        permit.activity.poll_cut(&Context::from_waker(Waker::noop()))
    }

    #[test]
    fn a_connection_over_the_clients_limit_displaces_the_one_of_lowest_rank() {
        let limiter = ConnectionLimiter::new(9, 2);
        let busy = limiter.try_acquire(client("10.0.0.1")).expect("a permit");
        let _request = busy.activity.begin();
        let silent = limiter.try_acquire(client("::ffff:10.0.0.1")).expect("a permit of the same client");
        let third = limiter.try_acquire(client("10.0.0.1")).expect("a permit");
        assert_eq!([&busy, &silent, &third].map(is_cut), [false, true, false], "no request, no permit");
        let other = limiter.try_acquire(client("10.0.0.2")).expect("a permit");
        assert!(!is_cut(&other) && !is_cut(&third), "another client");
    }

    #[test]
    fn at_the_total_limit_a_connection_of_the_largest_client_is_displaced() {
        let limiter = ConnectionLimiter::new(4, 4);
        let many = [(); 3].map(|()| limiter.try_acquire(client("10.0.0.1")).expect("a permit"));
        let requests = many.each_ref().map(|permit| permit.activity.begin());
        let one = limiter.try_acquire(client("10.0.0.2")).expect("a permit");
        let new = limiter.try_acquire(client("10.0.0.3")).expect("a permit");
        assert_eq!(many.iter().filter(|permit| is_cut(permit)).count(), 1, "one of three");
        assert!(!is_cut(&one) && !is_cut(&new), "the others stay");
        drop((requests, many));
        assert_eq!(limiter.lock().entries.len(), 2, "released");
    }

    #[test]
    fn a_connection_that_can_displace_no_other_is_refused() {
        let limiter = ConnectionLimiter::new(2, 2);
        let permits = ["10.0.0.1", "10.0.0.2"].map(|ip| limiter.try_acquire(client(ip)).expect("a permit"));
        let _requests = permits.each_ref().map(|permit| permit.activity.begin());
        assert!(limiter.try_acquire(client("10.0.0.3")).is_none(), "both answer a request");
    }

    #[test]
    fn an_ipv6_network_of_64_bits_counts_as_one_client() {
        let limiter = ConnectionLimiter::new(9, 1);
        let first = limiter.try_acquire(client("2001:db8::1")).expect("a permit");
        let other = limiter.try_acquire(client("2001:db8:0:1::1")).expect("a permit");
        let second = limiter.try_acquire(client("2001:db8::ffff:1")).expect("a permit");
        assert_eq!([&first, &other, &second].map(is_cut), [true, false, false], "the same network");
    }

    #[test]
    fn forwarded_requests_count_under_their_own_clients() {
        let limiter = ConnectionLimiter::new(9, 1);
        let permits = [(); 3].map(|()| limiter.try_acquire(None).expect("a proxy's connection"));
        for (permit, ip) in permits.iter().zip(["10.0.0.1", "10.0.0.2", "10.0.0.1"]) {
            permit.assign(client(ip).expect("a client"));
        }
        assert_eq!(permits.each_ref().map(is_cut), [true, false, false], "two of one client, limit one");
    }
}
