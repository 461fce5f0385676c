//! Helpers that the tests of the server share: probes with servers, and requests as bytes.
#![allow(dead_code, reason = "each test file uses its own part")]

pub mod board;
pub mod browser;
pub mod room;

use hemilux::calibration::Burst;
use hemilux::pipeline::Settings;
use hemilux::probe::{Config, Probe};
use hemilux::scene as scenes;
use hemilux::server::{self, Access, Limits, Options, Running, Token};
use hemilux::source::{Adapter, Pace, SceneSource, Source, SourceError};
use serde_json::Value;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

/// The token that the access rules of [`with_token`] require.
pub const SECRET: &str = "correct-horse-battery";

/// Returns the access rules with the token [`SECRET`].
pub fn with_token() -> Access {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("token");
    std::fs::write(&file, SECRET).expect("a file");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).expect("permissions");
    let token = Token::load_or_make(&file).expect("a token").token;
    Access::with_token(token).expect("random numbers")
}

/// The next result of the source; without a step the source has no burst.
pub enum Step {
    Burst,
    Fail(&'static str),
    Panic,
}

struct Scripted {
    scene: SceneSource,
    steps: Receiver<Step>,
}

impl Adapter for Scripted {
    fn inner(&self) -> &dyn Source {
        &self.scene
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        &mut self.scene
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        match self.steps.recv_timeout(Duration::from_millis(50)) {
            Ok(Step::Burst) => self.scene.next(burst),
            Ok(Step::Panic) => panic!("requested by the test"),
            Ok(Step::Fail(reason)) => Err(SourceError::Gone(reason.into())),
            Err(_) => Err(SourceError::NotYet),
        }
    }
}

/// Number of frames of [`Film`] with a moving lamp.
const FRAMES: usize = 8;

/// A source that repeats a few precomputed bursts at a fixed interval, at little cost.
struct Film {
    scene: SceneSource,
    bursts: Vec<Burst>,
    every: Duration,
    shown: usize,
    due: Instant,
}

impl Film {
    fn new(every: Duration, frames: usize) -> Self {
        let mut scene = scene(Pace::Free);
        let bursts = bursts(&mut scene, frames);
        Self { scene, bursts, every, shown: 0, due: Instant::now() }
    }
}

fn bursts(scene: &mut SceneSource, count: usize) -> Vec<Burst> {
    let burst = |_| {
        let mut burst = Burst::default();
        scene.next(&mut burst).expect("a burst");
        burst
    };
    (0..count).map(burst).collect()
}

impl Adapter for Film {
    fn inner(&self) -> &dyn Source {
        &self.scene
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        &mut self.scene
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.scene.set_exposures(seconds)?;
        self.bursts = bursts(&mut self.scene, self.bursts.len());
        Ok(())
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        sleep(self.due.saturating_duration_since(Instant::now()));
        self.due = Instant::now() + self.every;
        burst.clone_from(&self.bursts[self.shown % self.bursts.len()]);
        burst.timestamp_ns = 0;
        self.shown += 1;
        Ok(())
    }
}

fn scene(pace: Pace) -> SceneSource {
    SceneSource::new(scenes::by_name("room").expect("a scene"), pace)
}

/// A probe with its server.
pub struct Bench {
    steps: Sender<Step>,
    pub running: Running,
    pub probe: Probe,
}

impl Bench {
    pub fn new(limits: Limits) -> Self {
        Self::with_lights(limits, 64)
    }

    pub fn with_lights(limits: Limits, lights: usize) -> Self {
        let (steps, script) = channel();
        let source = Box::new(Scripted { scene: scene(Pace::Free), steps: script });
        Self::of(source, steps, limits, lights, Options::default())
    }

    /// Starts a probe with a burst at intervals of `every` and a server with `options`.
    pub fn running(every: Duration, limits: Limits, options: Options) -> Self {
        let (steps, _) = channel();
        Self::of(Box::new(Film::new(every, FRAMES)), steps, limits, 64, options)
    }

    /// Starts a probe with a burst at intervals of `every`, whose lamp does not move.
    pub fn still(every: Duration) -> Self {
        let (steps, _) = channel();
        Self::of(Box::new(Film::new(every, 1)), steps, Limits::default(), 64, Options::default())
    }

    pub fn of(
        source: Box<dyn Source>,
        steps: Sender<Step>,
        limits: Limits,
        lights: usize,
        options: Options,
    ) -> Self {
        let config = Config { pipeline: Settings { lights, ..Settings::default() }, ..Config::steady() };
        Self::on(TcpListener::bind("127.0.0.1:0").expect("a port"), source, steps, limits, config, options)
    }

