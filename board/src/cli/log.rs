//! The amount of messages on stderr.

use clap::{ArgAction, Args};
use std::io::IsTerminal;
use tracing::Level;
use tracing_subscriber::EnvFilter;

#[derive(Clone, Copy, Debug, Args)]
pub(super) struct LogOptions {
    /// Say more on stderr: what changes (-v), or also each connection (-vv).
    #[arg(short, long, global = true, action = ArgAction::Count, help_heading = "Messages")]
    verbose: u8,
    /// Say less on stderr: errors alone.
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Messages")]
    quiet: bool,
}

impl LogOptions {
    /// The level that the options ask for; `None` without an option.
    fn level(self) -> Option<Level> {
        match (self.quiet, self.verbose) {
            (true, _) => Some(Level::ERROR),
            (false, 0) => None,
            (false, 1) => Some(Level::INFO),
            (false, _) => Some(Level::DEBUG),
        }
    }

    /// Starts the log. The options have the last word over `RUST_LOG`.
    pub(super) fn start(self) {
        let usual = EnvFilter::builder().with_default_directive(Level::WARN.into());
        let filter = match self.level() {
            Some(level) => usual.parse_lossy(format!("{level},hyper=warn,rumqttc=warn")),
            None => usual.from_env_lossy(),
        };
        let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
        // A log that runs already, as in tests, stays.
        let _ = log.with_ansi(std::io::stderr().is_terminal()).try_init();
    }
}
