//! Hostile and broken clients: a well-behaved client that is connected at the same time sees no change.

mod bench;

use bench::{Bench, ask, connect_from, exchange};
use hemilux::server::{Limits, Options};
use serde_json::Value;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

/// Duration of the fuzz run, seconds; `HEMILUX_FUZZ_SECONDS=600` selects the long run.
const SHORT: u64 = 3;

fn get(address: SocketAddr, path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n")
}

/// Requests sets on one connection for `long`; asserts that all are current. Returns the number of frames and the longest gap between two
/// answers, which depends on the machine and is only printed.
fn well_behaved(address: SocketAddr, long: Duration) -> (u64, Duration) {
    let mut stream = connect_from([127, 0, 7, 7], address).expect("a connection");
    let (mut bytes, mut frames, mut longest) = (Vec::new(), 0, Duration::ZERO);
    let (began, mut before) = (Instant::now(), Instant::now());
    let mut last = None;
    while began.elapsed() < long {
        let reply = exchange(&mut stream, &mut bytes, get(address, "/lights.json").as_bytes())
            .unwrap_or_else(|e| {
                panic!("frame after {last:?}: {e}, {:?} after the last answer", before.elapsed())
            });
        let set: Value = serde_json::from_slice(&reply.body).expect("JSON");
        assert!(reply.status == 200 && set["stale"].is_null(), "{set}");
        assert!(set["frame"].as_u64() > last, "{} after {last:?}", set["frame"]);
        last = set["frame"].as_u64();
        frames += 1;
        longest = longest.max(before.elapsed());
        before = Instant::now();
    }
    (frames, longest)
}

/// In this test, 64 clients request large answers and read none of them, and 64 clients send a request one byte at a time.
#[test]
fn stalled_readers_and_slow_writers_delay_no_other_client() {
    let limits = Limits { head: Duration::from_secs(2), stall: Duration::from_secs(2), ..Limits::default() };
    let bench = Bench::running(Duration::from_millis(10), limits, Options::default());
    let address = bench.address();
    bench.wait();
    let (frames, alone) = well_behaved(address, Duration::from_secs(1));
    let mut stalled = Vec::new();
    for i in 0..64u8 {
        let mut stream = connect_from([127, 0, 2, 1 + i / 16], address).expect("a connection");
        let request =
            if i % 2 == 0 { get(address, "/v1/events") } else { get(address, "/lights.json").repeat(200) };
        stream.write_all(request.as_bytes()).expect("a request");
        stalled.push(stream);
    }
    let slow: Vec<_> = (0..64u8).map(|i| spawn(move || dribble(address, [127, 0, 3, 1 + i / 16]))).collect();
    let (beside, longest) = well_behaved(address, Duration::from_secs(4));
    println!(
        "alone {frames} frames a second, longest gap {alone:?}; beside 128 others {} a second, {longest:?}",
        beside / 4
    );
    let cut: usize = slow.into_iter().map(|s| usize::from(s.join().expect("a client"))).sum();
    assert_eq!(cut, 64, "every slow writer was cut off");
    drop(stalled);
}

/// Sends the head of a request one byte at a time; returns whether the server closed the connection.
fn dribble(address: SocketAddr, from: [u8; 4]) -> bool {
    let Ok(mut stream) = connect_from(from, address) else { return false };
    let _ = stream.set_read_timeout(Some(Duration::from_millis(1)));
    let head = format!("GET / HTTP/1.1\r\nHost: {address}\r\nX-Slow: {}", "a".repeat(1000));
    for byte in head.bytes() {
        let gone = stream.write_all(&[byte]).is_err() || matches!(stream.read(&mut [0; 256]), Ok(0));
        if gone {
            return true;
        }
        sleep(Duration::from_millis(100));
    }
    false
}

