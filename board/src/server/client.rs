//! The JavaScript modules for clients and the OpenAPI document.

use super::files::{File, packed_text};
use super::packed;
use crate::probe::settings;
use axum::http::HeaderMap;
use axum::response::Response;
use std::sync::LazyLock;

const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

static CLIENT: File = File::packed(JAVASCRIPT, packed_text!("client.js"));
static THREE: File = File::packed(JAVASCRIPT, packed_text!("three.js"));
static DESCRIPTION: LazyLock<File> = LazyLock::new(|| File::new("application/json", &OPENAPI));

/// Answers with the JavaScript client for web pages.
pub(super) async fn javascript(headers: HeaderMap) -> Response {
    CLIENT.answer(&headers)
}

/// Answers with the adapter of the JavaScript client for three.js.
pub(super) async fn three(headers: HeaderMap) -> Response {
    THREE.answer(&headers)
}

/// Answers with the OpenAPI 3.1 document of all requests.
pub(super) async fn openapi(headers: HeaderMap) -> Response {
    DESCRIPTION.answer(&headers)
}

/// The text of `openapi.json`, in which the settings of the probe replace two markers.
pub(super) static OPENAPI: LazyLock<String> = LazyLock::new(|| {
    packed::text(packed_text!("openapi.json"))
        .replace("[\"SETTINGS\"]", &settings::parameters().to_string())
        .replace("{\"SETTINGS\": {}}", &settings::properties().to_string())
});
