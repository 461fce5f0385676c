//! The key under which the server counts the connections and failed attempts of a client.

use std::net::{IpAddr, Ipv6Addr};

/// The key under which the connections of a client are counted: its IPv4 address, or its IPv6 /64 network, which usually belongs to one customer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct ClientKey(IpAddr);

impl ClientKey {
    /// Returns the key of the client with the address `ip`.
    pub(super) fn of(ip: IpAddr) -> Self {
        Self(match ip.to_canonical() {
            IpAddr::V6(ip) if !ip.is_loopback() => Ipv6Addr::from(u128::from(ip) & (u128::MAX << 64)).into(),
            ip => ip,
        })
    }
}
