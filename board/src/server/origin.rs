//! The cause of a request: a program, a page of this server, or a page of another site.
//!
//! A page of another site can make a browser send requests to this server: by an image, a form, a link or a script. It cannot read the answers,
//! but a request could change settings. Browsers state the page that causes a request in Sec-Fetch-Site (only over HTTPS and to localhost),
//! Origin (not with images and links) and Referer (which the page may suppress). A browser's request without any of these headers is
//! distinguished from a program's by headers that a page cannot remove: see [`is_browser`].

use super::hosts::host;
use super::proxy::{Client, Scheme};
use axum::extract::FromRequestParts;
use axum::http::header::{ACCEPT, ACCEPT_LANGUAGE, ORIGIN, REFERER, UPGRADE_INSECURE_REQUESTS, USER_AGENT};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Uri};
use std::convert::Infallible;

/// The program or page that caused a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cause {
    /// The request is of a program that is not a browser.
    Program,
    /// A page of this server, or of an allowed origin.
    OwnPage,
    /// The request is of a page of another site.
    ForeignPage,
    /// A browser's request that does not state a page: a typed address, or a page that suppresses its referrer.
    Unproven,
}

/// The sender of a request: headers, host and client of the request.
#[derive(Clone, Debug)]
pub(super) struct Sender {
    pub(super) uri: Uri,
    pub(super) headers: HeaderMap,
    pub(super) client: Client,
}

impl Sender {
    pub(super) fn of(parts: &Parts) -> Self {
        let client = parts.extensions.get::<Client>().copied().unwrap_or_default();
        Self { uri: parts.uri.clone(), headers: parts.headers.clone(), client }
    }

    /// Returns the cause of the request; pages of the origins in `allowed` count as pages of this server.
    pub(super) fn cause(&self, allowed: &[String]) -> Cause {
        if self.headers.get(ORIGIN).is_some_and(|origin| is_allowed(origin, allowed)) {
            return Cause::OwnPage;
        }
        let site = self.text(&HeaderName::from_static("sec-fetch-site"));
        // Sec-Fetch-Site: same-origin is sufficient proof: the scheme of the page may then differ from the one that a
        // proxy states.
        let scheme = if site == Some("same-origin") { Scheme::Either } else { self.client.scheme };
        let told = self.text(&ORIGIN).or_else(|| self.text(&REFERER)).map(|url| self.is_own(url, scheme));
        match (site, told) {
            (Some("same-origin"), None) | (None | Some("same-origin" | "none"), Some(true)) => Cause::OwnPage,
            (None | Some("none"), None) if !is_browser(&self.headers) => Cause::Program,
            (None | Some("none"), None) => Cause::Unproven,
            _ => Cause::ForeignPage,
        }
    }

    /// Returns true if a browser displays the answer to the request as a page.
    pub(super) fn is_navigation(&self) -> bool {
        let mode = self.text(&HeaderName::from_static("sec-fetch-mode"));
        let accepts_pages = self.text(&ACCEPT).is_some_and(|accept| accept.contains("text/html"));
        is_browser(&self.headers) && mode.map_or(accepts_pages, |mode| mode == "navigate")
    }

    /// Returns the text of the header `name`; `null` for a header that is not text, `None` without the header.
    pub(super) fn text(&self, name: &HeaderName) -> Option<&str> {
        self.headers.get(name).map(|value| value.to_str().unwrap_or("null"))
    }

    /// Returns true if `url` is on the host of this request.
    fn is_own(&self, url: &str, scheme: Scheme) -> bool {
        let host = host(&self.uri, &self.headers).unwrap_or_default();
        let on = |prefix: &str, port: &str| {
            let authority =
                url.strip_prefix(prefix).and_then(|rest| rest.split('/').next()).unwrap_or_default();
            let bare =
                |authority: &str| authority.strip_suffix(port).unwrap_or(authority).to_ascii_lowercase();
            !authority.is_empty() && bare(authority) == bare(host)
        };
        (scheme != Scheme::Https && on("http://", ":80"))
            || (scheme != Scheme::Http && on("https://", ":443"))
    }
}

