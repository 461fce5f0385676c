//! Announces the probe on the network by mDNS, as a service of type `_hemilux._tcp`, and lists other announced probes.

use crate::machine;
use mdns_sd::{IfKind, ResolvedService, ServiceDaemon, ServiceEvent, ServiceInfo};
use serde::Serialize;
use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

/// mDNS type of the service that the probe announces.
pub const SERVICE: &str = "_hemilux._tcp.local.";

/// Longest time for which the drop of [`Announced`] waits until the withdrawal of the announcement is sent.
const FAREWELL: Duration = Duration::from_millis(500);

/// An mDNS announcement of the probe, withdrawn on drop.
pub struct Announced {
    daemon: ServiceDaemon,
    name: String,
}

/// Announces the probe that listens at `address`. A failure is logged; the probe runs without an announcement then.
#[must_use]
pub fn announce(address: SocketAddr) -> Option<Announced> {
    try_announce(address)
        .inspect_err(|e| {
            tracing::warn!("--announce: found {e}, expected a network with multicast; nothing is announced");
        })
        .ok()
}

fn try_announce(address: SocketAddr) -> Result<Announced, mdns_sd::Error> {
    let machine = machine::name();
    let daemon = ServiceDaemon::new()?;
    if address.is_ipv4() {
        // A server at 0.0.0.0 does not answer at the IPv6 addresses of the machine.
        daemon.disable_interface(IfKind::IPv6)?;
    }
    let every = address.ip().is_unspecified();
    let ip = if every { String::new() } else { address.ip().to_string() };
    let host = format!("{machine}.local.");
    let text = [("path", "/lights.json"), ("version", env!("CARGO_PKG_VERSION"))];
    let info = ServiceInfo::new(SERVICE, &machine, &host, ip.as_str(), address.port(), &text[..])?;
    let info = if every { info.enable_addr_auto() } else { info };
    let name = info.get_fullname().to_owned();
    daemon.register(info)?;
    tracing::info!("announced as {name}");
    Ok(Announced { daemon, name })
}

/// Largest number of probes that [`browse`] lists.
const MOST: usize = 256;

/// A probe that [`browse`] found on the network.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Found {
    /// Name under which the probe is announced.
    pub name: String,
    /// Addresses at which the probe answers, `http://HOST:PORT/`.
    pub urls: Vec<String>,
    /// Version of the program `hemilux` that the probe runs.
    pub version: String,
}

/// Lists the probes that answer within `time`, in the order of their names.
///
/// # Errors
/// The error of the mDNS library where the machine has no network with multicast.
pub fn browse(time: Duration) -> Result<Vec<Found>, mdns_sd::Error> {
    let daemon = ServiceDaemon::new()?;
    let events = daemon.browse(SERVICE)?;
    let until = Instant::now() + time;
    let mut found = BTreeMap::new();
    while let Ok(event) = events.recv_timeout(until.saturating_duration_since(Instant::now())) {
        if let ServiceEvent::ServiceResolved(service) = event
            && found.len() < MOST
        {
            let probe = found_of(&service);
            found.insert(probe.name.clone(), probe);
        }
    }
    let _ = daemon.shutdown();
    Ok(found.into_values().collect())
}

/// Converts an mDNS announcement to a list entry. Control characters in its texts become spaces.
fn found_of(service: &ResolvedService) -> Found {
    let plain = |text: &str| text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>();
    let usable = service.get_addresses().iter().map(|address| address.to_ip_addr());
    let is_link_local = |ip: &IpAddr| matches!(ip, IpAddr::V6(ip) if ip.is_unicast_link_local());
    let mut addresses: Vec<_> =
        usable.filter(|ip| !is_link_local(ip)).map(|ip| SocketAddr::new(ip, service.get_port())).collect();
    addresses.sort_by_key(|address| (address.ip().is_loopback(), *address));
    let version = service.get_property_val_str("version").unwrap_or("of unknown version");
    Found {
        name: plain(service.get_fullname().trim_end_matches(SERVICE).trim_end_matches('.')),
        urls: addresses.iter().map(|address| format!("http://{address}/")).collect(),
        version: plain(version),
    }
}

impl Drop for Announced {
    fn drop(&mut self) {
        if let Ok(done) = self.daemon.unregister(&self.name) {
            let _ = done.recv_timeout(FAREWELL);
        }
        let _ = self.daemon.shutdown();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test is skipped, with a line on stdout, on machines without multicast.
    #[test]
    fn browse_lists_an_announced_probe_with_its_address() {
        let machine = machine::name();
        let Some(announced) = announce(SocketAddr::from(([0, 0, 0, 0], 8123))) else {
            println!("skipped: no multicast here");
            return;
        };
        let found = browse(Duration::from_secs(3)).expect("a second daemon");
        drop(announced);
        let Some(probe) = found.iter().find(|probe| probe.name.starts_with(&machine)) else {
            println!("skipped: multicast does not come back here");
            return;
        };
        assert!(probe.urls.iter().any(|url| url.ends_with(":8123/")), "{probe:?}");
        assert!(!probe.urls.iter().any(|url| url.contains('[')), "IPv4 alone, as the server: {probe:?}");
        assert_eq!(probe.version, env!("CARGO_PKG_VERSION"));
    }
}
