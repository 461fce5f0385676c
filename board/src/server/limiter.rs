//! Limits the number of connections, in total and per client address.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Grants permits for connections up to a total and a number per address.
#[derive(Debug)]
pub(super) struct ConnectionLimiter {
    most: usize,
    most_each: usize,
    state: Mutex<State>,
    /// Notified when a permit is released.
    released: tokio::sync::Notify,
}

#[derive(Debug, Default)]
struct State {
    all: usize,
    each: HashMap<IpAddr, usize>,
}

/// The limit that refused a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LimitReached {
    /// The total number of connections.
    All,
    /// The number of connections of one address.
    Address,
}

/// Permission for one connection, released on drop.
#[derive(Debug)]
pub(super) struct Permit {
    limiter: Arc<ConnectionLimiter>,
    client: IpAddr,
}

/// The key that connections are counted under: the address, or for IPv6 its /64 network, which one customer usually has alone.
fn client_key(ip: IpAddr) -> IpAddr {
    match ip.to_canonical() {
        IpAddr::V6(ip) if !ip.is_loopback() => Ipv6Addr::from(u128::from(ip) & (u128::MAX << 64)).into(),
        ip => ip,
    }
}

impl ConnectionLimiter {
    pub(super) fn new(most: usize, most_each: usize) -> Arc<Self> {
        Arc::new(Self { most, most_each, state: Mutex::default(), released: tokio::sync::Notify::new() })
    }

    /// Grants a permit to a connection from `ip`.
    pub(super) fn try_acquire(self: &Arc<Self>, ip: IpAddr) -> Result<Permit, LimitReached> {
        let client = client_key(ip);
        let mut state = self.lock();
        if state.all >= self.most {
            return Err(LimitReached::All);
        }
        let here = state.each.get(&client).copied().unwrap_or(0);
        if here >= self.most_each {
            return Err(LimitReached::Address);
        }
        state.all += 1;
        state.each.insert(client, here + 1);
        drop(state);
        Ok(Permit { limiter: Arc::clone(self), client })
    }

    /// Waits until all permits are released.
    pub(super) async fn wait_empty(&self) {
        loop {
            let released = self.released.notified();
            if self.lock().all == 0 {
                return;
            }
            released.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut state = self.limiter.lock();
        state.all -= 1;
        // Entries at zero are removed, so the table has at most one entry per connection.
        if let Some(here) = state.each.get_mut(&self.client) {
            *here -= 1;
            if *here == 0 {
                state.each.remove(&self.client);
            }
        }
        drop(state);
        self.limiter.released.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().expect("an address")
    }

    #[test]
    fn places_are_counted_in_all_and_for_each_address() {
        let limiter = ConnectionLimiter::new(3, 2);
        let first = limiter.try_acquire(ip("10.0.0.1")).expect("room");
        let _second = limiter.try_acquire(ip("::ffff:10.0.0.1")).expect("room for the same address");
        assert_eq!(limiter.try_acquire(ip("10.0.0.1")).err(), Some(LimitReached::Address), "three of one");
        let _third = limiter.try_acquire(ip("10.0.0.2")).expect("another address");
        assert_eq!(limiter.try_acquire(ip("10.0.0.3")).err(), Some(LimitReached::All), "four in all");
        drop(first);
        assert!(limiter.try_acquire(ip("10.0.0.1")).is_ok(), "room again");
    }

    #[test]
    fn a_network_of_64_bits_is_one_address_and_the_table_empties() {
        let limiter = ConnectionLimiter::new(9, 1);
        let seat = limiter.try_acquire(ip("2001:db8::1")).expect("room");
        assert_eq!(
            limiter.try_acquire(ip("2001:db8::ffff:1")).err(),
            Some(LimitReached::Address),
            "the same network"
        );
        assert!(limiter.try_acquire(ip("2001:db8:0:1::1")).is_ok(), "another network");
        drop(seat);
        assert!(limiter.lock().each.is_empty(), "no entry is released");
    }
}
