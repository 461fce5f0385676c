//! Load: two constant clients and two hundred transient clients with mixed legacy and modern requests, while the settings are changed.
//!
//! `HEMILUX_LOAD_REQUESTS=1000000 cargo test --release -p hemilux-tests --test server_load -- --nocapture` is the long run; without the
//! variable the run is short. Every answer is checked; times and memory are printed, times are not asserted.

mod bench;

use bench::{Bench, connect_from, exchange};
use hemilux::clock::monotonic_ns;
use hemilux::server::{Limits, Options};
use hemilux_core::wire::BinarySet;
use serde_json::Value;
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

/// Number of requests of the short run.
const SHORT: u64 = 20_000;
/// Least number of requests of two constant clients alone, at the rate of the frames.
const ALONE: u64 = 400;
const GUESTS: u8 = 200;
/// Largest permitted growth of the server's memory, bytes: buffers of two hundred more connections, on both sides of the socket.
const GROWTH_BYTES: u64 = 48 << 20;

/// Longest times between two requests of a transient client, ms: each for a third of the requests, so that the report contains delay
/// against load.
const LOOKS_MS: [u64; 3] = [400, 200, 100];

/// The requested paths, in rotation.
const PATHS: [&str; 8] = [
    "/data",
    "/v1/lights",
    "/xml",
    "/v1/lights?format=binary",
    "/lights.json",
    "/v1/lights?coordinates=unity&lights=8",
    "/v1/lights?format=text&coordinates=three",
    "/v1/lights?format=binary&after=",
];

struct Run {
    address: SocketAddr,
    /// Longest time between two requests of a transient client, ms.
    look_ms: u64,
    /// Number of requests that remain to be sent.
    left: AtomicU64,
    answered: AtomicU64,
    over: AtomicBool,
    /// Times from the finished set to its last byte read, microseconds, of the constant clients and of the transient clients.
    constant_us: Mutex<Vec<u32>>,
    guests_us: Mutex<Vec<u32>>,
}

/// The values of a decoded answer of the server.
struct Received {
    frame: u64,
    lights: usize,
    /// End of the burst plus the time to the finished set, nanoseconds, if the form has both.
    ready_ns: Option<u64>,
}

fn read(path: &str, body: &[u8]) -> Received {
    let text = || std::str::from_utf8(body).expect("UTF-8");
    if path.contains("binary") {
        let set = BinarySet::try_new(body).expect("a set");
        let head = set.head();
        assert!(head.stale.is_none(), "stale");
        let ready = head.timestamp_ns + 1000 * u64::from(head.latency.total);
        Received { frame: head.frame, lights: set.lights().len(), ready_ns: Some(ready) }
    } else if path == "/xml" {
        let document = roxmltree::Document::parse(text()).expect("XML");
        let root = document.root_element();
        assert_eq!(root.attribute("stale"), Some(""), "stale");
        let frame = root.attribute("frame").and_then(|f| f.parse().ok()).expect("a number");
        Received { frame, lights: root.children().count(), ready_ns: None }
    } else if path == "/data" || path.contains("text") {
        assert!(text().contains("# stale no\n") && text().ends_with('\n'), "{}", text());
        let frame = text().lines().find_map(|l| l.strip_prefix("# frame ")?.parse().ok()).expect("a number");
        let lights = text()
            .lines()
            .filter(|l| !l.starts_with('#'))
            .map(|l| assert_eq!(l.split(' ').count(), 7, "{l}"));
        Received { frame, lights: lights.count(), ready_ns: None }
    } else {
        let set: Value = serde_json::from_slice(body).expect("JSON");
        assert_eq!(set["stale"], Value::Null, "stale");
        let number = |v: &Value| v.as_u64().expect("a number");
        let ready = number(&set["timestamp_ns"]) + 1000 * number(&set["latency_us"]["total"]);
        let lights = set["lights"].as_array().expect("lights").len();
        assert!(lights as u64 <= number(&set["requested"]), "more than asked for");
        Received { frame: number(&set["frame"]), lights, ready_ns: Some(ready) }
    }
}

