//! Files that are compiled into the program: compressed once, and sent to a client again only when they have
//! changed.

use super::packed;
use axum::body::Bytes;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, ETAG, IF_NONE_MATCH, VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use std::hash::{DefaultHasher, Hasher};
use std::sync::OnceLock;

/// A text file that is compiled into the program.
pub(super) struct File {
    kind: &'static str,
    text: &'static str,
    packed: OnceLock<Packed>,
}

/// The compressed bytes and the entity tag of a file, computed at the file's first request.
struct Packed {
    gzip: Bytes,
    tag: HeaderValue,
}

impl File {
    /// Creates a file with the contents `text` and the content type `kind`.
    pub(super) const fn new(kind: &'static str, text: &'static str) -> Self {
        Self { kind, text, packed: OnceLock::new() }
    }

    /// Answers with the file, or with status 304 where `headers` contain the file's tag. Browsers ask for the file each time, since it
    /// changes with the program.
    pub(super) fn answer(&self, headers: &HeaderMap) -> Response {
        let Packed { gzip, tag } = self.packed.get_or_init(|| pack(self.text));
        let known = headers.get_all(IF_NONE_MATCH).iter().filter_map(|v| v.to_str().ok());
        let is_known = known.flat_map(|v| v.split(',')).any(|one| one.trim().as_bytes() == tag.as_bytes());
        let accepts = accepts_gzip(headers);
        let mut response = match (is_known, accepts) {
            (true, _) => StatusCode::NOT_MODIFIED.into_response(),
            (false, true) => gzip.clone().into_response(),
            (false, false) => self.text.into_response(),
        };
        let head = response.headers_mut();
        head.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        head.insert(ETAG, tag.clone());
        head.insert(VARY, HeaderValue::from_static("accept-encoding"));
        if !is_known {
            head.insert(CONTENT_TYPE, HeaderValue::from_static(self.kind));
            if accepts {
                head.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
            }
        }
        response
    }
}

fn pack(text: &str) -> Packed {
    let mut hasher = DefaultHasher::new();
    hasher.write(text.as_bytes());
    // The tag is weak: it is the same for the compressed and the uncompressed file.
    let tag = HeaderValue::from_str(&format!("W/\"{:016x}\"", hasher.finish()));
    let tag = tag.unwrap_or(HeaderValue::from_static("W/\"\""));
    Packed { gzip: packed::file(text.as_bytes()).into(), tag }
}

/// Returns true if the headers of a request accept gzip.
pub(super) fn accepts_gzip(headers: &HeaderMap) -> bool {
    let all = headers.get_all(ACCEPT_ENCODING).iter().filter_map(|v| v.to_str().ok());
    all.flat_map(|v| v.split(',')).any(|coding| {
        let mut parts = coding.split(';').map(str::trim);
        let is_gzip = parts.next().is_some_and(|name| name.eq_ignore_ascii_case("gzip"));
        let is_refused = parts.any(|p| p.strip_prefix("q=").is_some_and(|q| q.parse() == Ok(0.0)));
        is_gzip && !is_refused
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accepting(value: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(ACCEPT_ENCODING, HeaderValue::from_static(value))])
    }

    #[test]
    fn gzip_is_sent_only_where_it_is_accepted() {
        for (value, expected) in [
            ("gzip", true),
            ("br, GZIP;q=0.5", true),
            ("gzip;q=0", false),
            ("gzip;q=0.000, br", false),
            ("identity", false),
            ("x-gzip-like", false),
        ] {
            assert_eq!(accepts_gzip(&accepting(value)), expected, "{value}");
        }
        assert!(!accepts_gzip(&HeaderMap::new()), "no header");
    }

    #[test]
    fn a_matching_tag_is_answered_without_a_body() {
        let file = File::new("text/plain", "some text");
        let first = file.answer(&HeaderMap::new());
        let tag = first.headers()[ETAG].clone();
        let again = file.answer(&HeaderMap::from_iter([(IF_NONE_MATCH, tag)]));
        assert_eq!((first.status(), again.status()), (StatusCode::OK, StatusCode::NOT_MODIFIED));
        let other = HeaderValue::from_static("W/\"0\"");
        assert_eq!(file.answer(&HeaderMap::from_iter([(IF_NONE_MATCH, other)])).status(), StatusCode::OK);
    }
}
