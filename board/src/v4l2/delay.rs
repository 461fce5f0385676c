//! Measurement of a camera's control delay: the exposure is stepped, and frames are counted until the brightness changes.

use super::capture::{Camera, IN_TIME, SILENCE};
use super::schedule::MAX_DELAY;
use super::{CameraError, Kernel, luma};

/// Least difference between the mean relative codes (0 to 1) of two exposures at which the control delay can be measured: ten times the
/// noise of a webcam's mean.
const LEAST_STEP: f32 = 0.02;

/// Largest number of steps of the exposure in a measurement, largest number of further steps during which a frame was lost or late (a board
/// that is busy during its start has many), and number of steps that must show the same delay.
const TRIALS: u32 = 12;
const SPOILT: u32 = 48;
const AGREEING: u32 = 3;

/// Range of the mean relative code of a frame in which every change of the exposure changes the mean.
const LIT: std::ops::Range<f32> = 0.05..0.8;

/// Largest number of successive broken frames during a measurement.
const MOST_BROKEN: u32 = 100;

/// The result of one step of the exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// The brightness changed in the frame that is this number of frames after the next one.
    After(u32),
    /// The brightness did not change within the longest delay.
    Nothing,
    /// A frame was lost or late during the step.
    Spoilt,
}

/// The mean relative code of a frame.
struct FrameBrightness {
    /// Sequence number of the frame.
    sequence: u32,
    brightness: f32,
}

impl Camera {
    /// Measures the control delay: writes the shortest and the longest exposure in turn and counts frames until the brightness changes.
    pub(super) fn find_delay(&mut self, kernel: &mut dyn Kernel) -> Result<(), CameraError> {
        let ends = [0, self.setup.settings.len() - 1];
        let mut levels = [0.0; 2];
        for (level, slot) in levels.iter_mut().zip(ends).rev() {
            *level = self.settled(kernel, slot)?;
        }
        let step = levels[1] - levels[0];
        if step.abs() >= LEAST_STEP {
            let mut votes = [0u32; MAX_DELAY as usize + 1];
            let (mut at, middle) = (0, levels[0] + step / 2.0);
            let (mut made, mut spoilt) = (0, 0);
            while made < TRIALS && spoilt < SPOILT && votes.iter().all(|v| *v < AGREEING) {
                at = 1 - at;
                let reached = |level| ((level > middle) == (step > 0.0)) == (at == 1);
                match self.trial(kernel, ends[at], reached)? {
                    Step::After(delay) => {
                        made += 1;
                        votes[delay as usize] += 1;
                    }
                    Step::Nothing => made += 1,
                    Step::Spoilt => spoilt += 1,
                }
            }
            let (delay, most) = votes
                .iter()
                .enumerate()
                .max_by_key(|(d, v)| (**v, MAX_DELAY as usize - d))
                .unwrap_or((0, &0));
            if *most >= AGREEING && step < 0.0 && self.is_timed() {
                self.keep_one(kernel, "shorter exposures for larger values: one exposure is used")?;
            } else if *most >= AGREEING {
                self.schedule.set_delay(delay as u32);
                self.sure = true;
            }
        } else if !self.setup.reads_back && LIT.contains(&levels[1]) {
            self.keep_one(kernel, "no effect: one exposure is used")?;
        }
        Ok(())
    }

    /// Writes exposure `slot`, waits for more frames than the longest delay, and returns the mean brightness of
    /// the frame after them.
    fn settled(&mut self, kernel: &mut dyn Kernel, slot: usize) -> Result<f32, CameraError> {
        let mut level = self.level(kernel)?;
        self.write(kernel, level.sequence, slot)?;
        for _ in 0..=MAX_DELAY + 1 {
            level = self.level(kernel)?;
        }
        Ok(level.brightness)
    }

    /// Writes an exposure and counts the frames until the brightness of one satisfies `reached`.
    fn trial(
        &mut self,
        kernel: &mut dyn Kernel,
        slot: usize,
        reached: impl Fn(f32) -> bool,
    ) -> Result<Step, CameraError> {
        let after = self.level(kernel)?.sequence;
        let failed = self.counters().failed_writes;
        self.write(kernel, after, slot)?;
        let in_time = self.lateness(kernel) <= IN_TIME && self.counters().failed_writes == failed;
        let (mut before, mut found) = (after, Step::Nothing);
        for _ in 0..=MAX_DELAY + 1 {
            let FrameBrightness { sequence, brightness } = self.level(kernel)?;
            if found == Step::Nothing && reached(brightness) {
                let whole = sequence == before.wrapping_add(1) && in_time;
                let delay = sequence.wrapping_sub(after).wrapping_sub(1);
                found = match delay {
                    _ if !whole => Step::Spoilt,
                    0..=MAX_DELAY => Step::After(delay),
                    _ => Step::Nothing,
                };
            }
            before = sequence;
        }
        Ok(found)
    }

    /// Waits for a complete frame and returns its mean brightness.
    fn level(&mut self, kernel: &mut dyn Kernel) -> Result<FrameBrightness, CameraError> {
        let mut bytes = Vec::new();
        for _ in 0..MOST_BROKEN {
            let Some(filled) = self.dequeue(kernel, SILENCE.0)? else { continue };
            let is_read = self.read(&filled, &mut bytes);
            self.queue(filled.buffer.index)?;
            if is_read {
                let brightness = luma::mean(&self.codes);
                return Ok(FrameBrightness { sequence: filled.buffer.sequence, brightness });
            }
        }
        let found = format!("{MOST_BROKEN} broken frames in a row ({})", self.counters().broken);
        Err(CameraError::Unfit { path: self.path().into(), found, expected: "complete frames".into() })
    }
}
