//! Announces the probe on the network by mDNS, as a service of type `_hemilux._tcp`.

use mdns_sd::{ServiceDaemon, ServiceInfo};
use std::net::SocketAddr;
use std::time::Duration;

/// The kind of service.
pub const SERVICE: &str = "_hemilux._tcp.local.";

/// Longest wait for the farewell to go out.
const FAREWELL: Duration = Duration::from_millis(500);

/// An announcement; dropping it takes it back.
pub struct Announced {
    daemon: ServiceDaemon,
    name: String,
}

/// Announces the probe that listens at `address`. Where that cannot be, the log says why and the probe goes on.
#[must_use]
pub fn announce(address: SocketAddr) -> Option<Announced> {
    try_announce(address)
        .inspect_err(|e| {
            tracing::warn!("--announce: found {e}, expected a network with multicast; nothing is announced");
        })
        .ok()
}

fn try_announce(address: SocketAddr) -> Result<Announced, mdns_sd::Error> {
    let machine = hostname();
    let daemon = ServiceDaemon::new()?;
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

/// The machine's name, without its domain; `hemilux` where it has none.
fn hostname() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name: String = name
        .trim()
        .split('.')
        .next()
        .unwrap_or_default()
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '-')
        .collect();
    if name.is_empty() { "hemilux".into() } else { name.chars().take(63).collect() }
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
    use mdns_sd::ServiceEvent;
    use std::time::Instant;

    /// Machines without multicast cannot try this; they say so.
    #[test]
    fn what_is_announced_is_found() {
        let machine = hostname();
        let Some(announced) = announce(SocketAddr::from(([0, 0, 0, 0], 8123))) else {
            println!("skipped: no multicast here");
            return;
        };
        let browser = ServiceDaemon::new().expect("a second daemon");
        let events = browser.browse(SERVICE).expect("a browser");
        let until = Instant::now() + Duration::from_secs(10);
        let found =
            std::iter::from_fn(|| events.recv_timeout(until.saturating_duration_since(Instant::now())).ok())
                .find_map(|event| match event {
                    ServiceEvent::ServiceResolved(info) if info.get_fullname().starts_with(&machine) => {
                        Some(info.get_port())
                    }
                    _ => None,
                });
        let _ = browser.shutdown();
        drop(announced);
        match found {
            Some(port) => assert_eq!(port, 8123, "its port"),
            None => println!("skipped: multicast does not come back here"),
        }
    }
}
