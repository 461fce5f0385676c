//! The server behind nginx and Caddy, which terminate TLS and forward requests with the address of the client.
//!
//! If a program is missing, the test prints its name and is skipped; with `HEMILUX_RIG=1` it fails for nginx, openssl, curl and the browser.

mod bench;

use bench::{Bench, SECRET, ask, browser, connect_from, with_token};
use hemilux::server::{Access, Limits, Options};
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const EVERY: Duration = Duration::from_millis(100);

/// A proxy with an address for HTTPS and one for HTTP; dropping it stops the proxy.
struct Proxy {
    child: Child,
    https: u16,
    http: u16,
    _folder: tempfile::TempDir,
}

impl Drop for Proxy {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn runs(name: &str, argument: &str) -> bool {
    Command::new(name)
        .arg(argument)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success())
}

fn skipped(missing: &str) {
    assert!(std::env::var("HEMILUX_RIG").is_err(), "no {missing}, and HEMILUX_RIG demands it");
    println!("skipped: no {missing}");
}

/// Returns a port that is not in use.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port()
}

/// Writes a self-signed certificate to `folder`.
fn certify(folder: &Path) -> bool {
    let arguments = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=probe.lan -keyout key.pem -out cert.pem";
    let status =
        Command::new("openssl").args(arguments.split(' ')).current_dir(folder).stderr(Stdio::null()).status();
    status.is_ok_and(|s| s.success())
}

/// Starts `program` with the configuration that `configure` returns for the folder and the ports for HTTPS and HTTP.
fn start(
    program: &str,
    arguments: &[&str],
    configure: impl FnOnce(&Path, u16, u16) -> String,
) -> Option<Proxy> {
    let folder = tempfile::tempdir().expect("a folder");
    if !certify(folder.path()) {
        skipped("openssl");
        return None;
    }
    let (https, http) = (free_port(), free_port());
    let configuration = folder.path().join("proxy.conf");
    std::fs::write(&configuration, configure(folder.path(), https, http)).expect("a file");
    let mut command = Command::new(program);
    command.args(arguments).arg(&configuration).env("HOME", folder.path());
    let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    let proxy = Proxy { child, https, http, _folder: folder };
    let began = Instant::now();
    while [https, http].iter().any(|port| TcpStream::connect((Ipv4Addr::LOCALHOST, *port)).is_err()) {
        assert!(began.elapsed() < Duration::from_secs(20), "{program} does not listen");
        sleep(Duration::from_millis(20));
    }
    Some(proxy)
}

fn nginx(probe: SocketAddr) -> Option<Proxy> {
    if !runs("nginx", "-v") {
        skipped("nginx");
        return None;
    }
    start("nginx", &["-c"], |folder, https, http| {
        let folder = folder.display();
        let mut text = format!(
            "daemon off; pid {folder}/pid; error_log {folder}/errors;\nevents {{ worker_connections 1024; }}\nhttp {{\n"
        );
        for kind in ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"] {
            let _ = writeln!(text, "  {kind}_temp_path {folder}/{kind};");
        }
        // The settings that the README recommends.
        let _ = write!(
            text,
            "  access_log off;
  map $http_upgrade $connection_upgrade {{ default upgrade; '' close; }}
  server {{
    listen 127.0.0.1:{https} ssl;
    listen 127.0.0.1:{http};
    ssl_certificate {folder}/cert.pem;
    ssl_certificate_key {folder}/key.pem;
    location / {{
      proxy_pass http://{probe};
      proxy_http_version 1.1;
      proxy_set_header Host $http_host;
      proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for;
      proxy_set_header X-Forwarded-Proto $scheme;
      proxy_set_header Forwarded '';
      proxy_set_header Upgrade $http_upgrade;
      proxy_set_header Connection $connection_upgrade;
    }}
  }}
}}
"
        );
        text
    })
}

fn caddy(probe: SocketAddr) -> Option<Proxy> {
    if !runs("caddy", "version") {
        println!("skipped: no caddy");
        return None;
    }
    start("caddy", &["run", "--adapter", "caddyfile", "--config"], |folder, https, http| {
        let folder = folder.display();
        format!(
            "{{
  admin off
  auto_https off
}}
https://:{https} {{
  tls {folder}/cert.pem {folder}/key.pem
  reverse_proxy {probe} {{
    header_up -Forwarded
  }}
}}
http://:{http} {{
  reverse_proxy {probe} {{
    header_up -Forwarded
  }}
}}
"
        )
    })
}

fn bench(access: Access, limits: Limits) -> Bench {
    let proxies = vec![Ipv4Addr::LOCALHOST.into()];
    let bench = Bench::running(EVERY, limits, Options { access, proxies, ..Options::default() });
    bench.wait();
    bench
}

/// Returns the head of curl's answer, without checks of the certificate.
fn curl(url: &str, arguments: &[&str]) -> String {
    let output = Command::new("curl")
        .args(["-s", "-k", "-D", "-", "-o", "/dev/null", "-m", "20"])
        .args(arguments)
        .arg(url)
        .output();
    String::from_utf8_lossy(&output.expect("curl runs").stdout).to_ascii_lowercase()
}