#[test]
fn silent_connections_are_closed_for_new_ones_of_their_address() {
    let limits = Limits { connections: 64, per_address: 8, ..Limits::default() };
    let bench = Bench::running(Duration::from_millis(10), limits, Options::default());
    bench.wait();
    let address = bench.address();
    let mut good = connect_from([127, 0, 4, 1], address).expect("a connection");
    let mut bytes = Vec::new();
    let mut silent = Vec::new();
    for _ in 0..20 {
        silent.push(connect_from([127, 0, 4, 1], address).expect("a socket"));
        let reply =
            exchange(&mut good, &mut bytes, get(address, "/lights.json").as_bytes()).expect("an answer");
        assert_eq!(reply.status, 200, "beside {} silent ones", silent.len());
    }
    let cut = silent.iter().filter(|stream| is_reset(stream)).count();
    assert_eq!(cut, 13, "seven of twenty silent connections and the active one hold a permit");
    assert_eq!(ask(address, "/healthz", "").status, 200, "another address");
}

/// Returns whether the server has reset the connection.
fn is_reset(mut stream: &TcpStream) -> bool {
    let _ = stream.set_read_timeout(Some(Duration::from_millis(50)));
    matches!(stream.read(&mut [0; 64]), Err(e) if e.kind() == ErrorKind::ConnectionReset)
}

#[test]
fn a_connection_ends_after_its_requests() {
    let limits = Limits { requests: 3, ..Limits::default() };
    let bench = Bench::running(Duration::from_millis(10), limits, Options::default());
    let address = bench.address();
    let mut stream = connect_from([127, 0, 0, 1], address).expect("a connection");
    let mut bytes = Vec::new();
    let closes: Vec<_> = (0..3)
        .map(|_| {
            exchange(&mut stream, &mut bytes, get(address, "/client.js").as_bytes())
                .expect("an answer")
                .closes
        })
        .collect();
    assert_eq!(closes, [false, false, true], "the third answer announces the end");
    assert_eq!(stream.read(&mut [0; 8]).expect("an end"), 0, "the connection is closed");
}

/// The random number generator xorshift64*, so that a run is reproducible.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % n.max(1)
    }
}

