//! Tests of the program as a process: start, first line of output, answers and end.

#![cfg(feature = "server")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

fn hemilux(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hemilux"));
    command.args(arguments).env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

/// Runs a command that must end by itself; returns exit status, stdout and stderr.
fn ended(arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = hemilux(arguments).output().expect("the program runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    (status.code(), text(stdout), text(stderr))
}

/// Starts a probe; returns the process, its first line on stdout and the rest of stdout.
fn serving(arguments: &[&str]) -> (Child, String, BufReader<std::process::ChildStdout>) {
    let mut child =
        hemilux(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
    let mut stdout = BufReader::new(child.stdout.take().expect("a pipe"));
    let mut line = String::new();
    stdout.read_line(&mut line).expect("a line");
    (child, line, stdout)
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").arg(name).arg(child.id().to_string()).status();
    assert!(sent.is_ok_and(|s| s.success()), "kill {name}");
}

#[test]
fn the_program_prints_its_address_serves_and_ends_with_status_0() {
    for name in ["-TERM", "-INT"] {
        let (mut child, line, _stdout) =
            serving(&["serve", "--listen", "127.0.0.1:0", "--lights", "32", "--sampler", "pharr"]);
        let address = line.strip_prefix("hemilux: serving http://").and_then(|l| l.split_once("/ "));
        let (address, what) = address.unwrap_or_else(|| panic!("{line}"));
        assert_eq!(what, "(scene:room, pharr, 32 lights)\n", "{line}");
        let mut stream = TcpStream::connect(address).expect("a connection");
        write!(stream, "GET /data HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")
            .expect("a request");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("an answer");
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("# sampler pharr"), "{answer}");
        signal(&child, name);
        let began = Instant::now();
        let status = child.wait().expect("it ends");
        assert!(began.elapsed() < Duration::from_secs(4), "in time");
        let mut errors = String::new();
        child.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("UTF-8");
        assert_eq!(status.code(), Some(0), "{name}: {errors}");
        let (head, rest) = errors.split_once('\n').unwrap_or_default();
        assert!(head.starts_with("ms") && head.ends_with("budget      over"), "{name}: {errors}");
        let stages: Vec<_> = rest.lines().filter_map(|line| line.split_whitespace().next()).collect();
        let expected = ["capture", "front", "pyramid", "sample", "filter", "encode", "total"];
        assert!(stages.starts_with(&expected) && rest.ends_with(" frames\n"), "{name}: {errors}");
    }
}

/// Sends a request with `headers` and returns the first line of the answer.
fn ask(address: &str, request: &str, headers: &str) -> String {
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "{request} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n")
        .expect("a request");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("an answer");
    String::from_utf8_lossy(&answer).lines().next().unwrap_or_default().to_owned()
}

#[test]
fn a_form_too_long_for_memory_is_refused_with_the_number_of_lights_that_fits() {
    let (mut child, line, _stdout) = serving(&["--listen", "127.0.0.1:0", "--lights", "50000"]);
    let address = line.split("http://").nth(1).and_then(|l| l.split('/').next()).expect("an address");
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "GET /v1/lights?format=usda HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")
        .expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let expected =
        "50000 lights are too many for this form, which may have 27952: add lights=27952, or format=binary\n";
    assert!(answer.starts_with("HTTP/1.1 400") && answer.ends_with(expected), "{answer}");
    for form in ["json", "xml", "text", "binary", "csv", "rad", "usda&lights=27952"] {
        let first = ask(address, &format!("GET /v1/lights?format={form}"), "");
        assert_eq!(first, "HTTP/1.1 200 OK", "{form}");
    }
    child.kill().expect("it runs");
    child.wait().expect("it ends");
}

