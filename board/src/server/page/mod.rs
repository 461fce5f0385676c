//! The page: text files that are compiled into the program. `app.js` is the entry point of the scripts.

use super::files::{File, packed_text};
use super::line;
use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// Declares the files of the page by name, each with its content type.
macro_rules! files {
    ($($name:literal: $kind:expr),* $(,)?) => { [$(($name, File::packed($kind, packed_text!($name)))),*] };
}

static INDEX: File = File::packed(HTML, packed_text!("index.html"));

static FILES: [(&str, File); 26] = files! {
    "style.css": CSS,
    "icon.svg": SVG,
    "app.js": JAVASCRIPT,
    "burst.js": JAVASCRIPT,
    "calibration.js": JAVASCRIPT,
    "outline.js": JAVASCRIPT,
    "compare.js": JAVASCRIPT,
    "download.js": JAVASCRIPT,
    "fields.js": JAVASCRIPT,
    "figures.js": JAVASCRIPT,
    "gathering.js": JAVASCRIPT,
    "irradiance.js": JAVASCRIPT,
    "map.js": JAVASCRIPT,
    "numbers.js": JAVASCRIPT,
    "orbit.js": JAVASCRIPT,
    "projection.js": JAVASCRIPT,
    "quality.js": JAVASCRIPT,
    "scene.js": JAVASCRIPT,
    "settings.js": JAVASCRIPT,
    "shaders.js": JAVASCRIPT,
    "shapes.js": JAVASCRIPT,
    "sky.js": JAVASCRIPT,
    "snippets.js": JAVASCRIPT,
    "source.js": JAVASCRIPT,
    "table.js": JAVASCRIPT,
    "times.js": JAVASCRIPT,
};

/// Answers `/` with the HTML of the page.
pub(super) async fn index(headers: HeaderMap) -> Response {
    INDEX.answer(&headers)
}

/// Answers `/page/NAME` with the file NAME of the page.
pub(super) async fn part(Path(name): Path<String>, headers: HeaderMap) -> Response {
    match FILES.iter().find(|(known, _)| *known == name) {
        Some((_, file)) => file.answer(&headers),
        None => line(StatusCode::NOT_FOUND, "no such file of the page"),
    }
}
