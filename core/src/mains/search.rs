//! Bursts in which exposures are left out so that the modulation of the light can be found.

use super::window::WINDOW;

/// Number of bursts in which exposures are left out, and least number of bursts between two such searches.
const BURSTS: u32 = WINDOW as u32;
const PAUSE: u32 = 10 * BURSTS;

/// Whether exposures are left out of the bursts although no frequency is known.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Search {
    /// Number of bursts until exposures are merged again, plus [`PAUSE`]; then number of bursts until the next search.
    left: u32,
}

impl Search {
    /// Returns whether exposures are left out of the next burst.
    pub fn is_on(self) -> bool {
        self.left > PAUSE
    }

    /// Counts a burst. A search begins if `varies` returns true and no frequency is found, and ends once a frequency is found.
    pub fn advance(&mut self, is_found: bool, varies: impl FnOnce() -> bool) {
        self.left = if is_found {
            0
        } else if self.left > 0 {
            self.left - 1
        } else if varies() {
            BURSTS + PAUSE
        } else {
            0
        };
    }
}
