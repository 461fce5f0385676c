//! What is refused before any handler runs.
//!
//! A page of another site can make a browser send requests here: under a name of its own that it lets point to this machine (DNS
//! rebinding, told by the Host header), or blindly (told by Origin, Referer and Sec-Fetch-Site). The first would let it read
//! answers, so it is checked on every request; the second could change settings, so it is checked on changes.

use super::{Context, line};
use axum::body::HttpBody;
use axum::extract::{Request, State};
use axum::http::header::{
    ACCESS_CONTROL_ALLOW_HEADERS, ACCESS_CONTROL_ALLOW_METHODS, ACCESS_CONTROL_ALLOW_ORIGIN,
    ACCESS_CONTROL_MAX_AGE, CONTENT_SECURITY_POLICY, HOST, ORIGIN, REFERER, REFERRER_POLICY, VARY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, Version};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::{IpAddr, SocketAddr};

/// Largest body of a request; handlers that need none leave it unread.
pub(super) const MAX_BODY_BYTES: u64 = 16 << 10;

/// Pages load nothing from elsewhere, talk to this server alone and stay out of frames.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self' blob:; \
     form-action 'self'; frame-ancestors 'none'; base-uri 'none'",
);

/// Which Host headers are answered: always names and addresses of this machine's loopback interface, and beyond it all addresses
/// and the names by which the machine is known. A rebound name, which is some name of the attacker's, is none of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Guard {
    is_reachable: bool,
    names: Vec<String>,
}

impl Guard {
    /// The guard of a server that listens on the loopback interface alone.
    #[must_use]
    pub fn loopback() -> Self {
        Self::default()
    }