/// Returns requests that are valid, or nearly valid.
fn corpus(address: SocketAddr) -> Vec<Vec<u8>> {
    let host = format!("Host: {address}\r\n");
    let patch = |body: &str| {
        format!(
            "PATCH /v1/config HTTP/1.1\r\n{host}Origin: http://evil.example\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        )
    };
    let mut all: Vec<String> = [
        "/",
        "/info",
        "/change",
        "/healthz",
        "/metrics",
        "/v1/config",
        "/client.js",
        "/login",
        "/v1/status",
        "/openapi.json",
        "/screenshots/..%2f..%2fetc%2fpasswd",
        "/image?99",
        "/change?samples=99999999999999999999",
        "/v1/lights?after=-1&format=%00",
        "/v1/lights?lights=0&coordinates=x",
        "/%ff%fe?%ff=%fe",
        "//etc/passwd",
        "/..\\..\\windows",
        "/change?%3Cscript%3E=1",
    ]
    .map(|path| format!("GET {path} HTTP/1.1\r\n{host}\r\n"))
    .into();
    all.push(patch("{\"lights\":20}"));
    all.push(patch(&"[".repeat(5000)));
    all.push(patch("{\"lights\":1e999}"));
    all.push(format!("POST /login HTTP/1.1\r\n{host}Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 9\r\n\r\ntoken=%00"));
    all.push(format!("PATCH /v1/config HTTP/1.1\r\n{host}Origin: null\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\n{{}}\r\n0\r\n\r\n"));
    all.push(format!(
        "GET / HTTP/1.1\r\n{host}Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
    ));
    all.push(format!("GET / HTTP/1.1\r\n{host}Content-Length: -1\r\n\r\n"));
    all.push(format!("GET /v1/socket HTTP/1.1\r\n{host}Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n\u{1}\u{7f}\u{7f}"));
    all.push("GET / HTTP/1.0\r\n\r\n".into());
    all.push(format!("OPTIONS * HTTP/1.1\r\n{host}\r\n"));
    all.push(format!("CONNECT evil.example:80 HTTP/1.1\r\n{host}\r\n"));
    all.push("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".into());
    all.push(format!("GET / HTTP/1.1\n{host}\n"));
    all.push(format!("GET /info HTTP/1.1\r\n{host}{}\r\n", "X: y\r\n".repeat(90)));
    all.push(format!("GET /info HTTP/1.1\r\n{host}Authorization: Basic {}\r\n\r\n", "=".repeat(300)));
    all.push(format!("GET /info HTTP/1.1\r\n{host}Cookie: {}\r\n\r\n", "hemilux=;=".repeat(300)));
    all.into_iter().map(String::into_bytes).collect()
}

fn mangled(random: &mut Random, corpus: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = corpus[random.below(corpus.len())].clone();
    for _ in 0..random.below(6) {
        let at = random.below(bytes.len());
        match random.below(5) {
            0 => bytes[at] = random.below(256) as u8,
            1 => bytes.truncate(at),
            2 => bytes.insert(at, b"\r\n\0 :%&=/\xff"[random.below(10)]),
            3 => {
                let other = &corpus[random.below(corpus.len())];
                bytes.truncate(at);
                bytes.extend_from_slice(&other[random.below(other.len())..]);
            }
            _ => {
                let part = bytes[at..(at + random.below(40)).min(bytes.len())].repeat(1 + random.below(8));
                bytes.splice(at..at, part);
            }
        }
        if bytes.is_empty() {
            bytes.push(b'G');
        }
    }
    bytes
}

#[test]
fn mangled_requests_are_refused_or_answered_and_delay_no_other_client() {
    let seconds =
        std::env::var("HEMILUX_FUZZ_SECONDS").ok().map_or(SHORT, |n| n.parse().expect("a number of seconds"));
    // The timeout is the longest time for which the well-behaved client may be denied a processor.
    let limits = Limits { head: Duration::from_secs(2), ..Limits::default() };
    let bench = Bench::running(Duration::from_millis(10), limits, Options::default());
    let address = bench.address();
    bench.wait();
    let over = Arc::new(AtomicBool::new(false));
    let good = {
        let long = Duration::from_secs(seconds);
        spawn(move || well_behaved(address, long))
    };
    let fuzzers: Vec<_> = (1..=4u8)
        .map(|i| {
            let over = Arc::clone(&over);
            spawn(move || fuzz(address, i, &over))
        })
        .collect();
    let (frames, longest) = good.join().expect("every answer was right");
    over.store(true, Relaxed);
    let counts =
        fuzzers.into_iter().map(|f| f.join().expect("a fuzzer")).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    println!(
        "{} mangled requests, {} answered; the good client saw {frames} frames, longest gap {longest:?}",
        counts.0, counts.1
    );
    assert!(counts.0 > 100 && counts.1 > counts.0 / 4, "{counts:?}: requests and answers");
    assert_eq!(ask(address, "/healthz", "").status, 200, "the server still answers");
}

/// Sends mangled requests; returns the numbers of requests and of answers. Asserts that every answer is HTTP and none has status 500.
fn fuzz(address: SocketAddr, seed: u8, over: &AtomicBool) -> (u64, u64) {
    let mut random = Random(0x9e37_79b9_7f4a_7c15 ^ u64::from(seed));
    let corpus = corpus(address);
    let (mut sent, mut answered) = (0, 0);
    while !over.load(Relaxed) {
        let bytes = mangled(&mut random, &corpus);
        let Ok(mut stream) = connect_from([127, 0, 5, seed], address) else { continue };
        let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let mut answer = [0; 4096];
        let count = stream.read(&mut answer).unwrap_or(0);
        let head = String::from_utf8_lossy(&answer[..count]).into_owned();
        if count > 0 {
            answered += 1;
            assert!(head.starts_with("HTTP/1."), "{head:?} to {:?}", String::from_utf8_lossy(&bytes));
            assert!(!head[8..].starts_with(" 500"), "{head:?} to {:?}", String::from_utf8_lossy(&bytes));
        }
        sent += 1;
    }
    (sent, answered)
}