#[test]
fn beyond_loopback_a_token_is_created_kept_and_required() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("hemilux.toml");
    std::fs::write(&config, "listen = \"0.0.0.0:0\"\ntoken_file = \"secret\"\nlights = 20\n")
        .expect("a file");
    for run in 0..2 {
        let (mut child, line, _stdout) =
            serving(&["--config", config.to_str().expect("a path"), "--sampler", "pharr"]);
        assert!(line.ends_with("(scene:room, pharr, 20 lights)\n"), "{line}");
        let port = line.split("http://127.0.0.1:").nth(1).and_then(|l| l.split('/').next()).expect("a port");
        let address = format!("127.0.0.1:{port}");
        let token = std::fs::read_to_string(folder.path().join("secret")).expect("a token");
        let bearer = format!("Authorization: Bearer {}\r\n", token.trim());
        assert!(ask(&address, "GET /change?samples=30", "").contains(" 401 "), "without");
        assert!(ask(&address, "GET /change?samples=30", &bearer).contains(" 200 "), "with");
        assert!(ask(&address, "GET /v1/lights", "").contains(" 200 "), "lights are for all");
        signal(&child, "-TERM");
        child.wait().expect("it ends");
        let mut errors = String::new();
        child.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("UTF-8");
        assert!(!errors.contains(token.trim()), "the token is nowhere in the log");
        assert_eq!(errors.matches("made a token in").count(), usize::from(run == 0), "{errors}");
    }
}

#[test]
fn errors_are_one_line_with_the_exit_status_of_their_kind() {
    let holder = TcpListener::bind("127.0.0.1:0").expect("a port");
    let taken = holder.local_addr().expect("an address").to_string();
    let empty = tempfile::tempdir().expect("a folder");
    let replay = format!("replay:{}", empty.path().display());
    let readable = empty.path().join("token");
    std::fs::write(&readable, "0123456789abcdef\n").expect("a file");
    std::fs::set_permissions(&readable, std::os::unix::fs::PermissionsExt::from_mode(0o644))
        .expect("permissions");
    let readable = readable.to_str().expect("a path");
    let config = empty.path().join("hemilux.toml");
    std::fs::write(&config, "lights = -1\n").expect("a file");
    let config = config.to_str().expect("a path");
    let cases: [(&[&str], i32, &str); 12] = [
        (&["--listen", "0.0.0.0:0", "--token-file", readable], 1, "permissions 0644, expected 0600"),
        (&["--listen", "0.0.0.0:0", "--open", "--token-file", readable], 2, "--token-file"),
        (&["--listen", "[::]:0"], 2, "--token-file FILE"),
        (&["--config", config], 2, "lights: found -1, expected a whole number"),
        (&["--config", "/nonexistent/hemilux.toml"], 1, "/nonexistent/hemilux.toml"),
        (&["--allow-origin", "localhost"], 2, "--allow-origin"),
        (&["--frobnicate"], 2, "--frobnicate"),
        (&["--lights", "0"], 2, "1 to 50000"),
        (&["--source", "webcam"], 2, "env:PATH or replay:DIR"),
        (&["--listen", "0.0.0.0:8080"], 2, "--open"),
        (&["--listen", &taken], 1, "--listen 127.0.0.1:0"),
        (&["--source", &replay], 1, "burst.toml"),
    ];
    for (arguments, status, part) in cases {
        let (code, stdout, stderr) = ended(arguments);
        assert_eq!((code, stdout.as_str()), (Some(status), ""), "{arguments:?}: {stderr}");
        assert!(stderr.starts_with("hemilux: ") && stderr.contains(part), "{arguments:?}: {stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{arguments:?}: {stderr}");
    }
}

#[test]
fn a_refused_configuration_ends_with_the_status_after_which_the_service_is_not_restarted() {
    let unit = include_str!("../debian/hemilux.service");
    let status = unit.lines().find_map(|line| line.strip_prefix("RestartPreventExitStatus="));
    let status: i32 = status.and_then(|s| s.parse().ok()).expect("a status");
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("hemilux.toml");
    let cases = [
        ("a_key_of_another_version = 1\n", "found 'a_key_of_another_version', expected one of"),
        ("sampler = \"of another version\"\n", "sampler: found"),
        ("order = 99\n", "order: found"),
        ("source = \"another:version\"\n", "source: "),
        ("lights = [\n", "line "),
    ];
    let long = format!("# {}\n", "x".repeat(64 << 10));
    for (text, part) in cases.into_iter().chain([(long.as_str(), "65536 bytes")]) {
        std::fs::write(&config, text).expect("a file");
        let (code, _, stderr) = ended(&["--config", config.to_str().expect("a path")]);
        assert_eq!((code, stderr.lines().count()), (Some(status), 1), "{stderr}");
        assert!(stderr.contains("hemilux.toml") && stderr.contains(part), "{stderr}");
    }
}

