//! `hemilux discover`: lists the probes on the network.

use super::{Failure, say};
use crate::announce::{self, Found};
use clap::Args;
use std::time::Duration;

#[derive(Clone, Copy, Debug, Args)]
pub(super) struct Discover {
    /// Time to wait for answers, seconds.
    #[arg(long, value_name = "S", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=60))]
    seconds: u64,
    /// Write the result as JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(options: Discover) -> Result<(), Failure> {
    let found = announce::browse(Duration::from_secs(options.seconds));
    let found =
        found.map_err(|e| Failure::new(format!("discover: found {e}, expected a network with multicast")))?;
    if found.is_empty() {
        return Err(Failure::new(format!(
            "discover: found no probe within {} s, expected one that was started with --announce",
            options.seconds
        )));
    }
    if options.json {
        let json = serde_json::to_string(&found);
        return say(&(json.map_err(|e| Failure::new(format!("discover: found {e}, expected JSON")))? + "\n"));
    }
    say(&found.iter().map(line).collect::<String>())
}

fn line(found: &Found) -> String {
    format!("{:<24} {}  hemilux {}\n", found.name, found.urls.join(" "), found.version)
}
