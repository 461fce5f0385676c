//! A probe that is killed while it saves its settings, makes screenshots or creates a token, and one whose disk is full or read-only.
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
    probe_after(folder, &["sh"], "true")
}

/// Returns the command of a probe in `folder`, which the program `shell` starts after the shell command `before`.
fn probe_after(folder: &Path, shell: &[&str], before: &str) -> Command {
    let mut command = Command::new(shell[0]);
    let program = env!("CARGO_BIN_EXE_hemilux");
    let arguments = "--listen 127.0.0.1:0 --source scene:overcast --config hemilux.toml \"$@\"";
    command.args(&shell[1..]).args(["-c", &format!("{before} && exec {program} {arguments}"), "sh"]);
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

/// Sends a request; returns the answer, if there is one.
fn ask(address: &str, request: &str, body: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(10))).ok()?;
    let head = format!("{request} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n");
    write!(stream, "{head}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}", body.len())
        .ok()?;
    let mut reply = String::new();
    stream.read_to_string(&mut reply).ok()?;
    Some(reply)
}

/// Changes the setting `lights` and saves it; returns the answer, if there is one.
fn save(address: &str, lights: u64) -> Option<String> {
    ask(address, "PATCH /v1/config?save=1", &format!("{{\"lights\": {lights}}}"))
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
    let text = format!("{COMMENT}\nlights = 20 # in lumen\ntolerance = 0.1\ngui = true\n");
    std::fs::write(folder.path().join("hemilux.toml"), text).expect("a file");
    folder
}

#[test]
fn a_probe_that_is_killed_while_it_saves_and_makes_screenshots_leaves_the_old_or_the_new_file() {
    let folder = folder();
    let (mut replies, mut pictures, asked) = (0, 0, AtomicU64::new(20));
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
            let looking = scope.spawn(|| {
                let mut pictures = 0;
                while !over.load(Ordering::Relaxed) {
                    let page = ask(&address, "GET /screenshot", "");
                    pictures += u64::from(page.is_some_and(|page| page.contains(" 200 ")));
                }
                pictures
            });
            sleep(Duration::from_micros(20_000 + kill * 7_919 % 230_000));
            running.child.kill().expect("SIGKILL");
            running.child.wait().expect("its end");
            over.store(true, Ordering::Relaxed);
            replies += saving.join().expect("no panic");
            pictures += looking.join().expect("no panic");
        });
        let lights = saved(folder.path());
        assert!((20..=61).contains(&lights), "kill {kill}: {lights} lights");
    }
    let names = std::fs::read_dir(folder.path()).expect("a folder").map(|e| e.expect("an entry").file_name());
    let stray: Vec<_> = names.filter(|name| name != "hemilux.toml").collect();
    let (kills, count) = (kills(), stray.len());
    println!("{kills} kills, {replies} saves, {pictures} screenshots, {count} files of interrupted saves");
    assert!(stray.iter().all(|name| name.to_string_lossy().starts_with(".hemilux-unfinished-")), "{stray:?}");
    assert!(replies > kills / 4, "it was killed while it saved: {replies} replies");
    assert!(pictures > 0, "it made screenshots");
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

/// Asserts that saving fails with one line, and that the probe continues with the unsaved setting.
fn assert_that_saving_fails(folder: &Path, command: &mut Command) {
    let running = start(command);
    let reply = save(&running.address, 33).expect("a reply");
    assert!(reply.contains(" 500 ") && reply.contains("could not be written"), "{reply}");
    assert_eq!(saved(folder), 20, "the file of before");
    let reply = ask(&running.address, "GET /v1/config", "").expect("a reply");
    assert!(reply.contains(" 200 ") && reply.contains("\"lights\":33"), "in effect: {reply}");
    let reply = ask(&running.address, "GET /v1/lights?after=0", "").expect("a reply");
    assert!(reply.contains(" 200 "), "lights: {reply}");
}

#[test]
fn on_a_full_disk_saving_fails_and_the_probe_continues() {
    let folder = folder();
    let mut command = probe_after(folder.path(), &["sh"], "trap '' XFSZ; ulimit -f 0");
    assert_that_saving_fails(folder.path(), &mut command);
}

/// Mounts the folder read-only for the probe alone: permissions do not bind the root user.
#[test]
fn on_a_read_only_disk_saving_fails_and_the_probe_continues() {
    let shell = ["unshare", "-rm", "sh"];
    if !Command::new(shell[0]).args(["-rm", "true"]).status().is_ok_and(|status| status.success()) {
        assert!(
            std::env::var_os("HEMILUX_RIG").is_none(),
            "found no right to mount, expected it in the gate"
        );
        eprintln!("skipped: a read-only disk needs unshare(1) and the right to mount in a user namespace");
        return;
    }
    let folder = folder();
    let mount = "mount --bind . \"$PWD\" && mount -o remount,bind,ro \"$PWD\" && cd \"$PWD\" && ! touch new";
    assert_that_saving_fails(folder.path(), &mut probe_after(folder.path(), &shell, mount));
}
