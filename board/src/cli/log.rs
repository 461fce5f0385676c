//! Level of the log on stderr.

use clap::{ArgAction, Args};
use std::io::IsTerminal;
use tracing::Level;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

#[derive(Clone, Copy, Debug, Args)]
pub(super) struct LogOptions {
    /// Log more on stderr: changes of state (-v), or each connection too (-vv).
    #[arg(short, long, global = true, action = ArgAction::Count, help_heading = "Messages")]
    verbose: u8,
    /// Log errors alone on stderr.
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Messages")]
    quiet: bool,
}

impl LogOptions {
    /// Returns the log level that the options select; `None` without an option.
    fn level(self) -> Option<Level> {
        match (self.quiet, self.verbose) {
            (true, _) => Some(Level::ERROR),
            (false, 0) => None,
            (false, 1) => Some(Level::INFO),
            (false, _) => Some(Level::DEBUG),
        }
    }

    /// Starts the log. The options override `RUST_LOG`, whose directives may not contain spans or patterns.
    pub(super) fn start(self) {
        let usual = Targets::new().with_default(Level::WARN);
        let stated = std::env::var("RUST_LOG").ok().filter(|text| !text.trim().is_empty());
        let parsed = stated.as_ref().map_or(Ok(usual.clone()), |text| text.parse::<Targets>());
        let filter = match (self.level(), &parsed) {
            (Some(level), _) => {
                let quieter = ["hyper", "rumqttc"].map(|target| (target, LevelFilter::WARN));
                Targets::new().with_targets(quieter).with_default(level)
            }
            (None, Ok(targets)) => targets.clone(),
            (None, Err(_)) => usual,
        };
        let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
        let lines = lines.with_ansi(std::io::stderr().is_terminal());
        // A log that was started before, as in tests, is kept.
        let _ = tracing_subscriber::registry().with(lines.with_filter(filter)).try_init();
        if let Err(error) = parsed {
            let found = stated.unwrap_or_default();
            tracing::warn!(
                "RUST_LOG: found {found:?} ({error}), expected directives such as info,hyper=debug"
            );
        }
    }
}