#[test]
fn the_plan_and_the_help_go_to_stdout() {
    let (code, stdout, stderr) = ended(&["--plan", "--lights", "12001"]);
    assert_eq!((code, stderr.as_str()), (Some(0), ""), "--plan");
    assert!(stdout.contains("map order         7") && stdout.contains("sum, bytes"), "{stdout}");
    let (code, stdout, _) = ended(&["--help"]);
    assert!(code == Some(0) && stdout.contains("Examples:"), "{stdout}");
    assert_eq!(ended(&["--version"]).0, Some(0), "--version");
}

#[test]
fn misspelt_words_are_refused_with_the_most_similar_ones() {
    let cases: [(&[&str], &str); 6] = [
        (&["--lisen", "127.0.0.1:0"], "'--listen'"),
        (&["serv"], "'serve'"),
        (&["calibrate", "len"], "'lens'"),
        (&["--sampler", "adaptve"], "'adaptive'"),
        (&["lens", "convert", "x", "--to", "opencw"], "'opencv'"),
        (&["completions", "bahs"], "'bash'"),
    ];
    for (arguments, right) in cases {
        let (status, stdout, stderr) = ended(arguments);
        assert_eq!((status, stdout.as_str(), stderr.lines().count()), (Some(2), "", 1), "{stderr}");
        assert!(stderr.contains(&format!("did you mean {right}?")), "{arguments:?}: {stderr}");
    }
}

#[test]
fn wrong_peers_are_refused_with_the_expected_form() {
    let cases: [(&[&str], &str); 4] = [
        (&["--osc", "studio"], "HOST:PORT"),
        (&["--osc", "studio:9,lights=0"], "1 to 256"),
        (&["--mqtt", "http://broker"], "mqtt://"),
        (&["--mqtt", "mqtts://broker"], "no TLS"),
    ];
    for (arguments, expected) in cases {
        let (status, stdout, stderr) = ended(arguments);
        assert_eq!((status, stdout.as_str(), stderr.lines().count()), (Some(2), "", 1), "{stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
    }
}

#[test]
fn every_printed_address_answers() {
    let (mut child, line, mut stdout) = serving(&["--listen", "0.0.0.0:0", "--open", "--sampler", "pharr"]);
    assert!(line.starts_with("hemilux: serving http://127.0.0.1:"), "{line}");
    let own = line.split("http://").nth(1).and_then(|l| l.split('/').next()).expect("an address");
    let port = own.rsplit(':').next().expect("a port");
    assert!(ask(own, "GET /openapi.json", "").contains(" 200 "), "{own}");
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    let mut others = String::new();
    stdout.read_to_string(&mut others).expect("UTF-8");
    for other in others.lines() {
        let address = other.strip_prefix("hemilux: from other machines http://");
        let address = address.and_then(|a| a.strip_suffix('/')).unwrap_or_else(|| panic!("{other}"));
        let address: std::net::SocketAddr = address.parse().expect("an address");
        assert_eq!(address.port().to_string(), port);
        assert!(!address.ip().is_unspecified() && !address.ip().is_loopback(), "{other}");
    }
}

#[test]
fn a_saved_setting_survives_a_restart_and_the_log_names_the_change() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("hemilux.toml");
    std::fs::write(&config, "").expect("an empty file, as the service makes");
    let options = ["-v", "--listen", "127.0.0.1:0", "--config", config.to_str().expect("a path")];
    let (mut child, line, _stdout) = serving(&options);
    let address = line.split("http://").nth(1).and_then(|l| l.split('/').next()).expect("an address");
    let mut stream = TcpStream::connect(address).expect("a connection");
    let (head, body) = ("Content-Type: application/json\r\nConnection: close\r\n", r#"{"lights": 21}"#);
    write!(
        stream,
        "PATCH /v1/config?save=1 HTTP/1.1\r\nHost: {address}\r\n{head}Content-Length: {}\r\n\r\n{body}",
        body.len()
    )
    .expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    signal(&child, "-TERM");
    child.wait().expect("it ends");
    let mut log = String::new();
    child.stderr.take().expect("a pipe").read_to_string(&mut log).expect("UTF-8");
    assert!(log.contains("setting lights: 64 becomes 21"), "{log}");
    assert_eq!(std::fs::read_to_string(&config).expect("a file"), "lights = 21\n", "the difference alone");
    let (mut child, line, _stdout) = serving(&options);
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    assert!(line.ends_with("21 lights)\n"), "{line}");
}

#[test]
fn completions_and_man_pages_are_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let (status, script, _) = ended(&["completions", "bash"]);
    assert!(status == Some(0) && script.contains("--trusted-proxy"), "{script}");
    let out = folder.path().to_str().expect("a path");
    assert_eq!(ended(&["man", "--out", out]).0, Some(0), "man");
    let page = std::fs::read_to_string(folder.path().join("hemilux-calibrate-lens.1")).expect("a page");
    assert!(page.contains("\\-\\-residuals"), "{page}");
    let (status, _, stderr) = ended(&["man", "--out", "/nonexistent"]);
    assert_eq!((status, stderr.lines().count()), (Some(1), 1), "{stderr}");
}

