//! The frames of a burst that must not be merged.

use super::{Pipeline, WindowMode};
use crate::calibration::Burst;
use hemilux_core::Exposure;
use hemilux_core::wire::{FrameFault, FramesLeftOut};

/// Largest number of consecutive bursts that are not merged; the pipeline returns the lights of the last merged burst in their place.
const MOST_HELD: u32 = 4;

impl Pipeline {
    /// Sets the exposures that the source states for its next bursts; a single frame of another exposure is merged only if the other frames
    /// confirm it.
    pub fn expect_exposures(&mut self, exposures: &[Exposure]) {
        self.inspector.expect(exposures);
        self.compared.expect(exposures);
    }

    /// Returns the frames of the next burst that must not be merged: those that contradict the others. All frames are left out if the
    /// shortest exposure is wrong, which alone measures the brightest lights, or if the wrong frames cannot be identified. These bursts are
    /// merged nevertheless if there is no map yet or if the four bursts before were left out as well. In [`WindowMode::Sliding`], a wrong
    /// shortest exposure leaves out no other frame.
    pub fn inspect(&mut self, burst: &Burst) -> FramesLeftOut {
        self.inspector.follow_lamps(self.flicker.frequency_hz);
        let mut found = self.inspector.inspect(burst);
        // A sliding window stores an earlier frame of the shortest exposure.
        let needs_shortest = self.settings.window == WindowMode::Burst;
        let is_doubtful = (needs_shortest && found.contains(0)) || self.inspector.is_uncertain();
        let holds = is_doubtful && self.was_seen && self.doubtful < MOST_HELD;
        self.doubtful = if is_doubtful { self.doubtful.saturating_add(1) } else { 0 };
        for index in (0..burst.frames.len()).filter(|_| holds) {
            if !found.contains(index) {
                found.insert(index, FrameFault::Incomplete);
            }
        }
        found
    }
}