/// Checks that a page of the proxy's origin may read and change, that its log-in sets a cookie for HTTPS only, and that other origins may not.
fn check_origins(proxy: &Proxy, name: &str) {
    let base = format!("https://127.0.0.1:{}", proxy.https);
    let own = format!("Origin: {base}");
    let login = format!("{base}/login");
    let head = curl(&login, &["-H", &own, "-d", &format!("token={SECRET}")]);
    assert!(head.contains(" 303") && head.contains("; secure"), "{name}: {head}");
    let cookie =
        head.lines().find_map(|l| l.strip_prefix("set-cookie: ")?.split(';').next()).map(str::to_owned);
    assert!(cookie.is_some(), "{name}: {head}");
    let bearer = format!("Authorization: Bearer {SECRET}");
    let change = |origin: &str| {
        let body = ["-X", "PATCH", "-d", "{\"lights\":16}", "-H", &bearer, "-H", origin];
        curl(&format!("{base}/v1/config"), &body)
    };
    assert!(change(&own).contains(" 200"), "{name}: its own page");
    assert!(change("Origin: https://evil.example").contains(" 403"), "{name}: another");
    let plain = format!("Origin: http://127.0.0.1:{}", proxy.https);
    assert!(change(&plain).contains(" 403"), "{name}: the same name without TLS");
    let referer = format!("Referer: {base}/");
    let picture = curl(&format!("{base}/v1/map.png"), &["-H", &bearer, "-H", &referer]);
    assert!(picture.contains(" 200"), "{name}: a picture of its page: {picture}");
}

/// Opens an event stream through the proxy from the client address `from`.
fn stream(proxy: &Proxy, from: [u8; 4]) -> TcpStream {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, proxy.http));
    let mut stream = connect_from(from, address).expect("a connection");
    // The client sends a forged address.
    let request =
        format!("GET /v1/events HTTP/1.1\r\nHost: {address}\r\nX-Forwarded-For: 127.0.77.77\r\n\r\n");
    stream.write_all(request.as_bytes()).expect("a request");
    let mut head = [0; 512];
    let count = stream.read(&mut head).expect("an answer");
    let head = String::from_utf8_lossy(&head[..count]).into_owned();
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    stream
}

/// Returns whether the event stream continues for 600 ms.
fn goes_on(mut stream: &TcpStream) -> bool {
    let mut bytes = [0; 1 << 16];
    let began = Instant::now();
    // Bytes that arrived before are read first.
    while began.elapsed() < Duration::from_millis(600) {
        if !matches!(stream.read(&mut bytes), Ok(1..)) {
            return false;
        }
    }
    true
}

/// Checks that each of a hundred clients of one proxy has its own connection limit.
fn check_limits_per_client(bench: &Bench, proxy: &Proxy, name: &str) {
    let streams: Vec<_> = (1..=100).map(|i| stream(proxy, [127, 0, 3, i])).collect();
    let open = ask(bench.address(), "/v1/status", "").json()["streams"].as_u64();
    assert_eq!(open, Some(100), "{name}: all are served");
    let second = stream(proxy, [127, 0, 3, 7]);
    assert!(!goes_on(&streams[6]), "{name}: a second stream of a client ends its first");
    assert!(goes_on(&streams[7]) && goes_on(&second), "{name}: streams of other clients continue");
}

/// Checks origins and connection limits of a probe behind the proxy that `start` runs.
fn check_origins_and_limits_behind(name: &str, start: impl FnOnce(SocketAddr) -> Option<Proxy>) {
    let bench = bench(with_token(), Limits { per_address: 1, ..Limits::default() });
    let Some(proxy) = start(bench.address()) else { return };
    check_origins(&proxy, name);
    check_limits_per_client(&bench, &proxy, name);
}

#[test]
fn behind_nginx_own_pages_are_accepted_and_clients_have_separate_limits() {
    check_origins_and_limits_behind("nginx", nginx);
}

#[test]
fn behind_caddy_own_pages_are_accepted_and_clients_have_separate_limits() {
    check_origins_and_limits_behind("Caddy", caddy);
}

#[test]
fn the_page_works_over_https_with_its_log_in() {
    let Some((program, folder)) = browser::tools() else { return };
    let bench = bench(with_token(), Limits::default());
    let Some(proxy) = nginx(bench.address()) else { return };
    let url = format!("https://127.0.0.1:{}/", proxy.https);
    let output = browser::scenario("login", &url, SECRET, program, &folder).stdin(Stdio::null()).output();
    let told = String::from_utf8_lossy(&output.expect("node runs").stdout).into_owned();
    assert_eq!(told.lines().last(), Some("passed"), "{told}");
}

#[test]
fn forwarded_headers_are_ignored_without_a_trusted_proxy() {
    let bench = Bench::running(EVERY, Limits::default(), Options::default());
    bench.wait();
    let address = bench.address();
    let forwarded = format!(
        "X-Forwarded-Proto: https\r\nForwarded: for=192.0.2.1;proto=https\r\nOrigin: https://{address}\r\n"
    );
    assert_eq!(ask(address, "/v1/map.png", &forwarded).status, 403, "the scheme of the origin differs");
    let own = format!("X-Forwarded-Proto: https\r\nOrigin: http://{address}\r\n");
    assert_eq!(ask(address, "/v1/map.png", &own).status, 200, "the header is ignored");
}
