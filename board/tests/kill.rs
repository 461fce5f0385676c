//! A probe that is killed while it saves its settings or creates a token, and one whose disk is full.
//!
//! The environment variable `HEMILUX_KILLS` is the number of kills; the whole run has 1000.

#![cfg(feature = "server")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::sleep;
use std::time::Duration;

const COMMENT: &str = "# By hand: the lamp in the hall.";

fn kills() -> u64 {
    std::env::var("HEMILUX_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(50)
}

/// A running probe, which is killed on drop.
struct Running {
    child: Child,
    address: String,
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn probe(folder: &Path) -> Command {
    let mut command = Command::new("sh");
    let program = env!("CARGO_BIN_EXE_hemilux");
    let arguments = "--listen 127.0.0.1:0 --source scene:overcast --config hemilux.toml \"$@\"";
    command.args(["-c", &format!("trap '' XFSZ; ${{LIMIT:-true}}; exec {program} {arguments}"), "sh"]);
    command.current_dir(folder).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

fn start(command: &mut Command) -> Running {
    let mut child = command.spawn().expect("the program runs");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    let address = line.strip_prefix("hemilux: serving http://").and_then(|l| l.split('/').next());
    let address = address.map(str::to_owned);
    let mut running = Running { child, address: String::new() };
    running.address = address.unwrap_or_else(|| panic!("found '{line}', expected an address"));
    running
}

/// Changes the setting `lights` and saves it; returns the answer, if there is one.
fn save(address: &str, lights: u64) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(10))).ok()?;
    let body = format!("{{\"lights\": {lights}}}");
    let head = "PATCH /v1/config?save=1 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
    write!(stream, "{head}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}", body.len())
        .ok()?;
    let mut reply = String::new();
    stream.read_to_string(&mut reply).ok()?;
    Some(reply)
}

/// Returns the setting `lights` in the configuration file; asserts that the file is whole.
fn saved(folder: &Path) -> i64 {
    let text = std::fs::read_to_string(folder.join("hemilux.toml")).expect("a file");
    assert!(text.starts_with(COMMENT) && text.contains("# in lumen"), "comments are kept: {text}");
    let table: toml::Table = text.parse().expect("the file is whole");
    table["lights"].as_integer().expect("a number")
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let text = format!("{COMMENT}\nlights = 20 # in lumen\ntolerance = 0.1\n");
    std::fs::write(folder.path().join("hemilux.toml"), text).expect("a file");
    folder
}

#[test]
fn a_probe_that_is_killed_while_it_saves_leaves_the_old_or_the_new_file() {
    let folder = folder();
    let (mut replies, asked) = (0, AtomicU64::new(20));
    for kill in 0..kills() {
        let mut running = start(&mut probe(folder.path()));
        let (address, over) = (running.address.clone(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            let saving = scope.spawn(|| {
                let mut replies = 0;
                while !over.load(Ordering::Relaxed) {
                    let lights = 21 + asked.fetch_add(1, Ordering::Relaxed) % 40;
                    replies += u64::from(save(&address, lights).is_some_and(|reply| reply.contains(" 200 ")));
                }
                replies
            });
            sleep(Duration::from_micros(20_000 + kill * 7_919 % 130_000));
            running.child.kill().expect("SIGKILL");
            running.child.wait().expect("its end");
            over.store(true, Ordering::Relaxed);
            replies += saving.join().expect("no panic");
        });
        let lights = saved(folder.path());
        assert!((20..=61).contains(&lights), "kill {kill}: {lights} lights");
    }
    let stray = std::fs::read_dir(folder.path()).expect("a folder").count() - 1;
    println!("{} kills, {replies} replies to saves, {stray} files of interrupted saves", kills());
    assert!(replies > kills() / 4, "it was killed while it saved: {replies} replies");
    drop(start(&mut probe(folder.path())));
}

#[test]
fn a_probe_that_is_killed_while_it_creates_a_token_creates_one_at_the_next_start() {
    let folder = folder();
    let token = folder.path().join("token");
    let mut whole = 0;
    for kill in 0..kills() {
        let mut child =
            probe(folder.path()).args(["--token-file", "token"]).spawn().expect("the program runs");
        sleep(Duration::from_micros(kill * 1_013 % 40_000));
        child.kill().expect("SIGKILL");
        child.wait().expect("its end");
        if kill % 5 == 4 {
            drop(start(probe(folder.path()).args(["--token-file", "token"])));
            let text = std::fs::read_to_string(&token).expect("a token");
            let mode = std::fs::metadata(&token).expect("a token").permissions().mode();
            assert!(text.trim().len() >= 16 && mode & 0o077 == 0, "kill {kill}: '{text}', {mode:o}");
            std::fs::remove_file(&token).expect("a token");
            whole += 1;
        }
    }
    assert_eq!(whole, kills() / 5);
}

#[test]
fn on_a_full_disk_saving_fails_and_the_probe_continues() {
    let folder = folder();
    let running = start(probe(folder.path()).env("LIMIT", "ulimit -f 0"));
    let reply = save(&running.address, 33).expect("a reply");
    assert!(reply.contains(" 500 ") && reply.contains("could not be written"), "{reply}");
    assert_eq!(saved(folder.path()), 20, "the file of before");
    let mut stream = TcpStream::connect(&running.address).expect("a connection");
    write!(stream, "GET /v1/config HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        .expect("a request");
    let mut reply = String::new();
    stream.read_to_string(&mut reply).expect("a reply");
    assert!(reply.contains(" 200 ") && reply.contains("\"lights\":33"), "in effect: {reply}");
}
