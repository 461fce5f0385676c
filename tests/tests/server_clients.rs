//! Real clients: curl, a browser's EventSource, the module `client.js` in a browser, a WebSocket client, independent parsers of Prometheus and XML,
//! the Rust client and the Python script. If a tool is missing, the test prints its name and is skipped; with `HEMILUX_RIG=1` it fails.

mod bench;

use bench::{Bench, Step, ask};
use hemilux::client::{Client, Coordinates, Options as Wishes, State};
use hemilux::server::{Limits, Options};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use tungstenite::Message;

const EVERY: Duration = Duration::from_millis(30);

fn running() -> Bench {
    let bench = Bench::running(EVERY, Limits::default(), Options::default());
    bench.wait();
    bench
}

/// Returns the first of `programs` that is installed.
fn tool(programs: &[&'static str]) -> Option<&'static str> {
    let is_there = |name: &&&str| {
        let ran = Command::new(name).arg("--version").stdin(Stdio::null()).output();
        ran.is_ok_and(|o| o.status.success())
    };
    let found = programs.iter().find(is_there).copied();
    if found.is_none() {
        assert!(
            std::env::var("HEMILUX_RIG").is_err(),
            "none of {programs:?} is there, and HEMILUX_RIG demands it"
        );
        println!("skipped: none of {programs:?} is there");
    }
    found
}

fn output(command: &mut Command) -> String {
    let output = command.stdin(Stdio::null()).output().expect("it runs");
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

#[test]
fn curl_reads_sets_and_changes_settings() {
    let Some(curl) = tool(&["curl"]) else { return };
    let bench = running();
    let url = |path: &str| format!("http://{}{path}", bench.address());
    let set: Value =
        serde_json::from_str(&output(Command::new(curl).args(["-sSf", &url("/v1/lights")]))).expect("JSON");
    assert!(set["lights"].as_array().is_some_and(|l| !l.is_empty()), "{set}");
    let patch = ["-sSf", "-X", "PATCH", "-d", "{\"lights\": 24}", &url("/v1/config")];
    let config: Value = serde_json::from_str(&output(Command::new(curl).args(patch))).expect("JSON");
    assert_eq!(config["values"]["lights"], 24, "{config}");
    let page = output(Command::new(curl).args(["-sSf", "-G", "-d", "samples=25", &url("/change")]));
    assert!(page.contains("samples = 25"), "{page}");
    // Three requests on one connection, then events until the timeout.
    let three = output(Command::new(curl).args(["-sSf", &url("/data"), &url("/data"), &url("/xml")]));
    assert_eq!(three.matches("frame").count(), 3, "{three}");
    let events =
        Command::new(curl).args(["-sSN", "--max-time", "1", &url("/v1/events")]).output().expect("it runs");
    assert!(String::from_utf8_lossy(&events.stdout).matches("\ndata: {").count() > 3, "{events:?}");
}

/// Returns the code of the close frame with which `socket` ends.
fn close_code(socket: &mut tungstenite::WebSocket<impl Read + Write>) -> Option<u16> {
    let last = std::iter::from_fn(|| socket.read().ok()).find(|message| matches!(message, Message::Close(_)));
    match last {
        Some(Message::Close(Some(frame))) => Some(frame.code.into()),
        _ => None,
    }
}

/// The codes are those of RFC 6455, sections 5.5.1 and 7.4.1.
#[test]
fn websockets_end_with_the_codes_of_the_standard() {
    let bench = running();
    let url = format!("ws://{}/v1/socket", bench.address());
    let (mut socket, _) = tungstenite::connect(&url).expect("a socket");
    socket.read().expect("a set");
    let normal = tungstenite::protocol::CloseFrame { code: 1000.into(), reason: "".into() };
    socket.close(Some(normal)).expect("a close frame");
    assert_eq!(close_code(&mut socket), Some(1000), "the client's own code");
    let (mut socket, _) = tungstenite::connect(&url).expect("a socket");
    socket.read().expect("a set");
    socket.send(Message::Text("x".repeat(2000).into())).expect("a message");
    assert_eq!(close_code(&mut socket), Some(1009), "a message that is too large");
}

#[test]
fn a_websocket_client_receives_every_set_and_a_close_frame() {
    let bench = running();
    let (mut socket, _) =
        tungstenite::connect(format!("ws://{}/v1/socket?lights=4", bench.address())).expect("a socket");
    let mut frames = Vec::new();
    while frames.len() < 10 {
        match socket.read().expect("a message") {
            Message::Text(text) => {
                let set: Value = serde_json::from_str(&text).expect("JSON");
                assert!(set["lights"].as_array().is_some_and(|l| (1..=4).contains(&l.len())), "{set}");
                frames.push(set["frame"].as_u64().expect("a number"));
            }
            other => panic!("{other:?}"),
        }
        if frames.len() == 5 {
            socket.send(Message::Ping("are you there".into())).expect("a ping");
            socket.send(Message::Text("what we do not listen to".into())).expect("a text");
            loop {
                let message = socket.read().expect("a message");
                if matches!(message, Message::Pong(_)) {
                    break;
                }
            }
        }
    }
    assert!(frames.windows(2).all(|w| w[1] > w[0]), "{frames:?}");
    let metrics = ask(bench.address(), "/metrics", "").body;
    assert!(metrics.contains("hemilux_streams 1\n"), "{metrics}");
    let (mut bytes, _) =
        tungstenite::connect(format!("ws://{}/v1/socket?format=binary", bench.address())).expect("a socket");
    assert!(
        matches!(bytes.read().expect("a message"), Message::Binary(b) if b.starts_with(b"HMLX")),
        "binary"
    );
    drop(bytes);
    let mut events = TcpStream::connect(bench.address()).expect("a connection");
    write!(events, "GET /v1/events HTTP/1.1\r\nHost: {}\r\n\r\n", bench.address()).expect("a request");
    assert!(events.read(&mut [0; 4096]).expect("events") > 0, "events arrive");
    let began = Instant::now();
    bench.running.stop();
    assert!(began.elapsed() < Duration::from_secs(2), "no connection had to be closed by force");
    let farewell = std::iter::from_fn(|| socket.read().ok()).find(|m| matches!(m, Message::Close(_)));
    assert!(farewell.is_some(), "a close frame");
    let mut rest = Vec::new();
    events.read_to_end(&mut rest).expect("an end");
    assert!(rest.ends_with(b"\r\n0\r\n\r\n"), "the event stream ends with a complete chunk");
}

#[test]
fn large_messages_of_a_websocket_client_end_its_connection_alone() {
    let bench = running();
    let connect = || tungstenite::connect(format!("ws://{}/v1/socket", bench.address())).expect("a socket").0;
    let (mut greedy, mut other) = (connect(), connect());
    let _ = greedy.send(Message::Text("a".repeat(1 << 20).into()));
    let ended = std::iter::from_fn(|| greedy.read().ok()).take(1000).filter(|m| !m.is_close()).count();
    assert!(ended < 1000, "the connection was closed");
    assert!(other.read().is_ok_and(|m| m.is_text()), "the other connection continues");
}

#[test]
fn prometheus_reads_the_metrics() {
    let bench = running();
    for _ in 0..5 {
        ask(bench.address(), "/data", "");
    }
    let page = ask(bench.address(), "/metrics", "").body;
    let scrape = prometheus_parse::Scrape::parse(page.lines().map(|l| Ok(l.to_owned()))).expect("metrics");
    let lines = page.lines().filter(|l| !l.starts_with('#')).count();
    let value = |name: &str, label: (&str, &str)| {
        let found = scrape
            .samples
            .iter()
            .find(|s| s.metric == name && (label.0.is_empty() || s.labels.get(label.0) == Some(label.1)));
        found.map(|s| s.value.clone()).unwrap_or_else(|| panic!("no {name} in {page}"))
    };
    use prometheus_parse::Value::{Counter, Gauge, Histogram};
    assert!(matches!(value("hemilux_requests_total", ("path", "/data")), Counter(n) if n == 5.0), "{page}");
    assert!(matches!(value("hemilux_lights", ("", "")), Gauge(n) if n > 0.0), "{page}");
    let Histogram(buckets) = value("hemilux_delivery_seconds", ("", "")) else { panic!("{page}") };
    assert!(buckets.windows(2).all(|w| w[1].count >= w[0].count), "{buckets:?}");
    assert_eq!(buckets.last().map(|b| b.count), Some(5.0), "{buckets:?}");
    // A histogram is one sample of several lines.
    assert!(
        scrape.samples.len() + buckets.len() >= lines,
        "{} samples of {lines} lines",
        scrape.samples.len()
    );
}

#[test]
fn validators_accept_the_xml() {
    let bench = running();
    let xml = ask(bench.address(), "/xml", "").body;
    let document = roxmltree::Document::parse(&xml).expect("XML");
    assert!(
        document.root_element().children().all(|l| l.has_tag_name("light") && l.attribute("id").is_some()),
        "{xml}"
    );
    let Some(python) = tool(&["python3"]) else { return };
    let script =
        "import sys, xml.etree.ElementTree as t; r = t.fromstring(sys.argv[1]); print(r.tag, len(r))";
    let found = output(Command::new(python).args(["-c", script, &xml]));
    assert_eq!(found.trim(), format!("lights {}", document.root_element().children().count()), "expat");
}

#[test]
fn the_python_script_prints_lights() {
    let Some(python) = tool(&["python3"]) else { return };
    let bench = running();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../board/examples/lights.py");
    let text = output(Command::new(python).args([script, &format!("http://{}", bench.address()), "5"]));
    assert_eq!(text.lines().filter(|l| l.starts_with("frame ")).count(), 5, "{text}");
    assert!(text.lines().filter(|l| l.contains("towards")).count() >= 5, "{text}");
}

#[test]
fn the_rust_client_receives_every_frame_and_reconnects_to_a_new_server() {
    let bench = running();
    let (tell, told) = channel();
    let wishes = Wishes {
        lights: Some(6),
        coordinates: Coordinates::YUp,
        ..Wishes::new(&format!("http://{}", bench.address()))
    };
    let client = Client::connect_with(&wishes, move |set| drop(tell.send((set.run.clone(), set.frame))))
        .expect("a client");
    let set = client.next(Duration::from_secs(10)).expect("a set");
    assert!(set.coordinates == Coordinates::YUp && (1..=6).contains(&set.lights.len()), "{set:?}");
    let frames: Vec<_> =
        (0..20).map(|_| told.recv_timeout(Duration::from_secs(10)).expect("a signal")).collect();
    assert!(frames.windows(2).all(|w| w[1].1 > w[0].1), "{frames:?}");
    let sum = |lights: &[hemilux::client::Light]| lights.iter().map(|l| l.irradiance[1]).sum::<f32>();
    let mut lights = Vec::new();
    client.interpolated(Instant::now() + Duration::from_secs(5), &mut lights);
    let newest = sum(&client.latest().expect("a set").lights);
    assert!((sum(&lights) / newest - 1.0).abs() < 0.5, "{} {newest}", sum(&lights));
    assert_eq!(client.state(), State::Live, "live");
    // The server stops and another starts at the same address: another run, whose frame numbers restart.
    let (address, run) = (bench.address(), set.run.clone());
    bench.running.stop();
    let lost = Instant::now();
    while !matches!(client.state(), State::Lost(_)) {
        assert!(lost.elapsed() < Duration::from_secs(10), "{:?}", client.state());
        std::thread::sleep(Duration::from_millis(10));
    }
    let _again = Bench::at(address, EVERY);
    let next =
        std::iter::from_fn(|| told.recv_timeout(Duration::from_secs(20)).ok()).find(|(r, _)| *r != run);
    assert!(next.is_some(), "the client found the new server");
}

#[test]
fn the_rust_client_repeats_a_request_without_an_answer() {
    let silent = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = silent.local_addr().expect("an address");
    let wishes = Wishes { timeout: Duration::from_millis(200), ..Wishes::new(&format!("http://{address}/")) };
    let client = Client::connect(&wishes).expect("a client");
    let held: Vec<_> = (0..3).map(|_| silent.accept().expect("another try").0).collect();
    assert_eq!((held.len(), client.latest()), (3, None), "three tries");
    for url in ["", "127.0.0.1:8080", "https://x", "http://", "http://x/y"] {
        assert!(Client::connect(&Wishes::new(url)).is_err(), "{url}");
    }
}

#[test]
fn the_rust_client_reports_a_stopped_source() {
    let bench = Bench::new(Limits::default());
    bench.frame();
    let client = Client::connect(&Wishes::new(&format!("http://{}", bench.address()))).expect("a client");
    bench.frame();
    bench.step(Step::Fail("unplugged"));
    let began = Instant::now();
    while client.state() != State::Stale("unplugged".into()) {
        assert!(began.elapsed() < Duration::from_secs(10), "{:?}", client.state());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The script of the page: follows a plain EventSource, then the module, and sends the received frames.
const PAGE: &str = r#"<!DOCTYPE html><script type="module">
const tell = text => fetch("/result", { method: "POST", body: text });
try {
  const base = "http://PROBE";
  const frames = await new Promise((done, failed) => {
    const seen = [], source = new EventSource(base + "/v1/events?lights=5");
    source.onerror = () => failed(new Error("no events"));
    source.onmessage = event => {
      seen.push(JSON.parse(event.data).frame);
      if (seen.length === 6) { source.close(); done(seen); }
    };
  });
  const { Hemilux } = await import(base + "/client.js");
  const { ProbeLights } = await import(base + "/three.js");
  const probe = new Hemilux(base, { coordinates: "three", lights: 5 });
  let sets = 0;
  await new Promise(done => probe.addEventListener("set", () => { if (++sets === 8) done(); }));
  const between = probe.interpolated(performance.now());
  const unit = between.every(light => Math.abs(Math.hypot(...light.direction) - 1) < 1e-3);
  const { state, latest } = probe;
  probe.close();
  let refused = "";
  await fetch(base.replace("127.0.0.1", "localhost") + "/v1/config", { method: "PATCH", body: "{}" }).then(a => { refused = a.status; });
  tell(JSON.stringify({ frames, sets, state, lights: latest.lights.length, axes: latest.coordinates, between: between.length, unit,
    adapter: typeof ProbeLights, refused }));
} catch (error) { tell(JSON.stringify({ error: String(error) })); }
</script>"#;

#[test]
fn a_browser_follows_events_and_our_module() {
    let Some(browser) = tool(&["chromium", "chromium-browser", "google-chrome"]) else { return };
    let site = TcpListener::bind("127.0.0.1:0").expect("a port");
    let home = format!("http://{}", site.local_addr().expect("an address"));
    let bench = Bench::running(
        EVERY,
        Limits::default(),
        Options { origins: vec![home.clone()], ..Options::default() },
    );
    bench.wait();
    let profile = tempfile::tempdir().expect("a folder");
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("{home}/"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs");
    let page = PAGE.replace("PROBE", &bench.address().to_string());
    let (tell, told) = channel();
    std::thread::spawn(move || {
        for stream in site.incoming().flatten() {
            if let Some(result) = serve(stream, &page) {
                let _ = tell.send(result);
            }
        }
    });
    let result = told.recv_timeout(Duration::from_secs(90));
    let _ = child.kill();
    let _ = child.wait();
    let seen: Value = serde_json::from_str(&result.expect("the page told what it saw")).expect("JSON");
    assert!(seen.get("error").is_none(), "{seen}");
    let frames: Vec<_> =
        seen["frames"].as_array().expect("frames").iter().filter_map(Value::as_u64).collect();
    assert!(frames.len() == 6 && frames.windows(2).all(|w| w[1] > w[0]), "{seen}");
    assert_eq!(
        (&seen["state"], &seen["axes"], &seen["unit"]),
        (&"live".into(), &"y-up".into(), &true.into()),
        "{seen}"
    );
    assert!((1..=5).contains(&seen["lights"].as_u64().expect("a number")), "{seen}");
    assert_eq!(
        (&seen["adapter"], &seen["refused"]),
        (&"function".into(), &200.into()),
        "an allowed origin may change: {seen}"
    );
}

/// Answers a request for the page, or returns the results that it sends.
fn serve(stream: TcpStream, page: &str) -> Option<String> {
    stream.set_read_timeout(Some(Duration::from_secs(5))).ok()?;
    let mut reader = BufReader::new(stream);
    let (mut first, mut length) = (String::new(), 0);
    reader.read_line(&mut first).ok()?;
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok()?;
        if let Some(n) = line.to_ascii_lowercase().strip_prefix("content-length:") {
            length = n.trim().parse().ok()?;
        }
        if line.trim().is_empty() {
            break;
        }
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).ok()?;
    let head = format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        page.len()
    );
    reader.get_mut().write_all((head + page).as_bytes()).ok()?;
    first.starts_with("POST /result").then(|| String::from_utf8(body).ok())?
}
