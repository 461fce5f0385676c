//! What clients load: the JavaScript modules and the description of this interface.

use crate::probe::settings;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use std::sync::LazyLock;

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
    file("application/json", &OPENAPI)
}

/// The document: `openapi.json`, where the settings of the table stand in the place of two markers.
pub(super) static OPENAPI: LazyLock<String> = LazyLock::new(|| {
    include_str!("openapi.json")
        .replace("[\"SETTINGS\"]", &settings::parameters().to_string())
        .replace("{\"SETTINGS\": {}}", &settings::properties().to_string())
});

fn file(kind: &'static str, content: &'static str) -> Response {
    ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], content).into_response()
}
