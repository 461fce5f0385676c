//! The host names under which the server answers.
//!
//! A page of another site can let the host name of that site resolve to this machine (DNS rebinding); the browser would then let the page read
//! answers of this server. Every request must therefore have a known host.

use super::line;
use axum::extract::Request;
use axum::http::header::HOST;
use axum::http::uri::Authority;
use axum::http::{HeaderMap, StatusCode, Uri, Version};
use axum::response::Response;
use std::net::{IpAddr, SocketAddr};

/// The accepted Host headers: names and addresses of the loopback interface, and, where the server is reachable from other machines, all
/// addresses and the machine's names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KnownHosts {
    is_reachable: bool,
    names: Vec<String>,
}

impl KnownHosts {
    /// Returns the hosts of a server that listens on the loopback interface only.
    #[must_use]
    pub fn loopback() -> Self {
        Self::default()
    }

    /// Returns the hosts of a server that listens on `address`, on a machine with the further `names`.
    #[must_use]
    pub fn of(address: SocketAddr, names: &[String]) -> Self {
        let is_reachable = !is_loopback(address.ip());
        let mut names: Vec<_> = names.iter().map(|name| name.trim_end_matches('.').to_owned()).collect();
        if is_reachable {
            let own = rustix::system::uname().nodename().to_string_lossy().into_owned();
            names.push(format!("{own}.local"));
            names.push(own);
        }
        Self { is_reachable, names }
    }

    fn admits(&self, host: &str) -> bool {
        let Some(name) = name_of(host) else { return false };
        let address = name.parse::<IpAddr>();
        let known = |n: &String| n.eq_ignore_ascii_case(name.trim_end_matches('.'));
        name.eq_ignore_ascii_case("localhost")
            || address.is_ok_and(|ip| self.is_reachable || is_loopback(ip))
            || self.names.iter().any(known)
    }
}

/// Returns true if `ip` is a loopback address, which only this machine reaches.
#[must_use]
pub fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

/// Returns the name or address in a Host header, without port and brackets; `None` for an invalid header.
fn name_of(host: &str) -> Option<&str> {
    let authority = (!host.contains('@')).then(|| host.parse::<Authority>().ok())??;
    let name = &host[..authority.host().len()];
    Some(name.trim_start_matches('[').trim_end_matches(']'))
}

/// The refusal of a request because of its Host header: reason and answer.
pub(super) struct HostRefusal {
    /// The reason under which the refusal is counted, one of [`super::counts::REASONS`].
    pub(super) reason: &'static str,
    pub(super) response: Response,
}

/// Returns the refusal of a request whose Host header is missing, repeated or unknown; `None` for a request that
/// is admitted.
pub(super) fn refusal(hosts: &KnownHosts, request: &Request) -> Option<HostRefusal> {
    let Some(host) = host(request.uri(), request.headers()) else {
        // Browsers always send a Host header; clients of HTTP/1.0 may omit it.
        let is_old = request.version() < Version::HTTP_11;
        return (!is_old).then(|| HostRefusal {
            reason: "malformed",
            response: line(StatusCode::BAD_REQUEST, "a request without one Host header"),
        });
    };
    let text = "an unknown Host, expected localhost, its address or its name (--host adds one)";
    (!hosts.admits(host))
        .then(|| HostRefusal { reason: "host", response: line(StatusCode::MISDIRECTED_REQUEST, text) })
}

/// Returns the only host of a request; `None` where the host is missing or repeated.
pub(super) fn host<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Option<&'a str> {
    if let Some(authority) = uri.authority() {
        return Some(authority.as_str());
    }
    let mut all = headers.get_all(HOST).iter();
    let first = all.next()?.to_str().ok()?;
    all.next().is_none().then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOPBACK: [&str; 6] =
        ["localhost", "LOCALHOST:8080", "127.0.0.1:1", "127.9.8.7", "[::1]:8080", "[::ffff:127.0.0.1]"];
    const OTHERS: [&str; 7] = [
        "",
        "evil.example",
        "localhost.evil.example",
        "127.0.0.1.nip.io:8080",
        "a@localhost",
        "probe.lan.evil.example",
        "a@10.0.0.1",
    ];

    #[test]
    fn loopback_names_are_distinguished_from_others() {
        let hosts = KnownHosts::loopback();
        assert!(LOOPBACK.iter().all(|host| hosts.admits(host)), "this machine's");
        for host in OTHERS.iter().chain(&["10.0.0.1", "[::2]"]) {
            assert!(!hosts.admits(host), "{host}");
        }
    }

    #[test]
    fn a_reachable_server_accepts_addresses_and_its_own_names_alone() {
        let address = SocketAddr::from(([0, 0, 0, 0], 8080));
        let hosts = KnownHosts::of(address, &["probe.lan".into()]);
        let own = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let (local, port) = (format!("{own}.local:8080"), format!("{own}:1"));
        for host in LOOPBACK.iter().chain(&["10.0.0.1:8080", "[fe80::2]", "Probe.LAN.:8080", &local, &port]) {
            assert!(hosts.admits(host), "{host}");
        }
        assert!(!OTHERS.iter().any(|host| hosts.admits(host)), "other names");
    }
}
