//! The page: files that are part of the program, served as they are. `app.js` is where to begin to read.

use super::line;
use axum::extract::Path;
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JAVASCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";

/// A file of the page by name, with its content type.
macro_rules! files {
    ($($name:literal: $kind:expr),* $(,)?) => { &[$(($name, $kind, include_str!($name))),*] };
}

static FILES: &[(&str, &str, &str)] = files! {
    "style.css": CSS,
    "icon.svg": SVG,
    "app.js": JAVASCRIPT,
    "burst.js": JAVASCRIPT,
    "calibration.js": JAVASCRIPT,
    "outline.js": JAVASCRIPT,
    "compare.js": JAVASCRIPT,
    "fields.js": JAVASCRIPT,
    "figures.js": JAVASCRIPT,
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
    "table.js": JAVASCRIPT,
    "times.js": JAVASCRIPT,
};

/// The page itself.
pub(super) async fn index() -> Response {
    file(HTML, include_str!("index.html"))
}

/// `/page/NAME`: what it is made of.
pub(super) async fn part(Path(name): Path<String>) -> Response {
    match FILES.iter().find(|(known, ..)| *known == name) {
        Some((_, kind, content)) => file(kind, content),
        None => line(StatusCode::NOT_FOUND, "no such part of the page"),
    }
}

/// A file that browsers ask for anew each time: it changes with the program.
fn file(kind: &'static str, content: &'static str) -> Response {
    ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], content).into_response()
}
