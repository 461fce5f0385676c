//! Adds the folder of the linker scripts to the linker's search path.

fn main() {
    println!("cargo:rustc-link-search={}", concat!(env!("CARGO_MANIFEST_DIR"), "/memory"));
    println!("cargo:rerun-if-changed=memory");
}
