//! Compresses the texts that the HTTP server answers with, and says whether the program is built with NEON, which stable Rust does not tell
//! on 32-bit ARM.

use std::env::var;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    check_neon();
    #[cfg(feature = "server")]
    texts::compress();
}

fn check_neon() {
    let flags = var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let target = var("TARGET").unwrap_or_default();
    let asked = flags.split('\x1f').any(|f| f.contains("target-feature=") && f.contains("+neon"));
    println!("cargo::rustc-check-cfg=cfg(built_with_neon)");
    if asked || target.starts_with("thumbv7neon") {
        println!("cargo::rustc-cfg=built_with_neon");
    }
}

#[cfg(feature = "server")]
mod texts {
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use std::path::{Path, PathBuf};
    use std::{env, fs, io::Write};

    /// The folders of the texts.
    const FOLDERS: [&str; 2] = ["src/server", "src/server/page"];

    /// Writes `NAME.gz` to the output folder of the build for each text `NAME`.
    pub(crate) fn compress() {
        let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
        for folder in FOLDERS {
            println!("cargo::rerun-if-changed={folder}");
            let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{folder}: {e}"));
            let paths = entries.map(|entry| entry.expect("an entry of a folder").path());
            for path in paths.filter(|path| path.is_file() && path.extension().is_none_or(|e| e != "rs")) {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let file = out.join(format!("{name}.gz"));
                fs::write(&file, gzip(&path)).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
            }
        }
    }

    fn gzip(path: &Path) -> Vec<u8> {
        let text = fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&text).and_then(|()| encoder.finish()).expect("compression to memory")
    }
}
