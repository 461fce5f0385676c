//! Trusted proxies and their forwarding headers, which are ignored in requests from other addresses.

use super::client_key::ClientKey;
use axum::http::header::FORWARDED;
use axum::http::{HeaderMap, HeaderName};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};

/// The header with the addresses that a request has passed: each proxy appends the address from which it
/// received the request.
const X_FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// The header with the scheme of the client's request.
const X_FORWARDED_PROTO: HeaderName = HeaderName::from_static("x-forwarded-proto");

/// The addresses of the proxies whose headers are trusted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Proxies(Vec<IpAddr>);

/// The scheme of a client's request to the server or its proxy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scheme {
    Http,
    Https,
    /// The scheme is unknown: a trusted proxy does not state it.
    Either,
}

/// The client of a request: its address and scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Client {
    pub(super) address: IpAddr,
    pub(super) scheme: Scheme,
}

impl Default for Client {
    /// Returns this machine as the client of a request without a socket.
    fn default() -> Self {
        Self { address: Ipv4Addr::LOCALHOST.into(), scheme: Scheme::Http }
    }
}

impl Client {
    /// Returns the key under which the connections and failed log-ins of the client are counted.
    pub(super) fn key(&self) -> ClientKey {
        ClientKey::of(self.address)
    }
}

/// Contents of the forwarding headers of a request.
#[derive(Debug, Default)]
struct Forwarding {
    /// The addresses that the request has passed, the last proxy's entry last; `None` for an address that a proxy hides.
    addresses: Vec<Option<IpAddr>>,
    scheme: Option<Scheme>,
}

impl Proxies {
    pub(super) fn new(addresses: &[IpAddr]) -> Self {
        Self(addresses.iter().map(IpAddr::to_canonical).collect())
    }

    pub(super) fn contains(&self, address: IpAddr) -> bool {
        self.0.contains(&address)
    }

    /// Determines the client of a request that arrived from `peer`.
    ///
    /// # Errors
    /// The fault of the forwarding headers of a trusted proxy.
    pub(super) fn client(&self, peer: IpAddr, headers: &HeaderMap) -> Result<Client, &'static str> {
        if !self.contains(peer) {
            return Ok(Client { address: peer, scheme: Scheme::Http });
        }
        let found = match (headers.contains_key(FORWARDED), headers.contains_key(X_FORWARDED_FOR)) {
            // A proxy sets one of the two kinds of headers, so the client has sent the other one.
            (true, true) => {
                return Err("both Forwarded and X-Forwarded-For, expected the proxy to remove one");
            }
            (true, false) => forwarded(headers).ok_or("a Forwarded header that cannot be parsed")?,
            (false, _) => x_forwarded(headers).ok_or("an X-Forwarded-For header that cannot be parsed")?,
        };
        // Each entry was written by the proxy whose address follows: from the right, the first address that is not a proxy is the
        // client.
        let is_client = |entry: &&Option<IpAddr>| entry.is_none_or(|address| !self.contains(address));
        let client = found.addresses.iter().rev().find(is_client).copied().flatten();
        Ok(Client { address: client.unwrap_or(peer), scheme: found.scheme.unwrap_or(Scheme::Either) })
    }
}

/// Returns the comma-separated elements of all headers called `name`; `None` where one of the headers is not
/// text.
fn elements<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<Vec<&'a str>> {
    let texts: Option<Vec<_>> = headers.get_all(name).iter().map(|v| v.to_str().ok()).collect();
    Some(
        texts?
            .into_iter()
            .flat_map(|text| text.split(','))
            .map(str::trim)
            .filter(|e| !e.is_empty())
            .collect(),
    )
}

fn scheme(text: &str) -> Option<Scheme> {
    match text.to_ascii_lowercase().as_str() {
        "http" | "ws" => Some(Scheme::Http),
        "https" | "wss" => Some(Scheme::Https),
        _ => None,
    }
}

/// Parses an IP address with or without a port, IPv6 with or without brackets.
fn address(text: &str) -> Option<IpAddr> {
    let bare = text.trim_start_matches('[').trim_end_matches(']');
    let address = bare.parse().ok().or_else(|| text.parse::<SocketAddr>().ok().map(|a| a.ip()));
    address.map(|ip: IpAddr| ip.to_canonical())
}

fn x_forwarded(headers: &HeaderMap) -> Option<Forwarding> {
    let scheme = elements(headers, &X_FORWARDED_PROTO)?.last().and_then(|text| scheme(text));
    let addresses = elements(headers, &X_FORWARDED_FOR)?.into_iter().map(|text| address(text).map(Some));
    Some(Forwarding { addresses: addresses.collect::<Option<_>>()?, scheme })
}

/// Parses Forwarded headers (RFC 7239): `for=192.0.2.1;proto=https, for="[2001:db8::1]:80"`. Names such as `unknown` are no address.
fn forwarded(headers: &HeaderMap) -> Option<Forwarding> {
    let mut found = Forwarding::default();
    for element in elements(headers, &FORWARDED)? {
        let mut from = None;
        for pair in element.split(';') {
            let (name, value) = pair.trim().split_once('=')?;
            let value = value.trim_matches('"');
            match name.to_ascii_lowercase().as_str() {
                "for" => from = address(value),
                "proto" => found.scheme = scheme(value),
                _ => {}
            }
        }
        found.addresses.push(from);
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn client(
        peer: &str,
        headers: &[(&'static str, &'static str)],
    ) -> Result<(String, Scheme), &'static str> {
        let ip = |text: &str| text.parse().expect("an address");
        let proxies = Proxies::new(&[ip("127.0.0.1"), ip("10.0.0.9")]);
        let headers = headers.iter().map(|(n, v)| (HeaderName::from_static(n), HeaderValue::from_static(v)));
        let found = proxies.client(ip(peer), &headers.collect());
        found.map(|client| (client.address.to_string(), client.scheme))
    }

    #[test]
    fn headers_of_trusted_proxies_alone_are_used() {
        let spoofed = [("x-forwarded-for", "192.0.2.1"), ("x-forwarded-proto", "https")];
        assert_eq!(client("192.0.2.7", &spoofed), Ok(("192.0.2.7".into(), Scheme::Http)), "not trusted");
        assert_eq!(client("127.0.0.1", &spoofed), Ok(("192.0.2.1".into(), Scheme::Https)), "trusted");
    }

    #[test]
    fn the_last_address_that_is_not_a_proxy_is_the_client() {
        let chain = [("x-forwarded-for", "203.0.113.5, 192.0.2.1, 10.0.0.9")];
        assert_eq!(
            client("127.0.0.1", &chain),
            Ok(("192.0.2.1".into(), Scheme::Either)),
            "the first is invented"
        );
        let forwarded =
            [("forwarded", "for=203.0.113.5, For=\"[2001:db8::1]:4711\";proto=https;by=10.0.0.9")];
        assert_eq!(client("127.0.0.1", &forwarded), Ok(("2001:db8::1".into(), Scheme::Https)), "RFC 7239");
        assert_eq!(client("127.0.0.1", &[]), Ok(("127.0.0.1".into(), Scheme::Either)), "says nothing");
    }

    #[test]
    fn contradictory_and_unreadable_headers_are_refused() {
        for headers in [
            &[("forwarded", "for=192.0.2.1"), ("x-forwarded-for", "192.0.2.2")][..],
            &[("x-forwarded-for", "somewhere")],
            &[("forwarded", "192.0.2.1")],
        ] {
            assert!(client("127.0.0.1", headers).is_err(), "{headers:?}");
        }
    }
}