    /// Starts a probe at an address that was used before.
    pub fn at(address: SocketAddr, every: Duration) -> Self {
        let (steps, _) = channel();
        let listener = TcpListener::bind(address).expect("the same port");
        let (source, limits) = (Box::new(Film::new(every, FRAMES)), Limits::default());
        Self::on(listener, source, steps, limits, Config::steady(), Options::default())
    }

    fn on(
        listener: TcpListener,
        source: Box<dyn Source>,
        steps: Sender<Step>,
        limits: Limits,
        config: Config,
        options: Options,
    ) -> Self {
        let probe = Probe::start(source, "test".into(), config).expect("a probe");
        let running = server::start(listener, server::app(probe.link(), options), limits).expect("a server");
        Self { steps, running, probe }
    }

    /// Waits for the first light set.
    pub fn wait(&self) {
        let sets = self.probe.link().sets().subscribe();
        let began = Instant::now();
        while sets.borrow().is_none() {
            assert!(began.elapsed() < Duration::from_secs(20), "no frame");
            sleep(Duration::from_millis(1));
        }
    }

    pub fn address(&self) -> SocketAddr {
        self.running.address()
    }

    pub fn step(&self, step: Step) {
        self.steps.send(step).expect("the source is running");
    }

    /// Lets the source return a burst and waits until its light set is published; returns the frame number.
    pub fn frame(&self) -> u64 {
        let mut sets = self.probe.link().sets().subscribe();
        self.step(Step::Burst);
        let began = Instant::now();
        while !sets.has_changed().expect("the probe is running") {
            assert!(began.elapsed() < Duration::from_secs(20), "no frame");
            sleep(Duration::from_millis(1));
        }
        sets.borrow_and_update().as_ref().expect("a set").frame
    }
}

#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: String,
}

impl Answer {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).expect("JSON")
    }
}

pub fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout");
    stream
}

/// Sends the bytes `request` and reads until the server closes the connection.
pub fn raw(address: SocketAddr, request: &[u8]) -> Answer {
    let mut stream = connect(address);
    // The server may refuse and close before it has read everything.
    let _ = stream.write_all(request);
    let mut bytes = Vec::new();
    let end = stream.read_to_end(&mut bytes);
    assert!(!end.is_err_and(|e| e.kind() == ErrorKind::WouldBlock), "no answer");
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
    let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
    Answer { status, head: head.to_ascii_lowercase(), body: body.into() }
}

pub fn ask(address: SocketAddr, path: &str, headers: &str) -> Answer {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n");
    raw(address, request.as_bytes())
}

pub fn get(address: SocketAddr, path: &'static str) -> JoinHandle<Answer> {
    spawn(move || ask(address, path, ""))
}

/// Connects from the address `from`, one of 127.0.0.0/8.
pub fn connect_from(from: [u8; 4], to: SocketAddr) -> std::io::Result<TcpStream> {
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None)?;
    socket.bind(&SocketAddr::from((from, 0)).into())?;
    socket.connect(&to.into())?;
    socket.set_tcp_nodelay(true)?;
    socket.set_read_timeout(Some(Duration::from_secs(20)))?;
    Ok(socket.into())
}

/// An answer on a connection that stays open.
pub struct Reply {
    pub status: u16,
    pub body: Vec<u8>,
    pub closes: bool,
}

/// Sends a request and reads one answer; bytes after the answer stay in `left`.
pub fn exchange(stream: &mut TcpStream, left: &mut Vec<u8>, request: &[u8]) -> std::io::Result<Reply> {
    stream.write_all(request)?;
    let mut chunk = [0; 16 << 10];
    loop {
        let head_end = left.windows(4).position(|w| w == b"\r\n\r\n").map(|at| at + 4);
        if let Some(end) = head_end {
            let head = String::from_utf8_lossy(&left[..end]).to_ascii_lowercase();
            let length = head.lines().find_map(|l| l.strip_prefix("content-length: ")?.trim().parse().ok());
            let length: usize = length.ok_or(ErrorKind::InvalidData)?;
            if left.len() >= end + length {
                let status =
                    head.split(' ').nth(1).and_then(|s| s.parse().ok()).ok_or(ErrorKind::InvalidData)?;
                let body = left[end..end + length].to_vec();
                left.drain(..end + length);
                return Ok(Reply { status, body, closes: head.contains("connection: close") });
            }
        }
        let count = stream.read(&mut chunk)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        left.extend_from_slice(&chunk[..count]);
    }
}
