//! The JavaScript modules for clients and the OpenAPI document.

use crate::probe::settings;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use std::sync::LazyLock;

/// Answers with the JavaScript client for web pages.
pub(super) async fn javascript() -> Response {
    file("text/javascript; charset=utf-8", include_str!("client.js"))
}

/// Answers with the adapter of the JavaScript client for three.js.
pub(super) async fn three() -> Response {
    file("text/javascript; charset=utf-8", include_str!("three.js"))
}

/// Answers with the OpenAPI 3.1 document of all requests.
pub(super) async fn openapi() -> Response {
    file("application/json", &OPENAPI)
}

/// The text of `openapi.json`, with the settings of the table in place of two markers.
pub(super) static OPENAPI: LazyLock<String> = LazyLock::new(|| {
    include_str!("openapi.json")
        .replace("[\"SETTINGS\"]", &settings::parameters().to_string())
        .replace("{\"SETTINGS\": {}}", &settings::properties().to_string())
});

fn file(kind: &'static str, content: &'static str) -> Response {
    ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], content).into_response()
}
