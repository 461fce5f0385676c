//! What clients load: the JavaScript modules and the description of this interface.

use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};

/// The client for pages.
pub(super) async fn javascript() -> Response {
    file("text/javascript; charset=utf-8", include_str!("client.js"))
}

/// Its adapter for three.js.
pub(super) async fn three() -> Response {
    file("text/javascript; charset=utf-8", include_str!("three.js"))
}

/// The description of this interface, OpenAPI 3.1.
pub(super) async fn openapi() -> Response {
    file("application/json", include_str!("openapi.json"))
}

fn file(kind: &'static str, content: &'static str) -> Response {
    ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], content).into_response()
}
