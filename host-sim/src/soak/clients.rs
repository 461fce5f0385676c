//! Clients of a soak test, one thread each: they request light sets, pictures and the status, subscribe to sets, change settings and abandon
//! connections.

use super::tally::{Before, Reply, Tally};
use hemilux::probe::Config;
use hemilux::probe::settings::{Kind, SETTINGS, Setting};
use hemilux_core::wire::BinarySet;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};
use ureq::Agent;

/// Longest wait of a client for a reply.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Number of requests or received sets after which a client closes its connection.
const REQUESTS_PER_CONNECTION: u32 = 500;

/// Number of screenshots while they are permitted. The server keeps the last sixteen, so that the memory of a run is constant after
/// four changes of each setting.
const SCREENSHOTS: u32 = 4;

/// Largest size of a reply that a client reads, bytes.
const MAX_REPLY_BYTES: u64 = 16 << 20;

/// Paths of light sets in different forms, requested in rotation.
const FORMS: [&str; 8] = [
    "/v1/lights",
    "/v1/lights?format=binary",
    "/lights.json",
    "/v1/lights?format=text&coordinates=three",
    "/v1/lights?lights=8",
    "/data",
    "/xml",
    "/v1/lights?format=binary&ambient=1",
];

/// Paths of pictures, maps, the status and a comparison.
const OTHERS: [&str; 10] = [
    "/v1/map.png",
    "/v1/status",
    "/v1/image/0",
    "/metrics",
    "/v1/map.exr",
    "/info",
    "/v1/mask.png",
    "/v1/xr",
    "/screenshot",
    "/v1/compare?algorithm=q2tree&lights=16",
];

/// A client of the server at `address`; all clients share the counters of replies and errors.
#[derive(Clone)]
struct Client {
    address: SocketAddr,
    tally: Arc<Tally>,
}

/// Method of a client that opens a connection, sends a series of requests and closes the connection.
type Round = fn(&Client);

/// Starts one thread for each client; each repeats its round of requests until `tally.over` is set. Each round has a thread of its own, because a
/// thread keeps up to 230 KB of freed memory until it ends, which would count as memory of the probe.
pub(super) fn start(address: SocketAddr, tally: &Arc<Tally>) -> std::io::Result<Vec<JoinHandle<()>>> {
    let kinds: [(&str, Round); 7] = [
        ("sets", Client::sets),
        ("sets", Client::sets),
        ("events", Client::events),
        ("socket", Client::socket),
        ("others", Client::others),
        ("settings", Client::settings),
        ("rude", Client::rude),
    ];
    let start = |(name, work): (&'static str, Round)| {
        let client = Client { address, tally: Arc::clone(tally) };
        let thread = |name: String| std::thread::Builder::new().name(name);
        thread(name.into()).spawn(move || {
            while !client.is_over() {
                let round = client.clone();
                let ended = thread(name.into()).spawn(move || work(&round)).map(JoinHandle::join);
                if !matches!(ended, Ok(Ok(()))) {
                    client
                        .tally
                        .error(format!("{name}: found a thread that failed, expected a round of requests"));
                }
            }
        })
    };
    kinds.into_iter().map(start).collect()
}

impl Client {
    fn is_over(&self) -> bool {
        self.tally.over.load(Ordering::Relaxed)
    }

    fn agent() -> Agent {
        let config = Agent::config_builder().timeout_global(Some(TIMEOUT)).http_status_as_error(false);
        config.build().into()
    }

    /// Sends a GET request; returns the status and the body of the reply and counts it. A request without a reply counts as an error.
    fn get(&self, agent: &Agent, path: &str) -> Option<(u16, Vec<u8>)> {
        let began = Instant::now();
        let reply = agent.get(format!("http://{}{path}", self.address)).call().and_then(|mut reply| {
            let status = reply.status().as_u16();
            let body = reply.body_mut().with_config().limit(MAX_REPLY_BYTES).read_to_vec()?;
            Ok((status, body))
        });
        match reply {
            Ok(reply) => {
                self.tally.reply(began.elapsed());
                Some(reply)
            }
            Err(error) => {
                self.tally.error(format!("{path}: no reply: {error}"));
                None
            }
        }
    }

    /// Requests light sets in all forms and compares the replies with the published sets.
    fn sets(&self) {
        let agent = Self::agent();
        for path in FORMS.iter().cycle().take(REQUESTS_PER_CONNECTION as usize) {
            if self.is_over() {
                return;
            }
            let before = self.tally.before();
            match self.get(&agent, path) {
                Some((200, body)) => {
                    self.check(path, before, &body);
                }
                Some((status, _)) => self.tally.error(format!("{path}: status {status}")),
                None => return,
            }
        }
    }

