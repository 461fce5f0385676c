//! The server over real sockets, with a source that returns a burst on the request of the test.

mod bench;

use bench::{Answer, Bench, Step, ask, connect, connect_from, get, raw};
use hemilux::probe::Config;
use hemilux::server::{Event, Limits};
use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Command, Stdio};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

/// Time after which a request is taken to be waiting. If the machine is slower, the test is weaker but does not fail.
const SETTLED: Duration = Duration::from_millis(150);

#[test]
fn data_requests_wait_for_the_next_frame() {
    let bench = Bench::new(Limits::default());
    bench.frame();
    let waiting = ["/lights.json", "/data", "/xml"].map(|path| get(bench.address(), path));
    sleep(SETTLED);
    assert!(waiting.iter().all(|client| !client.is_finished()), "an old frame was sent");
    let frame = bench.frame();
    let [json, text, xml] = waiting.map(|client| client.join().expect("an answer"));
    assert_eq!(json.json()["frame"], frame, "JSON");
    assert_eq!(json.json()["stale"], Value::Null, "fresh");
    assert!(text.body.contains(&format!("# frame {frame}\n")), "{}", text.body);
    assert!(xml.body.contains(&format!("frame=\"{frame}\"")), "{}", xml.body);
    assert!(json.head.contains("content-length:") && json.head.contains("no-store"), "{}", json.head);
}

#[test]
fn clients_side_by_side_each_see_frames_ascend_on_one_connection() {
    let bench = Bench::new(Limits::default());
    let address = bench.address();
    let clients: Vec<_> = (0..8).map(|_| spawn(move || follow(address, 15))).collect();
    while !clients.iter().all(JoinHandle::is_finished) {
        bench.frame();
    }
    for client in clients {
        let frames = client.join().expect("frames");
        assert!(frames.windows(2).all(|w| w[1] > w[0]), "{frames:?}");
    }
}

/// Returns the frame numbers of `count` answers on one connection.
fn follow(address: SocketAddr, count: usize) -> Vec<u64> {
    let mut stream = connect(address);
    (0..count).map(|_| next_on(&mut stream, address).json()["frame"].as_u64().expect("a number")).collect()
}

/// Requests lights on a connection that stays open.
fn next_on(stream: &mut TcpStream, address: SocketAddr) -> Answer {
    write!(stream, "GET /lights.json HTTP/1.1\r\nHost: {address}\r\n\r\n").expect("a request");
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).expect("a head");
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).expect("UTF-8").to_ascii_lowercase();
    let length = head.lines().find_map(|l| l.strip_prefix("content-length: ")).expect("a length");
    let mut body = vec![0; length.parse().expect("a number")];
    stream.read_exact(&mut body).expect("a body");
    Answer { status: 200, head, body: String::from_utf8(body).expect("UTF-8") }
}

#[test]
fn a_change_applies_to_the_next_frame_of_all_clients() {
    let bench = Bench::new(Limits::default());
    bench.frame();
    // The change is applied while the source has no burst, so that the answer precedes the frame.
    let page = ask(bench.address(), "/change?algorithm=pharr&samples=30", "");
    assert!(page.status == 200 && page.body.contains("pharr"), "{page:?}");
    let waiting = [(); 4].map(|()| get(bench.address(), "/lights.json"));
    sleep(SETTLED);
    bench.frame();
    for client in waiting {
        let set = client.join().expect("an answer").json();
        assert_eq!((&set["sampler"], &set["requested"]), (&"pharr".into(), &30.into()), "the new settings");
    }
}

#[test]
fn the_last_set_is_stale_while_the_source_is_gone_and_fresh_again_after() {
    let bench = Bench::new(Limits::default());
    let frame = bench.frame();
    bench.step(Step::Fail("unplugged"));
    let began = Instant::now();
    let set = ask(bench.address(), "/lights.json", "").json();
    assert!(began.elapsed() >= Duration::from_millis(1400), "answered before a frame could come");
    assert_eq!(set["frame"], frame, "the last set");
    assert_eq!(set["stale"]["reason"], "unplugged", "{set}");
    assert!(set["stale"]["age_ms"].as_u64() >= Some(1400), "{set}");
    let waiting = get(bench.address(), "/lights.json");
    sleep(SETTLED);
    bench.frame();
    assert_eq!(waiting.join().expect("an answer").json()["stale"], Value::Null, "fresh again");
}

