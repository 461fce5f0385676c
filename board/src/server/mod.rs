//! The HTTP server: the requests of the thesis's appendix A.1 and JSON.
//!
//! [`app`] makes the routes from a [`Link`], testable without sockets; [`start`] serves them. A client that asks for data waits
//! for the next finished frame; a slow or dead one costs nothing but its own socket.

mod change;
mod connection;
mod data;
mod guard;
mod pages;
mod patience;

pub use connection::{Limits, Running, Signals, start};
pub use guard::Guard;

use crate::probe::Link;
use axum::Router;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use data::{Cache, Format};
use std::sync::Arc;

/// What every handler sees.
#[derive(Clone)]
struct Context {
    link: Arc<Link>,
    cache: Arc<Cache>,
    guard: Guard,
}

/// All routes, with the checks of `guard` before them.
pub fn app(link: Arc<Link>, guard: Guard) -> Router {
    let context = Context { link, cache: Arc::default(), guard };
    let light_set = |format| get(move |context| data::next_frame(context, format));
    Router::new()
        .route("/", get(pages::index))
        .route("/info", get(pages::info))
        .route("/change", get(change::change).head(not_allowed))
        .route("/data", light_set(Format::Text))
        .route("/xml", light_set(Format::Xml))
        .route("/lights.json", light_set(Format::Json))
        .route("/healthz", get(data::health))
        .fallback(not_found)
        .method_not_allowed_fallback(not_allowed)
        .layer(axum::middleware::from_fn_with_state(context.clone(), guard::check))
        .with_state(context)
}

/// An answer of one line of plain text.
fn line(status: StatusCode, text: &str) -> Response {
    (status, format!("{text}\n")).into_response()
}

async fn not_found() -> Response {
    line(StatusCode::NOT_FOUND, "no such request; there are: / info change data xml lights.json healthz")
}

async fn not_allowed() -> Response {
    line(StatusCode::METHOD_NOT_ALLOWED, "this request is made with GET")
}

#[cfg(test)]
mod tests;
