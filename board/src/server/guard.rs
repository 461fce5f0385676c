//! What is refused before any handler runs.
//!
//! A page of another site can make a browser send requests here: under a name of its own that it lets point to this machine (DNS
//! rebinding, told by the Host header), or blindly (told by Origin, Referer and Sec-Fetch-Site). The first would let it read
//! answers, so it is checked on every request; the second could change settings, so it is checked on changes.

use super::{Context, line};
use axum::body::HttpBody;
use axum::extract::{Request, State};
use axum::http::header::{
    CONTENT_SECURITY_POLICY, HOST, ORIGIN, REFERER, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, Version};
use axum::middleware::Next;
use axum::response::Response;
use std::net::{IpAddr, SocketAddr};

/// No request needs a body; one up to this size is left unread, a larger one refused.
const MAX_BODY_BYTES: u64 = 1024;

/// Pages load nothing from elsewhere, talk to this server alone and stay out of frames.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; \
     form-action 'self'; frame-ancestors 'none'; base-uri 'none'",
);

/// Which Host headers are answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// Names and addresses of this machine's loopback interface.
    Loopback,
    /// All: the server is open to its network, where it has names that it does not know.
    Open,
}

impl Guard {
    /// The guard of a server that listens on `address`.
    #[must_use]
    pub fn of(address: SocketAddr) -> Self {
        if address.ip().to_canonical().is_loopback() { Self::Loopback } else { Self::Open }
    }

    fn admits(self, host: &str) -> bool {
        self == Self::Open || is_loopback_name(host)
    }
}

fn is_loopback_name(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let name = authority.host().trim_start_matches('[').trim_end_matches(']');
    let is_address = || name.parse::<IpAddr>().is_ok_and(|ip| ip.to_canonical().is_loopback());
    !host.contains('@') && (name.eq_ignore_ascii_case("localhost") || is_address())
}

/// Lets through what may be answered.
pub(super) async fn check(State(context): State<Context>, request: Request, next: Next) -> Response {
    let mut response = match refusal(context.guard, &request) {
        Some((status, text)) => {
            tracing::debug!(%status, "{text}");
            line(status, text)
        }
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("same-origin"));
    headers.insert(CONTENT_SECURITY_POLICY, POLICY);
    response
}

fn refusal(guard: Guard, request: &Request) -> Option<(StatusCode, &'static str)> {
    if request.body().size_hint().lower() > MAX_BODY_BYTES {
        return Some((StatusCode::PAYLOAD_TOO_LARGE, "no request needs a body"));
    }
    let Some(host) = host(request.uri(), request.headers()) else {
        // Browsers always send it, old clients need not.
        let old = request.version() < Version::HTTP_11;
        return (!old).then_some((StatusCode::BAD_REQUEST, "a request without one Host header"));
    };
    (!guard.admits(host)).then_some((
        StatusCode::MISDIRECTED_REQUEST,
        "a Host that is not this machine; expected localhost or a loopback address",
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

/// Whether a page of another site made the browser send this request.
pub(super) fn is_foreign(uri: &Uri, headers: &HeaderMap) -> bool {
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

    #[test]
    fn loopback_names_are_told_from_others() {
        for host in
            ["localhost", "LOCALHOST:8080", "127.0.0.1:1", "127.9.8.7", "[::1]:8080", "[::ffff:127.0.0.1]"]
        {
            assert!(is_loopback_name(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1.nip.io:8080",
            "10.0.0.1",
            "a@localhost",
            "[::2]",
        ] {
            assert!(!is_loopback_name(host), "{host}");
        }
    }

    #[test]
    fn requests_of_other_sites_are_told_from_ours() {
        let uri = Uri::from_static("/change?samples=2");
        let foreign = |name: &'static str, value: &'static str| {
            let host = ("host", "localhost:8080");
            let headers = [host, (name, value)]
                .map(|(n, v)| (axum::http::HeaderName::from_static(n), HeaderValue::from_static(v)));
            is_foreign(&uri, &headers.into_iter().collect())
        };
        for (name, value) in [
            ("origin", "http://localhost:8080"),
            ("referer", "http://localhost:8080/change"),
            ("sec-fetch-site", "same-origin"),
            ("sec-fetch-site", "none"),
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
