//! End of the program, reload of its configuration, and lack of file descriptors.

#![cfg(feature = "server")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// A running probe, which is killed on drop.
struct Process {
    child: Child,
    address: String,
    errors: BufReader<ChildStderr>,
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Process {
    fn start(mut command: Command) -> Self {
        command.env_remove("RUST_LOG").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the program runs");
        let errors = BufReader::new(child.stderr.take().expect("a pipe"));
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
        let address = line.strip_prefix("hemilux: serving http://").and_then(|l| l.split('/').next());
        let address = address.unwrap_or_else(|| panic!("{line}")).to_owned();
        Self { child, address, errors }
    }

    fn with(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hemilux"));
        command.args(["--listen", "127.0.0.1:0"]).args(arguments);
        Self::start(command)
    }

    /// Opens a connection and sends `sent`.
    fn connect(&self, sent: &str) -> TcpStream {
        let mut stream = TcpStream::connect(&self.address).expect("a connection");
        stream.write_all(sent.as_bytes()).expect("a request");
        stream
    }

    fn get(&self, path: &str) -> Option<String> {
        let mut stream = TcpStream::connect(&self.address).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs(10))).ok()?;
        write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        Some(answer)
    }

    fn signal(&self, name: &str) {
        let sent = Command::new("kill").arg(name).arg(self.child.id().to_string()).status();
        assert!(sent.is_ok_and(|s| s.success()), "kill {name}");
    }

    /// Returns the next line on stderr.
    fn error_line(&mut self) -> String {
        let mut line = String::new();
        self.errors.read_line(&mut line).expect("UTF-8");
        line
    }
}

#[test]
fn sigterm_ends_the_program_with_clients_that_neither_read_nor_write() {
    let mut probe = Process::with(&["--lights", "5000"]);
    let request = |path: &str| format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let mut held = vec![
        probe.connect(""),
        probe.connect("GET / HTTP/1.1\r\nHost: loc"),
        probe.connect("POST /change HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\nlights"),
    ];
    for path in ["/v1/events", "/lights.json", "/v1/lights?format=usda", "/capture", "/v1/map.exr"] {
        held.push(probe.connect(&request(path)));
    }
    held.push(probe.connect(
        "GET /v1/ws HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
    ));
    assert!(probe.get("/data").is_some_and(|a| a.starts_with("HTTP/1.1 200")), "it serves");
    probe.signal("-TERM");
    let deadline = Instant::now() + Duration::from_secs(5);
    let status = loop {
        if let Some(status) = probe.child.try_wait().expect("a child") {
            break status;
        }
        assert!(Instant::now() < deadline, "still running five seconds after SIGTERM");
        sleep(Duration::from_millis(20));
    };
    assert_eq!(status.code(), Some(0), "an orderly end");
    drop(held);
}

#[test]
fn sighup_applies_the_configuration_file_and_refuses_a_broken_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("hemilux.toml");
    let write = |text: &str| std::fs::write(&config, text).expect("a file");
    write("lights = 20\n");
    let mut probe = Process::with(&["--config", config.to_str().expect("a path")]);
    let lights = |probe: &Process| {
        let answer = probe.get("/data").unwrap_or_default();
        answer.lines().filter(|line| line.starts_with(|c: char| c == '-' || c.is_ascii_digit())).count()
    };
    assert_eq!(lights(&probe), 20, "as configured");
    write("lights = 33\n");
    probe.signal("-HUP");
    let deadline = Instant::now() + Duration::from_secs(20);
    while lights(&probe) != 33 {
        assert!(Instant::now() < deadline, "not applied");
        sleep(Duration::from_millis(50));
    }
    write("lights = \"many\"\n");
    probe.signal("-HUP");
    let line = probe.error_line();
    assert!(line.contains("hemilux.toml") && line.contains("nothing was changed"), "{line}");
    assert_eq!(lights(&probe), 33, "as before");
}

/// Returns a command for the program under a limit of `descriptors` file descriptors.
fn limited(descriptors: u32) -> Command {
    let mut command = Command::new("sh");
    let script = format!("ulimit -n {descriptors}; exec \"$0\" --listen 127.0.0.1:0 --lights 20");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_hemilux")]);
    command
}

#[test]
fn few_descriptors_mean_few_connections() {
    let mut probe = Process::start(limited(70));
    let held: Vec<_> = (0..90).filter_map(|_| TcpStream::connect(&probe.address).ok()).collect();
    assert!(held.len() > 70, "the kernel accepts more than the program can: {}", held.len());
    let answer = probe.get("/data").unwrap_or_default();
    assert!(answer.starts_with("HTTP/1.1 200"), "served beside silent connections: {answer}");
    drop(held);
    probe.signal("-TERM");
    assert_eq!(probe.child.wait().expect("it ends").code(), Some(0), "an orderly end");
    let mut errors = String::new();
    probe.errors.read_to_string(&mut errors).expect("UTF-8");
    assert!(!errors.contains("panicked"), "{errors}");
}

#[test]
fn too_few_descriptors_are_refused_on_one_line() {
    let output = limited(32).env_remove("RUST_LOG").output().expect("the program runs");
    let errors = String::from_utf8(output.stderr).expect("UTF-8");
    let expected =
        "hemilux: the server: found a limit of 32 file descriptors, expected more than 64 (ulimit -n)\n";
    assert_eq!((output.status.code(), errors.as_str()), (Some(1), expected));
}
