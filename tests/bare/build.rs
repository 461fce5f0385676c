//! Where the linker finds each machine's memory.

fn main() {
    println!("cargo:rustc-link-search={}", concat!(env!("CARGO_MANIFEST_DIR"), "/memory"));
    println!("cargo:rerun-if-changed=memory");
}
