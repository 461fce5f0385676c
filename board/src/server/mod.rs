//! The HTTP server: the requests of the thesis's appendix A.1, and `/v1`.
//!
//! [`app`] makes the routes from a [`Link`], testable without sockets; [`start`] serves them. A client that asks for data waits
//! for the next finished frame; a slow or dead one costs nothing but its own socket. `openapi.json` documents every request.

mod access;
mod change;
mod client;
mod compare;
mod config;
mod connection;
mod counts;
mod crowd;
mod develop;
mod events;
mod guard;
mod lights;
mod metrics;
mod page;
mod pages;
mod patience;
mod pictures;
mod query;
mod routes;
mod screenshot;
mod sphere;
mod token;
mod xr;

pub use access::Access;
pub use connection::{Limits, Running, Signals, start};
pub use guard::{Guard, is_loopback};
pub use token::{Token, TokenError};

use crate::config_file::ConfigFile;
use crate::probe::Link;
use axum::Router;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use counts::Counts;
use lights::Cache;
use pictures::Studio;
use screenshot::Album;
use std::sync::Arc;
use tokio::sync::watch;

/// Who is served what.
#[derive(Clone, Debug)]
pub struct Options {
    /// Which Host headers are answered.
    pub guard: Guard,
    /// Who may change settings and see pictures.
    pub access: Access,
    /// Origins (`http://host:port`) of other sites whose pages may use the server as its own do.
    pub origins: Vec<String>,
    /// Where settings are written back to when a client asks for it.
    pub file: Option<ConfigFile>,
}

impl Default for Options {
    /// For this machine alone, without a token.
    fn default() -> Self {
        Self { guard: Guard::loopback(), access: Access::Open, origins: Vec::new(), file: None }
    }
}

/// What every handler sees.
type Context = Arc<Shared>;

struct Shared {
    link: Arc<Link>,
    cache: Cache,
    studio: Studio,
    album: Album,
    bench: compare::Bench,
    counts: Arc<Counts>,
    guard: Guard,
    access: Access,
    origins: Vec<String>,
    file: Option<ConfigFile>,
    /// True when the server is told to stop: streams end.
    stop: Arc<watch::Sender<bool>>,
}

/// The routes and what [`start`] needs besides.
pub struct App {
    router: Router,
    counts: Arc<Counts>,
    stop: Arc<watch::Sender<bool>>,
}

impl App {
    /// The routes, for requests without sockets.
    pub fn router(&self) -> Router {
        self.router.clone()
    }
}

/// All routes, with the checks of `options` before them.
#[must_use]
pub fn app(link: Arc<Link>, options: Options) -> App {
    let stop = Arc::new(watch::Sender::new(false));
    let counts = Arc::new(Counts::default());
    let Options { guard, access, origins, file } = options;
    let shared = Shared {
        link,
        cache: Cache::default(),
        studio: Studio::default(),
        album: Album::default(),
        bench: compare::Bench::default(),
        counts: Arc::clone(&counts),
        guard,
        access,
        origins,
        file,
        stop: Arc::clone(&stop),
    };
    App { router: routes::router(Arc::new(shared)), counts, stop }
}

/// An answer of one line of plain text.
fn line(status: StatusCode, text: &str) -> Response {
    (status, format!("{text}\n")).into_response()
}

#[cfg(test)]
mod tests;
