//! The HTTP server: the requests of the thesis's appendix A.1, and `/v1`.
//!
//! [`app`] makes the routes from a [`Link`], testable without sockets; [`start`] serves them. A request for data waits
//! for the next finished frame; slow clients delay no other client. `openapi.json` documents every request.

mod access;
mod change;
mod client;
mod compare;
mod config;
mod connection;
mod counts;
mod develop;
mod events;
mod guard;
mod lights;
mod limiter;
mod metrics;
mod page;
mod pages;
mod pictures;
mod query;
mod routes;
mod screenshot;
mod sphere;
mod stall;
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
use pictures::PictureCache;
use screenshot::Screenshots;
use std::sync::Arc;
use tokio::sync::watch;

/// Access rules of the server.
#[derive(Clone, Debug)]
pub struct Options {
    /// The accepted Host headers.
    pub guard: Guard,
    /// The condition for changes of settings and for pictures.
    pub access: Access,
    /// Origins (`http://host:port`) of other sites whose pages have the rights of the server's own pages.
    pub origins: Vec<String>,
    /// The file that `PATCH /v1/config?save=1` writes settings to.
    pub file: Option<ConfigFile>,
}

impl Default for Options {
    /// Access from this machine only, without a token.
    fn default() -> Self {
        Self { guard: Guard::loopback(), access: Access::Open, origins: Vec::new(), file: None }
    }
}

/// The state that handlers share.
type Context = Arc<Shared>;

struct Shared {
    link: Arc<Link>,
    cache: Cache,
    pictures: PictureCache,
    screenshots: Screenshots,
    scores: compare::ComparisonScores,
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
        pictures: PictureCache::default(),
        screenshots: Screenshots::default(),
        scores: compare::ComparisonScores::default(),
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