/// The camera of the test exists on no machine.
#[cfg(all(feature = "v4l2", target_os = "linux"))]
#[test]
fn cameras_are_listed_and_missing_ones_are_named() {
    let (status, stdout, stderr) = ended(&["devices", "--json"]);
    if status == Some(0) {
        let cameras: serde_json::Value = serde_json::from_str(&stdout).expect("JSON");
        assert!(cameras.is_array(), "{stdout}");
    } else {
        assert_eq!((status, stderr.lines().count()), (Some(1), 1), "{stderr}");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().to_str().expect("UTF-8");
    let camera = "v4l2:/dev/video-nowhere";
    let cases: [(&[&str], i32, &str); 6] = [
        (&["serve", "--plan", "--source", camera], 1, "/dev/video-nowhere: found no camera"),
        (&["devices", "--check", camera], 1, "/dev/video-nowhere: found no camera"),
        (&["devices", "--check", "scene:room"], 2, "expected v4l2:PATH"),
        (
            &["record", "--source", camera, "--bursts", "1", "--out", out],
            1,
            "/dev/video-nowhere: found no camera",
        ),
        (&["record", "--bursts", "0", "--out", out], 2, "--bursts"),
        (&["record", "--bursts", "1", "--out", "/proc/nowhere"], 1, "/proc/nowhere"),
    ];
    for (arguments, expected, named) in cases {
        let (status, stdout, stderr) = ended(arguments);
        assert_eq!(
            (status, stdout.as_str(), stderr.lines().count()),
            (Some(expected), "", 1),
            "{arguments:?}: {stderr}"
        );
        assert!(stderr.contains(named), "{arguments:?}: {stderr}");
    }
    std::fs::write(folder.path().join("x"), "x").expect("a file");
    let (status, _, stderr) = ended(&["record", "--source", camera, "--bursts", "1", "--out", out]);
    assert_eq!((status, stderr.contains("expected an empty folder")), (Some(2), true), "{stderr}");
}

#[cfg(all(feature = "v4l2", target_os = "linux"))]
#[test]
fn an_absent_camera_is_waited_for_and_requests_get_the_reason() {
    let options =
        ["serve", "--listen", "127.0.0.1:0", "--source", "v4l2:/dev/video-nowhere", "--sampler", "pharr"];
    let (mut child, line, _stdout) = serving(&options);
    let address = line.strip_prefix("hemilux: serving http://").and_then(|l| l.split_once("/ "));
    let (address, _) = address.unwrap_or_else(|| panic!("{line}"));
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "GET /v1/lights HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")
        .expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    assert!(
        answer.starts_with("HTTP/1.1 503")
            && answer.contains("no frame yet: /dev/video-nowhere: found no camera"),
        "{answer}"
    );
    signal(&child, "-TERM");
    assert!(child.wait().expect("it ends").success(), "stopped as ever");
    let mut errors = String::new();
    child.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("UTF-8");
    assert_eq!(errors.matches("found no camera").count(), 1, "logged once: {errors}");
}
