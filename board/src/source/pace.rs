//! The times at which the bursts of built-in sources are due.

use super::SourceError;
use std::time::{Duration, Instant};

/// Longest wait in one call of a source, which bounds the delay of a shutdown and of a new setting.
const LONGEST_WAIT: Duration = Duration::from_millis(250);

/// The rate at which a source delivers bursts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// One burst per period, the contained duration.
    Every(Duration),
    /// One burst per call, without a pause.
    Free,
}

impl Pace {
    /// The pace of the built-in sources: ten bursts per second.
    pub const TEN_A_SECOND: Self = Self::Every(Duration::from_millis(100));
}

/// Numbers the bursts of a source and waits for the times at which they are due.
#[derive(Debug)]
pub(super) struct Beat {
    pace: Pace,
    began: Option<Instant>,
    /// Number of bursts so far, including those that were skipped.
    count: u32,
}

impl Beat {
    /// Creates the numbering; the first burst is due at the first call of [`Beat::due`].
    pub fn new(pace: Pace) -> Self {
        Self { pace, began: None, count: 0 }
    }

    /// Waits until the next burst is due and returns its number; bursts whose time has passed are skipped.
    ///
    /// # Errors
    /// [`SourceError::NotYet`] if the burst is not due within the longest wait.
    pub fn due(&mut self) -> Result<u32, SourceError> {
        if let Pace::Every(period) = self.pace {
            let began = *self.began.get_or_insert_with(Instant::now);
            let late = began.elapsed().saturating_sub(period * self.count);
            let missed = late.as_nanos() / period.as_nanos().max(1);
            self.count = self.count.wrapping_add(u32::try_from(missed).unwrap_or(u32::MAX));
            wait_for(began + period * self.count)?;
        }
        let number = self.count;
        self.count = self.count.wrapping_add(1);
        Ok(number)
    }

    /// Returns the time of burst `number`, seconds from the start; without a period, bursts are a tenth of a second apart.
    pub fn moment(&self, number: u32) -> f32 {
        let period = if let Pace::Every(period) = self.pace { period.as_secs_f64() } else { 0.1 };
        (f64::from(number) * period) as f32
    }
}

/// Waits for the time `due`, at most a quarter of a second.
///
/// # Errors
/// [`SourceError::NotYet`] if `due` is more than a quarter of a second away.
pub(super) fn wait_for(due: Instant) -> Result<(), SourceError> {
    let wait = due.saturating_duration_since(Instant::now());
    std::thread::sleep(wait.min(LONGEST_WAIT));
    if wait > LONGEST_WAIT { Err(SourceError::NotYet) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bursts_whose_time_has_passed_are_skipped() {
        let mut beat = Beat::new(Pace::Every(Duration::from_millis(10)));
        assert_eq!(beat.due(), Ok(0), "the first is due at once");
        std::thread::sleep(Duration::from_millis(55));
        let next = beat.due().expect("due");
        assert!(next >= 5, "{next}");
    }
}
