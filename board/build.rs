//! Says whether the program is built with NEON, which stable Rust does not tell on 32-bit ARM.

use std::env::var;

fn main() {
    let flags = var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let target = var("TARGET").unwrap_or_default();
    let asked = flags.split('\x1f').any(|f| f.contains("target-feature=") && f.contains("+neon"));
    println!("cargo::rustc-check-cfg=cfg(built_with_neon)");
    println!("cargo::rerun-if-changed=build.rs");
    if asked || target.starts_with("thumbv7neon") {
        println!("cargo::rustc-cfg=built_with_neon");
    }
}
