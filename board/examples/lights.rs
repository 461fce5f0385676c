//! Prints each light set of a probe: `cargo run --example lights --features client -- [http://127.0.0.1:8080] [frames]`.

use hemilux::client::{Client, ClientError, Options};
use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    let shown = show();
    if let Err(error) = &shown {
        eprintln!("lights: {error}");
    }
    if shown.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn show() -> Result<(), ClientError> {
    let mut arguments = std::env::args().skip(1);
    let url = arguments.next().unwrap_or_else(|| "http://127.0.0.1:8080".into());
    let frames = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(usize::MAX);
    let client = Client::connect(&Options { lights: Some(4), ..Options::new(&url) })?;
    let (mut shown, mut told) = (0, None);
    while shown < frames {
        let Some(set) = client.next(Duration::from_secs(2)) else {
            let state = client.state();
            if told.as_ref() != Some(&state) {
                eprintln!("lights: {state:?}");
            }
            told = Some(state);
            continue;
        };
        println!("frame {} of run {}: {} lights", set.frame, set.run, set.lights.len());
        for light in &set.lights {
            let [r, g, b] = light.irradiance;
            println!("  {:6}  towards {:+.3}  irradiance {r:.3} {g:.3} {b:.3}", light.id, light.direction);
        }
        shown += 1;
    }
    Ok(())
}