    /// Reads a light set in the form of `path` and compares it with the published set; returns its frame.
    fn check(&self, path: &str, before: Before, body: &[u8]) -> Option<u64> {
        let text = String::from_utf8_lossy(body);
        let reply = if path.contains("binary") {
            binary(body)
        } else if path.contains("text") || path == "/data" {
            lines(&text)
        } else if path == "/xml" {
            xml(&text)
        } else {
            json_set(body)
        };
        let Some(reply) = reply else {
            self.tally.error(format!("{path}: found {text}, expected a light set"));
            return None;
        };
        self.tally.check(path, before, &reply);
        Some(reply.frame)
    }

    /// Compares a set of a stream. A set that is not newer than the set before, of frame `last`, must be marked stale.
    fn check_next(&self, path: &str, last: &mut Option<u64>, body: &[u8]) {
        let before = Before { first_new: last.map_or(0, |frame| frame + 1), asked_ns: 0 };
        *last = self.check(path, before, body).or(*last);
    }

    /// Receives sets as server-sent events and compares them with the published sets.
    fn events(&self) {
        let config =
            Agent::config_builder().timeout_connect(Some(TIMEOUT)).timeout_recv_response(Some(TIMEOUT));
        let agent: Agent = config.build().into();
        let reply = agent.get(format!("http://{}/v1/events", self.address)).call();
        let Ok(reply) = reply else { return self.tally.error(format!("/v1/events: {:?}", reply.err())) };
        let mut lines = BufReader::new(reply.into_body().into_reader()).lines();
        let (mut began, mut last) = (Instant::now(), None);
        for _ in 0..REQUESTS_PER_CONNECTION {
            let data = lines.by_ref().find_map(|line| match line {
                Ok(line) => line.strip_prefix("data:").map(|data| Ok(data.trim().to_owned())),
                Err(error) => Some(Err(error)),
            });
            match data {
                Some(Ok(data)) => {
                    self.tally.reply(began.elapsed());
                    self.check_next("/v1/events", &mut last, data.as_bytes());
                }
                other => return self.tally.error(format!("/v1/events: found {other:?}, expected a set")),
            }
            began = Instant::now();
            if self.is_over() {
                return;
            }
        }
    }

    /// Receives sets through a WebSocket and compares them with the published sets.
    fn socket(&self) {
        let failed = |error: &dyn std::fmt::Display| self.tally.error(format!("/v1/socket: {error}"));
        let stream = match TcpStream::connect(self.address) {
            Ok(stream) => stream,
            Err(error) => return failed(&error),
        };
        let _ = stream.set_read_timeout(Some(TIMEOUT));
        let url = format!("ws://{}/v1/socket", self.address);
        let (mut socket, _) = match tungstenite::client(url, stream) {
            Ok(made) => made,
            Err(error) => return failed(&error),
        };
        let mut last = None;
        for _ in 0..REQUESTS_PER_CONNECTION {
            let began = Instant::now();
            match socket.read() {
                Ok(message) if message.is_text() || message.is_binary() => {
                    self.tally.reply(began.elapsed());
                    self.check_next("/v1/socket", &mut last, &message.into_data());
                }
                Ok(_) => {}
                Err(error) => return failed(&error),
            }
            if self.is_over() {
                break;
            }
        }
        let _ = socket.close(None);
        while socket.read().is_ok() {}
    }

    /// Requests pictures, maps, the status and a comparison, with a pause of 20 ms after each.
    fn others(&self) {
        let agent = Self::agent();
        for path in OTHERS {
            match self.get(&agent, path) {
                // The server replies with 503 while too many pictures are drawn, and with 409 while the debug picture is switched off.
                Some((200 | 503, _)) => {}
                Some((409, _)) if path == "/screenshot" => {}
                Some((status, body)) => {
                    let body = String::from_utf8_lossy(&body);
                    self.tally.error(format!("{path}: status {status}: {}", body.trim()));
                }
                None => return,
            }
            sleep(Duration::from_millis(20));
            if self.is_over() {
                return;
            }
        }
    }

