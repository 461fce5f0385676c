//! The soak test as a program.
#![cfg(all(target_os = "linux", target_env = "gnu"))]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn the_soak_runs_as_the_service_without_caches_of_threads() {
    let mut soak = Command::new(env!("CARGO_BIN_EXE_hemilux-sim"))
        .args(["soak", "--hours", "1"])
        .env("GLIBC_TUNABLES", "glibc.malloc.perturb=0")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command runs");
    // glibc writes a zero byte in place of the colon between two options.
    let expected = "glibc.malloc.tcache_count=0";
    let environment = || std::fs::read(format!("/proc/{}/environ", soak.id())).unwrap_or_default();
    let is_set = || environment().split(|byte| *byte == 0).any(|entry| entry.ends_with(expected.as_bytes()));
    let began = Instant::now();
    while !is_set() && began.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let was_set = is_set();
    soak.kill().expect("the soak runs until it is killed");
    soak.wait().expect("the soak ends");
    assert!(was_set, "expected {expected} in the environment of the soak");
}