impl<S: Sync> FromRequestParts<S> for Sender {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        Ok(Self::of(parts))
    }
}

pub(super) fn is_allowed(origin: &HeaderValue, allowed: &[String]) -> bool {
    allowed.iter().any(|a| a.as_bytes() == origin.as_bytes())
}

/// Returns true if a request has a header that browsers send by themselves: a User-Agent with `Mozilla/`, Accept-Language,
/// Upgrade-Insecure-Requests, or one that begins with `Sec-` (except those of WebSockets).
///
/// A program that sends one of these headers counts as a browser; with `Authorization: Bearer` or its own Origin it may still change settings.
pub(super) fn is_browser(headers: &HeaderMap) -> bool {
    let has_prefix = |name: &str| name.starts_with("sec-") && !name.starts_with("sec-websocket-");
    headers.get(USER_AGENT).is_some_and(|agent| agent.as_bytes().windows(8).any(|w| w == b"Mozilla/"))
        || headers.contains_key(ACCEPT_LANGUAGE)
        || headers.contains_key(UPGRADE_INSECURE_REQUESTS)
        || headers.keys().any(|name| has_prefix(name.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cause(scheme: Scheme, headers: &[(&'static str, &'static str)]) -> Cause {
        let host = [("host", "localhost:8080")];
        let pairs = host.iter().chain(headers);
        let headers = pairs.map(|(n, v)| (HeaderName::from_static(n), HeaderValue::from_static(v))).collect();
        let client = Client { scheme, ..Client::default() };
        let sender = Sender { uri: Uri::from_static("/change?samples=2"), headers, client };
        sender.cause(&["http://studio.example".into()])
    }

    /// Asserts that a request with any one of `headers` has the cause `expected`.
    fn assert_each(expected: Cause, headers: &[(&'static str, &'static str)]) {
        for header in headers {
            assert_eq!(cause(Scheme::Http, &[*header]), expected, "{header:?}");
        }
    }

    #[test]
    fn pages_of_this_server_and_of_allowed_origins_are_its_own() {
        let own = [
            ("origin", "http://localhost:8080"),
            ("referer", "http://localhost:8080/change"),
            ("sec-fetch-site", "same-origin"),
            ("origin", "http://studio.example"),
        ];
        assert_each(Cause::OwnPage, &own);
    }

    #[test]
    fn pages_of_other_sites_are_foreign() {
        let foreign = [
            ("origin", "null"),
            ("origin", "http://localhost:8081"),
            ("origin", "https://localhost:8080"),
            ("origin", "https://evil.example"),
            ("referer", "http://localhost:8080.evil.example/"),
            ("referer", "http:///"),
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
        ];
        assert_each(Cause::ForeignPage, &foreign);
    }

    #[test]
    fn a_browser_without_a_page_is_distinguished_from_a_program() {
        let browsers = [
            ("user-agent", "Mozilla/5.0 (X11; Linux x86_64)"),
            ("accept-language", "en"),
            ("upgrade-insecure-requests", "1"),
            ("sec-fetch-site", "none"),
            ("sec-ch-ua", "x"),
        ];
        assert_each(Cause::Unproven, &browsers);
        let programs = [("user-agent", "curl/8.14.1"), ("user-agent", "Java/1.8.0"), ("accept", "*/*")];
        assert_each(Cause::Program, &programs);
    }

    #[test]
    fn behind_a_proxy_the_scheme_is_that_of_the_client() {
        let origin = [("origin", "https://localhost:8080")];
        assert_eq!(cause(Scheme::Https, &origin), Cause::OwnPage, "https");
        assert_eq!(cause(Scheme::Either, &origin), Cause::OwnPage, "a proxy that does not say");
        assert_eq!(cause(Scheme::Https, &[("origin", "http://localhost:8080")]), Cause::ForeignPage, "http");
        let fetched = [origin[0], ("sec-fetch-site", "same-origin")];
        assert_eq!(cause(Scheme::Http, &fetched), Cause::OwnPage, "the browser says so");
    }
}
