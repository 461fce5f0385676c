//! When the next burst is due.

use super::SourceError;
use std::time::{Duration, Instant};

/// Longest wait in one call of a source: it bounds how late a shutdown or a new setting is noticed.
const LONGEST_WAIT: Duration = Duration::from_millis(250);

/// How fast bursts come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// One after each such time.
    Every(Duration),
    /// As fast as they are asked for.
    Free,
}

impl Pace {
    /// The pace of the built-in sources.
    pub const TEN_A_SECOND: Self = Self::Every(Duration::from_millis(100));
}

/// Waits for `due`, for a quarter of a second at most.
///
/// # Errors
/// [`SourceError::NotYet`] when it is still to come.
pub(super) fn wait_for(due: Instant) -> Result<(), SourceError> {
    let wait = due.saturating_duration_since(Instant::now());
    std::thread::sleep(wait.min(LONGEST_WAIT));
    if wait > LONGEST_WAIT { Err(SourceError::NotYet) } else { Ok(()) }
}
