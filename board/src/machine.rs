//! The host name of the machine, and the addresses by which other machines reach it.

use std::net::{IpAddr, SocketAddr};

/// Largest number of characters of the host name that [`name`] returns.
const MOST: usize = 63;

/// Returns the machine's host name without its domain, reduced to letters, digits and hyphens; `hemilux` if nothing is left.
#[must_use]
pub fn name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim().split('.').next().unwrap_or_default().chars();
    let name: String = name.filter(|c| c.is_ascii_alphanumeric() || *c == '-').take(MOST).collect();
    if name.is_empty() { "hemilux".into() } else { name }
}

/// Returns the addresses by which clients reach a server that listens at `bound`: the loopback address first, then the addresses of the machine's
/// networks.
#[must_use]
pub fn reachable(bound: SocketAddr) -> Vec<SocketAddr> {
    if !bound.ip().is_unspecified() {
        return vec![bound];
    }
    let found = if_addrs::get_if_addrs().unwrap_or_default();
    of_interfaces(bound, found.into_iter().map(|interface| interface.ip()))
}

/// Returns the addresses of [`reachable`] on a machine whose interfaces have the addresses `found`. Link-local addresses are left out, since they
/// need a zone.
fn of_interfaces(bound: SocketAddr, found: impl Iterator<Item = IpAddr>) -> Vec<SocketAddr> {
    let is_usable = |ip: &IpAddr| match ip {
        IpAddr::V4(ip) => !ip.is_loopback() && !ip.is_link_local(),
        IpAddr::V6(ip) => bound.is_ipv6() && !ip.is_loopback() && !ip.is_unicast_link_local(),
    };
    let local = [127, 0, 0, 1].into();
    std::iter::once(local).chain(found.filter(is_usable)).map(|ip| (ip, bound.port()).into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unspecified_address_becomes_the_addresses_of_the_interfaces() {
        let interfaces = ["127.0.0.1", "192.168.1.5", "169.254.3.4", "::1", "fe80::1", "fd00::5"];
        let typed = |bound: &str| {
            let found = interfaces.iter().map(|text| text.parse().expect("an address"));
            let reachable = of_interfaces(bound.parse().expect("an address"), found);
            reachable.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(typed("0.0.0.0:80"), ["127.0.0.1:80", "192.168.1.5:80"]);
        assert_eq!(typed("[::]:80"), ["127.0.0.1:80", "192.168.1.5:80", "[fd00::5]:80"]);
        let bound = "10.0.0.1:5".parse().expect("an address");
        assert_eq!(reachable(bound), [bound], "one address");
    }
}