/// Runs one client: opens connections of `stay` requests each from `from` until no requests remain.
fn client(run: &Run, from: [u8; 4], stay: u64, times: &Mutex<Vec<u32>>) {
    let mut made = u64::from(from[3]);
    let mut mine = Vec::new();
    'connections: while !run.over.load(Relaxed) {
        let mut stream = connect_from(from, run.address).expect("a connection");
        let (mut bytes, mut last) = (Vec::new(), None);
        for _ in 0..stay {
            if run.left.fetch_update(Relaxed, Relaxed, |n| n.checked_sub(1)).is_err() {
                break 'connections;
            }
            let closes = one(run, &mut stream, &mut bytes, made, &mut last, &mut mine);
            made += 1;
            // A transient client pauses between requests.
            if stay < u64::MAX {
                sleep(Duration::from_millis(17 * made % run.look_ms));
            }
            if closes {
                break;
            }
        }
    }
    times.lock().expect("no panic").append(&mut mine);
}

/// Lowers the priority of the thread, so that the clients do not take processors from the server.
fn give_way() {
    // On Linux each thread has a separate priority.
    rustix::process::setpriority_process(None, 19).expect("lowering the priority needs no privilege");
}

fn one(
    run: &Run,
    stream: &mut TcpStream,
    bytes: &mut Vec<u8>,
    made: u64,
    last: &mut Option<u64>,
    times: &mut Vec<u32>,
) -> bool {
    let path = PATHS[made as usize % PATHS.len()];
    let after = last.filter(|_| path.ends_with("after=")).unwrap_or(0);
    let suffix = if path.ends_with("after=") { after.to_string() } else { String::new() };
    let request = format!("GET {path}{suffix} HTTP/1.1\r\nHost: {}\r\n\r\n", run.address);
    let reply = exchange(stream, bytes, request.as_bytes()).unwrap_or_else(|e| panic!("{path}: lost: {e}"));
    let now = monotonic_ns();
    assert_eq!(reply.status, 200, "{path}: {}", String::from_utf8_lossy(&reply.body));
    let seen = read(path, &reply.body);
    assert!(
        seen.lights > 0 && last.is_none_or(|l| seen.frame > l),
        "{path}: frame {} after {last:?}",
        seen.frame
    );
    *last = Some(seen.frame);
    // An answer to `after` may be of a set that existed before the request.
    if let Some(ready) = seen.ready_ns.filter(|_| !path.ends_with("after=")) {
        times.push(u32::try_from(now.saturating_sub(ready) / 1000).unwrap_or(u32::MAX));
    }
    run.answered.fetch_add(1, Relaxed);
    reply.closes
}

/// Changes the settings repeatedly, by `/change` and by `/v1/config` in turn; returns the number of changes.
fn changer(run: &Run) -> u64 {
    let mut stream = connect_from([127, 0, 9, 9], run.address).expect("a connection");
    let (mut bytes, mut changes) = (Vec::new(), 0);
    while !run.over.load(Relaxed) {
        let sampler = ["adaptive", "q2tree", "q2tree-jitter"][changes as usize % 3];
        let lights = 16 + 7 * (changes % 8);
        let request = if changes % 2 == 0 {
            format!(
                "GET /change?algorithm={sampler}&samples={lights} HTTP/1.1\r\nHost: {}\r\n\r\n",
                run.address
            )
        } else {
            let body = format!("{{\"sampler\":\"{sampler}\",\"lights\":{lights}}}");
            format!(
                "PATCH /v1/config HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\n\r\n{body}",
                run.address,
                body.len()
            )
        };
        let reply = exchange(&mut stream, &mut bytes, request.as_bytes()).expect("an answer");
        assert_eq!(reply.status, 200, "{request}: {}", String::from_utf8_lossy(&reply.body));
        changes += 1;
        sleep(Duration::from_millis(40));
    }
    changes
}

/// Returns the resident memory of this process, bytes, which includes the server and the clients.
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("a status");
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).expect("a size");
    1024 * line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number")
}

fn percentile(times: &mut [u32], part: f64) -> f64 {
    times.sort_unstable();
    let at = ((times.len() as f64 * part) as usize).min(times.len().saturating_sub(1));
    f64::from(times.get(at).copied().unwrap_or(0)) / 1e3
}

/// Returns the server's delivery times: bounds in milliseconds, and number of answers within each bound.
fn delivered(address: SocketAddr) -> Vec<(f64, f64)> {
    let page = bench::ask(address, "/metrics", "").body;
    let bucket = |line: &str| {
        let (bound, count) =
            line.strip_prefix("hemilux_delivery_seconds_bucket{le=\"")?.split_once("\"} ")?;
        Some((1e3 * bound.parse::<f64>().ok()?, count.parse().ok()?))
    };
    page.lines().filter_map(bucket).collect()
}