#[test]
fn the_end_of_the_processing_thread_ends_the_wait_for_signals() {
    let bench = Bench::new(Limits::default());
    bench.frame();
    let (mut signals, link) = (bench.running.signals().expect("signals"), bench.probe.link());
    bench.step(Step::Panic);
    assert_eq!(bench.running.wait(&mut signals, link.status().ended()), Event::Ended, "the program ends");
    assert!(link.status().failure().is_some_and(|f| f.contains("ended")), "the fault is reported to clients");
}

#[test]
fn requests_before_the_first_set_get_503() {
    let bench = Bench::new(Limits::default());
    let answer = ask(bench.address(), "/lights.json", "");
    assert_eq!(answer.status, 503, "{answer:?}");
    assert!(answer.head.contains("retry-after: 1"), "{answer:?}");
}

#[test]
fn waiting_requests_are_answered_at_shutdown() {
    let bench = Bench::new(Limits::default());
    let address = bench.address();
    let frame = bench.frame();
    let waiting: Vec<_> = (0..20).map(|_| get(address, "/lights.json")).collect();
    sleep(SETTLED);
    let began = Instant::now();
    bench.running.stop();
    assert!(began.elapsed() < Duration::from_millis(2400), "no connection had to be closed by force");
    for client in waiting {
        let answer = client.join().expect("an answer");
        assert_eq!((answer.status, &answer.json()["frame"]), (200, &frame.into()), "{answer:?}");
    }
    assert!(TcpStream::connect(address).is_err(), "the port is free");
}

