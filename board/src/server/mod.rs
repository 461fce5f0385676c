//! The HTTP server: the requests of the thesis's appendix A.1, and `/v1`.
//!
//! [`app`] makes the routes from a [`Link`], and tests call them without sockets; [`start`] serves them. A request for lights waits for the next
//! finished frame; slow clients do not delay other clients. `openapi.json` documents every request.

mod access;
mod answer;
mod attempts;
mod calibration;
mod change;
mod client;
mod client_key;
mod compare;
mod config;
mod connection;
mod counts;
mod develop;
mod encoder;
mod events;
mod files;
mod format;
mod headers;
mod hosts;
mod identify;
mod lights;
mod map_form;
mod memory;
mod metrics;
mod origin;
mod packed;
mod page;
mod pages;
mod paths;
mod picture_cache;
mod pictures;
mod proxy;
mod query;
mod routes;
mod screenshot;
mod sets;
mod sources;
mod sphere;
mod status;
mod token;
mod xr;

pub use access::Access;
pub use connection::{Event, Limits, Running, Signals, start};
pub use hosts::{KnownHosts, is_loopback};
pub use token::{LoadedToken, Token, TokenError};

use crate::config_file::ConfigFile;
use crate::probe::Link;
use crate::source::Library;
use attempts::Attempts;
use axum::Router;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use counts::Counts;
use memory::AnswerMemory;
use picture_cache::PictureCache;
use proxy::Proxies;
use screenshot::Screenshots;
use sets::EncodedSets;
use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::watch;

/// Access rules of the server.
#[derive(Clone, Debug)]
pub struct Options {
    /// The Host headers that requests may have.
    pub hosts: KnownHosts,
    /// The condition under which a request may change settings and get pictures: none, or the token.
    pub access: Access,
    /// Origins (`http://host:port`) of other sites whose pages have the same rights as the server's own pages.
    pub origins: Vec<String>,
    /// Addresses of trusted proxies, whose forwarding headers contain the client of a request.
    pub proxies: Vec<IpAddr>,
    /// The configuration file to which `PATCH /v1/config?save=1` writes the settings; `None` if there is none.
    pub file: Option<ConfigFile>,
    /// The lens file to which calibrations made on the page are written; `None` if there is none.
    pub calibration_file: Option<PathBuf>,
    /// The sources to which `PATCH /v1/source` may switch.
    pub library: Library,
}

impl Default for Options {
    /// Returns the access rules of a server for this machine alone, without a token.
    fn default() -> Self {
        Self {
            hosts: KnownHosts::loopback(),
            access: Access::Open,
            origins: Vec::new(),
            proxies: Vec::new(),
            file: None,
            calibration_file: None,
            library: Library::default(),
        }
    }
}

/// The server's state that all request handlers share.
type Context = Arc<HandlerState>;

struct HandlerState {
    link: Arc<Link>,
    answers: AnswerCaches,
    admission: Admission,
    /// The calibration in progress, one for all clients.
    calibration: calibration::Calibrations,
    counts: Arc<Counts>,
    /// The configuration file to which settings are saved; `None` if the probe was started without one.
    file: Option<ConfigFile>,
    library: Library,
    /// Locked while a requested source is opened.
    opening: tokio::sync::Mutex<()>,
    /// True after the server's shutdown has begun; streams then end.
    stop: Arc<watch::Sender<bool>>,
}

/// Caches of answers that are computed once for several requests.
struct AnswerCaches {
    sets: EncodedSets,
    pictures: PictureCache,
    screenshots: Screenshots,
    scores: compare::ComparisonScores,
}

impl AnswerCaches {
    fn new(memory: &Arc<AnswerMemory>) -> Self {
        Self {
            sets: EncodedSets::new(Arc::clone(memory)),
            pictures: PictureCache::new(Arc::clone(memory)),
            screenshots: Screenshots::default(),
            scores: compare::ComparisonScores::default(),
        }
    }
}

/// The rules by which requests are admitted, and the failed attempts of clients to guess the token.
struct Admission {
    hosts: KnownHosts,
    access: Access,
    attempts: Attempts,
    origins: Vec<String>,
    proxies: Arc<Proxies>,
}

/// The routes of the server, and the state that [`start`] uses.
pub struct App {
    router: Router,
    counts: Arc<Counts>,
    proxies: Arc<Proxies>,
    memory: Arc<AnswerMemory>,
    stop: Arc<watch::Sender<bool>>,
}

impl App {
    /// Returns the routes of the server, for requests without sockets.
    pub fn router(&self) -> Router {
        self.router.clone()
    }
}

/// Returns all routes of the server, preceded by the checks that `options` require.
#[must_use]
pub fn app(link: Arc<Link>, options: Options) -> App {
    let Options { hosts, access, origins, proxies, file, calibration_file, library } = options;
    let (stop, counts) = (Arc::new(watch::Sender::new(false)), Arc::new(Counts::default()));
    let (memory, proxies) = (Arc::new(AnswerMemory::default()), Arc::new(Proxies::new(&proxies)));
    let attempts = Attempts::default();
    let state = HandlerState {
        link,
        answers: AnswerCaches::new(&memory),
        admission: Admission { hosts, access, attempts, origins, proxies: Arc::clone(&proxies) },
        calibration: calibration::Calibrations::new(calibration_file),
        counts: Arc::clone(&counts),
        file,
        library,
        opening: tokio::sync::Mutex::default(),
        stop: Arc::clone(&stop),
    };
    App { router: routes::router(Arc::new(state)), counts, proxies, memory, stop }
}

/// Returns a response of one line of plain text.
fn line(status: StatusCode, text: &str) -> Response {
    (status, format!("{text}\n")).into_response()
}

#[cfg(test)]
mod tests;
