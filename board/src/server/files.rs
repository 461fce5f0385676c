//! Text files that are compiled into the program as gzip files, and sent to a client again only when they have changed.

use super::packed;
use axum::body::Bytes;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, ETAG, IF_NONE_MATCH, VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};

/// Returns the gzip file of the text with the given name, which `build.rs` writes.
macro_rules! packed_text {
    ($name:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".gz"))
    };
}
pub(super) use packed_text;

/// A text file of the program.
pub(super) struct File {
    kind: &'static str,
    gzip: Bytes,
}

impl File {
    /// Creates a file of the content type `kind` from its text.
    pub(super) fn new(kind: &'static str, text: &str) -> Self {
        Self { kind, gzip: packed::file(text.as_bytes()).into() }
    }

    /// Creates a file of the content type `kind` from its text as a gzip file.
    pub(super) const fn packed(kind: &'static str, gzip: &'static [u8]) -> Self {
        Self { kind, gzip: Bytes::from_static(gzip) }
    }

    /// Answers with the file, or with status 304 where `headers` contain the file's tag. Browsers ask for the file each time, since it
    /// changes with the program.
    pub(super) fn answer(&self, headers: &HeaderMap) -> Response {
        let tag = self.tag();
        let known = headers.get_all(IF_NONE_MATCH).iter().filter_map(|v| v.to_str().ok());
        let is_known = known.flat_map(|v| v.split(',')).any(|one| one.trim().as_bytes() == tag.as_bytes());
        let accepts = accepts_gzip(headers);
        let mut response = match (is_known, accepts) {
            (true, _) => StatusCode::NOT_MODIFIED.into_response(),
            (false, true) => self.gzip.clone().into_response(),
            (false, false) => packed::text(&self.gzip).into_response(),
        };
        let head = response.headers_mut();
        head.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        head.insert(ETAG, tag);
        head.insert(VARY, HeaderValue::from_static("accept-encoding"));
        if !is_known {
            head.insert(CONTENT_TYPE, HeaderValue::from_static(self.kind));
            if accepts {
                head.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
            }
        }
        response
    }

    /// Returns the entity tag: the last eight bytes of the gzip file, the check sum and the length of the text. The tag is weak, since it is
    /// the same for the compressed and the uncompressed file.
    fn tag(&self) -> HeaderValue {
        let end = self.gzip.last_chunk().map_or(0, |bytes| u64::from_be_bytes(*bytes));
        HeaderValue::from_str(&format!("W/\"{end:016x}\"")).unwrap_or(HeaderValue::from_static("W/\"\""))
    }
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
