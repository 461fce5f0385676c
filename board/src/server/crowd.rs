//! How many connections there are, in all and from each address.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Counts connections.
#[derive(Debug)]
pub(super) struct Crowd {
    most: usize,
    most_each: usize,
    state: Mutex<State>,
    /// Told when somebody leaves.
    left: tokio::sync::Notify,
}

#[derive(Debug, Default)]
struct State {
    all: usize,
    each: HashMap<IpAddr, usize>,
}

/// Why there is no seat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Full {
    /// As many connections as there may be.
    All,
    /// As many from this address as there may be.
    Address,
}

/// A place in the crowd; dropping it frees the place.
#[derive(Debug)]
pub(super) struct Seat {
    crowd: Arc<Crowd>,
    who: IpAddr,
}

/// Who counts as one: an IPv6 network of 64 bits is one customer's.
fn who(ip: IpAddr) -> IpAddr {
    match ip.to_canonical() {
        IpAddr::V6(ip) if !ip.is_loopback() => Ipv6Addr::from(u128::from(ip) & (u128::MAX << 64)).into(),
        ip => ip,
    }
}

impl Crowd {
    pub(super) fn new(most: usize, most_each: usize) -> Arc<Self> {
        Arc::new(Self { most, most_each, state: Mutex::default(), left: tokio::sync::Notify::new() })
    }

    /// A place for a connection from `ip`.
    pub(super) fn seat(self: &Arc<Self>, ip: IpAddr) -> Result<Seat, Full> {
        let who = who(ip);
        let mut state = self.lock();
        if state.all >= self.most {
            return Err(Full::All);
        }
        let here = state.each.get(&who).copied().unwrap_or(0);
        if here >= self.most_each {
            return Err(Full::Address);
        }
        state.all += 1;
        state.each.insert(who, here + 1);
        drop(state);
        Ok(Seat { crowd: Arc::clone(self), who })
    }

    /// Waits until nobody is there.
    pub(super) async fn gone(&self) {
        loop {
            let left = self.left.notified();
            if self.lock().all == 0 {
                return;
            }
            left.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut state = self.crowd.lock();
        state.all -= 1;
        // Nobody's entry stays when the last of an address leaves: the table is never longer than the crowd.
        if let Some(here) = state.each.get_mut(&self.who) {
            *here -= 1;
            if *here == 0 {
                state.each.remove(&self.who);
            }
        }
        drop(state);
        self.crowd.left.notify_waiters();
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
        let crowd = Crowd::new(3, 2);
        let first = crowd.seat(ip("10.0.0.1")).expect("room");
        let _second = crowd.seat(ip("::ffff:10.0.0.1")).expect("room for the same address");
        assert_eq!(crowd.seat(ip("10.0.0.1")).err(), Some(Full::Address), "three of one");
        let _third = crowd.seat(ip("10.0.0.2")).expect("another address");
        assert_eq!(crowd.seat(ip("10.0.0.3")).err(), Some(Full::All), "four in all");
        drop(first);
        assert!(crowd.seat(ip("10.0.0.1")).is_ok(), "room again");
    }

    #[test]
    fn a_network_of_64_bits_is_one_address_and_the_table_empties() {
        let crowd = Crowd::new(9, 1);
        let seat = crowd.seat(ip("2001:db8::1")).expect("room");
        assert_eq!(crowd.seat(ip("2001:db8::ffff:1")).err(), Some(Full::Address), "the same network");
        assert!(crowd.seat(ip("2001:db8:0:1::1")).is_ok(), "another network");
        drop(seat);
        assert!(crowd.lock().each.is_empty(), "nobody");
    }
}
