//! Chromium without a window, driven by the scenarios of `tests/page/run.mjs`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Returns the browser and the folder with the modules; prints the name of the missing tool and returns `None` if there is none.
pub fn tools() -> Option<(&'static str, PathBuf)> {
    let runs = |name: &str| {
        Command::new(name).arg("--version").stdin(Stdio::null()).output().is_ok_and(|o| o.status.success())
    };
    let browser = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| runs(name));
    let node = std::env::var_os("HEMILUX_NODE").map(PathBuf::from);
    let has =
        |f: &PathBuf| ["playwright-core", "axe-core"].iter().all(|m| f.join("node_modules").join(m).is_dir());
    let missing = match (browser, node.filter(has)) {
        (Some(browser), Some(folder)) if runs("node") => return Some((browser, folder)),
        (None, _) => "chromium",
        (_, None) => "HEMILUX_NODE, a folder with node_modules/playwright-core and axe-core",
        _ => "node",
    };
    assert!(std::env::var("HEMILUX_RIG").is_err(), "no {missing}, and HEMILUX_RIG demands it");
    println!("skipped: no {missing}");
    None
}

/// Returns the command that runs a scenario at `url`.
pub fn scenario(name: &str, url: &str, token: &str, browser: &str, folder: &Path) -> Command {
    let mut node = Command::new("node");
    node.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/page/run.mjs")).args([name, url, token]);
    node.env("HEMILUX_NODE", folder).env("HEMILUX_BROWSER", browser);
    node
}