    /// The guard of a server that listens on `address` of a machine which is known by `names` too.
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

/// Whether only this machine reaches `ip`.
#[must_use]
pub fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

/// The host's name or address, without port and brackets.
fn name_of(host: &str) -> Option<&str> {
    let authority = (!host.contains('@')).then(|| host.parse::<Authority>().ok())??;
    let name = &host[..authority.host().len()];
    Some(name.trim_start_matches('[').trim_end_matches(']'))
}

/// Lets through what may be answered.
pub(super) async fn check(State(context): State<Context>, request: Request, next: Next) -> Response {
    let origin = request.headers().get(ORIGIN).cloned().filter(|o| is_allowed(o, &context.origins));
    let mut response = match refusal(&context.guard, &request) {
        Some((status, text)) => {
            context.counts.refused(if status == StatusCode::MISDIRECTED_REQUEST {
                "host"
            } else {
                "malformed"
            });
            line(status, text)
        }
        None if origin.is_some() && request.method() == Method::OPTIONS => preflight(),
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("same-origin"));
    headers.insert(CONTENT_SECURITY_POLICY, POLICY);
    match origin {
        Some(origin) => {
            headers.insert(ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        }
        None => {
            headers.insert(
                HeaderName::from_static("cross-origin-resource-policy"),
                HeaderValue::from_static("same-origin"),
            );
        }
    }
    if !context.origins.is_empty() {
        headers.append(VARY, HeaderValue::from_static("Origin"));
    }
    response
}

/// What pages of allowed origins may send.
fn preflight() -> Response {
    let may = [
        (ACCESS_CONTROL_ALLOW_METHODS, "GET, PATCH"),
        (ACCESS_CONTROL_ALLOW_HEADERS, "authorization, content-type"),
        (ACCESS_CONTROL_MAX_AGE, "600"),
    ];
    (StatusCode::NO_CONTENT, may).into_response()
}

fn is_allowed(origin: &HeaderValue, allowed: &[String]) -> bool {
    allowed.iter().any(|a| a.as_bytes() == origin.as_bytes())
}

fn refusal(guard: &Guard, request: &Request) -> Option<(StatusCode, &'static str)> {
    if request.body().size_hint().lower() > MAX_BODY_BYTES {
        return Some((StatusCode::PAYLOAD_TOO_LARGE, "a body of more than 16,384 bytes"));
    }
    let Some(host) = host(request.uri(), request.headers()) else {
        // Browsers always send it, old clients need not.
        let old = request.version() < Version::HTTP_11;
        return (!old).then_some((StatusCode::BAD_REQUEST, "a request without one Host header"));
    };
    (!guard.admits(host)).then_some((
        StatusCode::MISDIRECTED_REQUEST,
        "a Host that is not known to be this machine; expected localhost, its address or its name (--host adds one)",
    ))
}

/// The one host that the request is for.
fn host<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Option<&'a str> {
    if let Some(authority) = uri.authority() {
        return Some(authority.as_str());
    }
    let mut all = headers.get_all(HOST).iter();
    let first = all.next()?.to_str().ok()?;
    all.next().is_none().then_some(first)
}

/// Whether a page of another site, none of the `allowed` ones, made the browser send this request.
pub(super) fn is_foreign(uri: &Uri, headers: &HeaderMap, allowed: &[String]) -> bool {
    if headers.get(ORIGIN).is_some_and(|origin| is_allowed(origin, allowed)) {
        return false;
    }
    let text = |name| headers.get(name).map(|v: &HeaderValue| v.to_str().unwrap_or("null"));
    let host = host(uri, headers).unwrap_or_default();
    let ours = |url: &str| {
        let rest = url.strip_prefix("http://").unwrap_or_default();
        let authority = rest.split('/').next().unwrap_or_default();
        !authority.is_empty() && authority.eq_ignore_ascii_case(host)
    };
    let elsewhere = |site: &str| !matches!(site, "same-origin" | "none");
    headers.get("sec-fetch-site").is_some_and(|v| v.to_str().map_or(true, elsewhere))
        || text(&ORIGIN).is_some_and(|origin| !ours(origin))
        || text(&REFERER).is_some_and(|referer| !ours(referer))
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
    fn loopback_names_are_told_from_others() {
        let guard = Guard::loopback();
        assert!(LOOPBACK.iter().all(|host| guard.admits(host)), "this machine's");
        for host in OTHERS.iter().chain(&["10.0.0.1", "[::2]"]) {
            assert!(!guard.admits(host), "{host}");
        }
    }

    #[test]
    fn beyond_loopback_addresses_and_own_names_are_answered_and_no_others() {
        let address = SocketAddr::from(([0, 0, 0, 0], 8080));
        let guard = Guard::of(address, &["probe.lan".into()]);
        let own = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let (local, port) = (format!("{own}.local:8080"), format!("{own}:1"));
        for host in LOOPBACK.iter().chain(&["10.0.0.1:8080", "[fe80::2]", "Probe.LAN.:8080", &local, &port]) {
            assert!(guard.admits(host), "{host}");
        }
        assert!(!OTHERS.iter().any(|host| guard.admits(host)), "other names");
    }

    #[test]
    fn requests_of_other_sites_are_told_from_ours() {
        let uri = Uri::from_static("/change?samples=2");
        let foreign = |name: &'static str, value: &'static str| {
            let host = ("host", "localhost:8080");
            let headers =
                [host, (name, value)].map(|(n, v)| (HeaderName::from_static(n), HeaderValue::from_static(v)));
            is_foreign(&uri, &headers.into_iter().collect(), &["http://studio.example".into()])
        };
        for (name, value) in [
            ("origin", "http://localhost:8080"),
            ("referer", "http://localhost:8080/change"),
            ("sec-fetch-site", "same-origin"),
            ("sec-fetch-site", "none"),
            ("origin", "http://studio.example"),
        ] {
            assert!(!foreign(name, value), "{name}: {value}");
        }
        for (name, value) in [
            ("origin", "null"),
            ("origin", "http://localhost:8081"),
            ("origin", "https://evil.example"),
            ("referer", "http://localhost:8080.evil.example/"),
            ("referer", "http:///"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ] {
            assert!(foreign(name, value), "{name}: {value}");
        }
    }
}