/// Returns the time, milliseconds, within which the share `part` of the answers between two results of [`delivered`] was sent, interpolated as in
/// Prometheus.
fn quantile(before: &[(f64, f64)], after: &[(f64, f64)], part: f64) -> f64 {
    let counts = before.iter().zip(after).map(|((_, b), (ms, a))| (*ms, a - b));
    let wanted = part * counts.clone().next_back().map_or(0.0, |(_, all)| all);
    let mut below = (0.0, 0.0);
    for (ms, count) in counts {
        if count >= wanted && count > below.1 {
            return below.0 + (ms - below.0) * (wanted - below.1) / (count - below.1);
        }
        below = (ms, count);
    }
    below.0
}

/// Sends `requests` requests by two constant clients and `guests` transient clients; prints the results.
fn load(bench: &Bench, requests: u64, guests: u8, look_ms: u64) {
    let run = Arc::new(Run {
        address: bench.address(),
        look_ms,
        left: requests.into(),
        answered: 0.into(),
        over: false.into(),
        constant_us: Mutex::default(),
        guests_us: Mutex::default(),
    });
    let before = delivered(run.address);
    let mut clients: Vec<JoinHandle<()>> = Vec::new();
    for i in 1..=2 {
        let run = Arc::clone(&run);
        clients.push(spawn(move || client(&run, [127, 0, 0, i], u64::MAX, &run.constant_us)));
    }
    for i in 1..=guests {
        let run = Arc::clone(&run);
        clients.push(spawn(move || {
            give_way();
            client(&run, [127, 0, 1, i], 1 + u64::from(i % 50), &run.guests_us);
        }));
    }
    let theirs = Arc::clone(&run);
    let changing = (guests > 0).then(|| spawn(move || changer(&theirs)));
    let began = Instant::now();
    let mut early = None;
    while !clients.iter().all(JoinHandle::is_finished) {
        sleep(Duration::from_millis(20));
        if early.is_none() && run.answered.load(Relaxed) >= requests / 5 {
            early = Some(resident());
        }
    }
    let late = resident();
    run.over.store(true, Relaxed);
    for client in clients {
        client.join().expect("every answer was right");
    }
    let passed = began.elapsed().as_secs_f64();
    let changes = changing.map_or(0, |changer| changer.join().expect("every change was confirmed"));
    assert_eq!(run.answered.load(Relaxed), requests, "none lost");
    let after = delivered(run.address);
    let sent = [0.5, 0.99].map(|part| quantile(&before, &after, part));
    let read = [&run.constant_us, &run.guests_us].map(|times| {
        let mut times = times.lock().expect("no panic");
        [0.5, 0.99].map(|part| percentile(&mut times, part))
    });
    let early = early.unwrap_or(late);
    let ms = |[half, most]: [f64; 2]| format!("{half:6.2} {most:6.2}");
    println!(
        "{guests:6} {requests:8} {:9.0} {changes:7} | {} | {} | {} | {:5.1} {:5.1}",
        requests as f64 / passed,
        ms(sent),
        ms(read[0]),
        ms(read[1]),
        early as f64 / 1e6,
        late as f64 / 1e6
    );
    assert!(late < early + GROWTH_BYTES, "memory grew from {early} to {late} bytes");
}

#[test]
fn every_request_of_many_clients_is_answered_correctly_in_bounded_memory() {
    let requests = std::env::var("HEMILUX_LOAD_REQUESTS")
        .ok()
        .map_or(SHORT, |n| n.parse().expect("a number of requests"));
    let limits = Limits { connections: 512, ..Limits::default() };
    let bench = Bench::running(Duration::from_millis(20), limits, Options::default());
    println!(
        "                                   | ms from the finished set, 50 and 99 per cent of answers    | memory, MB, at"
    );
    println!(
        "guests requests  a second changes | handed on     | read by the two | by guests     | a fifth, the end"
    );
    load(&bench, ALONE.max(requests / 250), 0, 1);
    for (i, look_ms) in (0..).zip(LOOKS_MS) {
        // Three equal parts; the last has the remainder.
        load(&bench, requests * (i + 1) / 3 - requests * i / 3, GUESTS, look_ms);
    }
    bench.running.stop();
}