#[test]
fn malformed_requests_are_refused_and_the_next_client_is_served() {
    let bench = Bench::new(Limits::default());
    let address = bench.address();
    let head = |extra: &str| format!("GET /healthz HTTP/1.1\r\nHost: {address}\r\n{extra}\r\n").into_bytes();
    let cases: [(Vec<u8>, &[u16]); 9] = [
        (b"nonsense\r\n\r\n".to_vec(), &[400]),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n".to_vec(), &[400]),
        (b"GET / HTTP/9.9\r\n\r\n".to_vec(), &[400]),
        (b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n".to_vec(), &[400]),
        (head("Host: localhost\r\nConnection: close\r\n"), &[400]),
        (head(&format!("X-Big: {}\r\n", "a".repeat(10 << 20))), &[431, 0]),
        (head(&"X-Many: 1\r\n".repeat(200)), &[431]),
        (
            format!("GET /{} HTTP/1.1\r\nHost: {address}\r\n\r\n", "a".repeat(1 << 20)).into_bytes(),
            &[414, 431, 0],
        ),
        (head("Connection: close\r\nContent-Length: 1000000\r\n"), &[413]),
    ];
    for (request, expected) in cases {
        let answer = raw(address, &request);
        let start = String::from_utf8_lossy(&request[..request.len().min(60)]).into_owned();
        assert!(expected.contains(&answer.status), "{start:?}: {answer:?}");
    }
    bench.frame();
    assert_eq!(ask(address, "/healthz", "").status, 200, "others are served");
}

#[test]
fn other_hosts_and_origins_are_refused() {
    let bench = Bench::new(Limits::default());
    let address = bench.address();
    let rebound = b"GET /lights.json HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n";
    assert_eq!(raw(address, rebound).status, 421, "DNS rebinding");
    let absolute =
        format!("GET http://evil.example/ HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    assert_eq!(raw(address, absolute.as_bytes()).status, 421, "absolute form");
    assert_eq!(ask(address, "/change?samples=20", "Origin: http://evil.example\r\n").status, 403, "Origin");
    assert_eq!(bench.probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
    assert_eq!(raw(address, b"GET /info HTTP/1.0\r\n\r\n").status, 200, "an old client without Host");
}

#[test]
fn silent_connections_are_closed() {
    let limits = Limits { head: Duration::from_millis(300), ..Limits::default() };
    let bench = Bench::new(limits);
    for beginning in ["", "GET /info HTTP/1.1\r\nHost: localh"] {
        let began = Instant::now();
        raw(bench.address(), beginning.as_bytes());
        let passed = began.elapsed();
        assert!((250..3000).contains(&passed.as_millis()), "{beginning:?}: closed after {passed:?}");
    }
    let request = format!("GET /info HTTP/1.1\r\nHost: {}\r\n\r\n", bench.address());
    assert_eq!(
        raw(bench.address(), request.as_bytes()).status,
        200,
        "an idle connection is served, then closed"
    );
}

#[test]
fn connections_over_the_limit_are_refused_while_all_others_are_in_use() {
    let bench = Bench::new(Limits { connections: 2, ..Limits::default() });
    let address = bench.address();
    bench.frame();
    let held = [1, 2].map(|i| {
        let mut stream = connect_from([127, 0, 1, i], address).expect("a connection");
        write!(stream, "GET /v1/events HTTP/1.1\r\nHost: {address}\r\n\r\n").expect("a request");
        let count = stream.read(&mut [0; 256]).expect("a head");
        assert!(count > 0, "served");
        stream
    });
    assert_eq!(raw(address, b"").status, 503, "one connection above the limit");
    drop(held);
    // The server notices the closed connection when it sends the next set.
    bench.frame();
    sleep(SETTLED);
    assert_eq!(ask(address, "/info", "").status, 200, "a permit is free again");
}

/// A client that requests many large sets and reads none loses its connection; another client receives every frame meanwhile.
#[test]
fn a_stalled_reader_delays_no_other_client_and_is_closed() {
    let limits = Limits { connections: 2, stall: Duration::from_millis(500), ..Limits::default() };
    let bench = Bench::with_lights(limits, 50_000);
    let address = bench.address();
    bench.frame();
    let mut stalled = connect(address);
    let request = format!("GET /lights.json HTTP/1.1\r\nHost: {address}\r\n\r\n");
    stalled.write_all(request.repeat(8).as_bytes()).expect("requests");
    let mut other = connect(address);
    for _ in 0..12 {
        let before = bench.frame();
        write!(other, "GET /info HTTP/1.1\r\nHost: {address}\r\n\r\n").expect("a request");
        let mut buffer = [0; 1 << 14];
        let count = other.read(&mut buffer).expect("an answer");
        let text = String::from_utf8_lossy(&buffer[..count]).into_owned();
        assert!(text.contains(&format!("<td>{}</td>", before + 1)), "{text}");
        sleep(Duration::from_millis(20));
    }
    drop(other);
    sleep(Duration::from_millis(1500));
    // Two connections are permitted, and both are needed now.
    let _idle = connect(address);
    sleep(SETTLED);
    assert_eq!(ask(address, "/info", "").status, 200, "the stalled connection is gone");
}

/// Returns whether libxml2 accepts `xml` by `lights.xsd`; `None` without xmllint.
fn is_valid(xml: &str) -> Option<bool> {
    let schema = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/lights.xsd");
    let child = Command::new("xmllint")
        .args(["--noout", "--schema", schema, "-"])
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut child) = child else {
        assert!(std::env::var("HEMILUX_RIG").is_err(), "no xmllint, and HEMILUX_RIG demands it");
        println!("skipped: no xmllint");
        return None;
    };
    child.stdin.take().expect("a pipe").write_all(xml.as_bytes()).expect("it reads");
    Some(child.wait().expect("it ends").success())
}

#[test]
fn xml_is_valid_by_xmllint() {
    let bench = Bench::new(Limits::default());
    bench.frame();
    let xml = ask(bench.address(), "/xml?coordinates=unity", "").body;
    let Some(fresh) = is_valid(&xml) else { return };
    assert!(fresh, "{xml}");
    bench.step(Step::Fail("<\"unplugged\"> & gone"));
    let stale = ask(bench.address(), "/v1/lights?format=xml", "").body;
    assert!(stale.contains("unplugged") && is_valid(&stale) == Some(true), "{stale}");
    for (right, wrong) in
        [("version=\"1\"", "version=\"2\""), ("<light id", "<lamp id"), (" x=\"", " w=\""), ("z=\"", "z=\"9")]
    {
        let broken = xml.replacen(right, wrong, 1);
        assert!(broken != xml && is_valid(&broken) == Some(false), "{wrong} is accepted");
    }
}
