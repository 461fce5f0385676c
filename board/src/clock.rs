//! The two clocks of a light set's times: `CLOCK_MONOTONIC` and Unix time.

use rustix::time::{ClockId, clock_gettime};
use std::time::{SystemTime, UNIX_EPOCH};

/// Returns the time of `CLOCK_MONOTONIC`, nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    let seconds = u64::try_from(now.tv_sec).unwrap_or(0);
    let nanoseconds = u64::try_from(now.tv_nsec).unwrap_or(0);
    seconds.saturating_mul(1_000_000_000).saturating_add(nanoseconds)
}

/// Returns the time since `ns` nanoseconds of CLOCK_MONOTONIC, microseconds.
#[must_use]
pub fn us_since(ns: u64) -> u32 {
    u32::try_from(monotonic_ns().saturating_sub(ns) / 1000).unwrap_or(u32::MAX)
}

/// Returns Unix time, milliseconds; 0 before 1970.
#[must_use]
pub fn wall_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let ms = u64::try_from(since.as_millis()).unwrap_or(u64::MAX);
    #[cfg(test)]
    let ms = ms.saturating_add_signed(step::WALL_MS.get());
    ms
}

/// Steps of the wall clock, for tests.
#[cfg(test)]
pub(crate) mod step {
    use std::cell::Cell;

    thread_local! {
        /// Milliseconds that are added to Unix time in this thread.
        pub(crate) static WALL_MS: Cell<i64> = const { Cell::new(0) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monotonic_time_advances_like_instant() {
        // The interval measured by the second clock contains the interval measured by the first.
        let (start, began) = (std::time::Instant::now(), monotonic_ns());
        std::thread::sleep(std::time::Duration::from_millis(20));
        let (passed, elapsed) = (monotonic_ns() - began, start.elapsed().as_nanos() as u64);
        assert!(passed >= 20_000_000 && passed <= elapsed, "{passed} ns against {elapsed} ns");
    }
}
