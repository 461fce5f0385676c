//! Fuzz target: requests of arbitrary bytes to the server of a running probe, over TCP; there is no panic, and every answer is HTTP.

#![no_main]

use hemilux::probe::{Config, Probe};
use hemilux::scene;
use hemilux::server::{Limits, Options, Running, app, start};
use hemilux::source::{Pace, SceneSource};
use libfuzzer_sys::fuzz_target;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::LazyLock;
use std::time::Duration;

/// Longest wait for more bytes of an answer. Event streams do not end.
const PATIENCE: Duration = Duration::from_millis(40);

/// Largest number of bytes that are read of an answer.
const MOST: u64 = 1 << 16;

static SERVER: LazyLock<(Probe, Running)> = LazyLock::new(|| {
    // As in every program of Rust, whose `main` libFuzzer replaces: writing to a closed connection is an error, not the end of the process.
    // SAFETY: no other thread sets signals.
    unsafe { libc::signal(libc::SIGPIPE, libc::SIG_IGN) };
    let scene = scene::by_name("lamps").expect("a scene");
    let source = SceneSource::new(scene, Pace::Every(Duration::from_millis(10)));
    let probe = Probe::start(Box::new(source), "scene:lamps".into(), Config::default()).expect("a probe");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let running =
        start(listener, app(probe.link(), Options::default()), Limits::default()).expect("a server");
    (probe, running)
});

fuzz_target!(|bytes: &[u8]| {
    let mut stream = TcpStream::connect(SERVER.1.address()).expect("the server accepts connections");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    let mut answer = Vec::new();
    // The server may close the connection at any byte.
    if stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write)).is_ok() {
        let _ = stream.take(MOST).read_to_end(&mut answer);
    }
    let start = &answer[..answer.len().min(5)];
    assert!(
        b"HTTP/".starts_with(start),
        "an answer that is not HTTP: {:?}",
        String::from_utf8_lossy(&answer)
    );
});