    /// Changes each setting to other legal values and back to its default, and takes screenshots while they are permitted. A sliding window
    /// must be refused, since flicker is removed by default.
    fn settings(&self) {
        let agent = Self::agent();
        for setting in SETTINGS {
            let usual = setting.value(&Config::default());
            for value in others(setting, &usual).into_iter().chain([usual]) {
                if self.is_over() {
                    return;
                }
                let body = json!({ setting.name: value }).to_string();
                let url = format!("http://{}/v1/config", self.address);
                let reply = agent.patch(url).content_type("application/json").send(&body);
                let is_refused = value == "sliding";
                match reply.map(|reply| reply.status().as_u16()) {
                    Ok(200 | 202) if !is_refused => self.tally.change(setting.name),
                    Ok(400) if is_refused => {}
                    Ok(status) => self.tally.error(format!("{body}: status {status}")),
                    Err(error) => self.tally.error(format!("{body}: {error}")),
                }
                if setting.name == "gui" && value == true {
                    self.screenshots(&agent);
                }
                sleep(Duration::from_millis(30));
            }
        }
    }

    /// Takes [`SCREENSHOTS`] screenshots.
    fn screenshots(&self, agent: &Agent) {
        for _ in 0..SCREENSHOTS {
            match self.get(agent, "/screenshot") {
                // The server replies with 503 while too many pictures are drawn.
                Some((200 | 503, _)) => {}
                Some((status, _)) => self.tally.error(format!("/screenshot: status {status}")),
                None => return,
            }
        }
    }

    /// Opens connections and closes them in the middle of a request or of its reply.
    fn rude(&self) {
        for request in
            ["GET /v1/li", "GET /v1/map.exr HTTP/1.1\r\nHost: localhost\r\n\r\n", "\0\u{1}garbage\r\n\r\n"]
        {
            if let Ok(mut stream) = TcpStream::connect(self.address) {
                let _ = stream.write_all(request.as_bytes());
                let _ = stream.set_read_timeout(Some(Duration::from_millis(20)));
                let _ = stream.read(&mut [0; 16]);
                self.tally.rude.fetch_add(1, Ordering::Relaxed);
            }
            sleep(Duration::from_millis(20));
        }
    }
}

fn binary(body: &[u8]) -> Option<Reply> {
    let set = BinarySet::try_new(body).ok()?.head();
    let stale_ms = set.stale.map(|stale| stale.age_ms);
    Some(Reply { frame: set.frame, flux: Some(set.scalar_flux), stale_ms })
}

fn json_set(body: &[u8]) -> Option<Reply> {
    let set: Value = serde_json::from_slice(body).ok()?;
    let flux = |c: usize| set["scalar_flux"][c].as_f64().map(|v| v as f32);
    let stale_ms = if set["stale"].is_null() { None } else { Some(set["stale"]["age_ms"].as_u64()?) };
    Some(Reply { frame: set["frame"].as_u64()?, flux: Some([flux(0)?, flux(1)?, flux(2)?]), stale_ms })
}

fn lines(text: &str) -> Option<Reply> {
    let value = |name: &str| text.lines().find_map(|line| line.strip_prefix(name));
    let stale = value("# stale ")?;
    Some(Reply { frame: value("# frame ")?.parse().ok()?, flux: None, stale_ms: first_number(stale) })
}

fn xml(text: &str) -> Option<Reply> {
    let value = |name: &str| text.split_once(name)?.1.split('"').next();
    let is_whole = text.trim_end().ends_with("</lights>");
    let frame = value(" frame=\"")?.parse().ok().filter(|_| is_whole)?;
    Some(Reply { frame, flux: None, stale_ms: first_number(value(" stale=\"")?) })
}

/// Returns the number before the first space of the mark of a stale set; `None` for a mark without one, which is that of a fresh set.
fn first_number(mark: &str) -> Option<u64> {
    mark.split(' ').next()?.parse().ok()
}

/// Returns legal values of a setting that differ from its default `usual`.
fn others(setting: &Setting, usual: &Value) -> Vec<Value> {
    let near = |least: f32, most: f32, value: &Value| {
        let value = value.as_f64().unwrap_or(f64::from(least) + 0.1 * f64::from(most - least));
        vec![json!((0.8 * value).clamp(least.into(), most.into()))]
    };
    let whole = |least: u64, most: u64| {
        let value = usual.as_u64().unwrap_or(most);
        vec![json!((value / 2).clamp(least.max(2), most)), json!((value + 1).clamp(least, most))]
    };
    match setting.kind {
        Kind::Choice(words) => words.iter().map(|word| json!(word)).collect(),
        Kind::Switch => vec![json!(usual != &json!(true))],
        Kind::Whole(least, most) => whole(least, most),
        Kind::OptionalWhole(least, most) => vec![json!(least), json!((least + 1).min(most))],
        Kind::Real(least, most) | Kind::Optional(least, most) => near(least, most, usual),
        Kind::List(..) => {
            let [first, .., last] = super::camera::SECONDS;
            vec![json!([first, last]), json!([first, 4.0 * first, 16.0 * first, 64.0 * first])]
        }
    }
}
