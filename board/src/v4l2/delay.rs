//! Finding out a camera's control delay: a step of the exposure, and how many frames later the picture follows.

use super::capture::{Camera, IN_TIME, SILENCE};
use super::schedule::MAX_DELAY;
use super::{CameraError, Kernel, abi, luma};

/// Least difference of the mean relative code between two exposures that shows a step: ten times what a webcam's noise leaves of it.
const LEAST_STEP: f32 = 0.02;

/// Most steps that are tried, and how many must show the same delay.
const TRIALS: u32 = 12;
const AGREEING: u32 = 3;

/// Most frames in a row that may be broken.
const MOST_BROKEN: u32 = 100;

impl Camera {
    /// Finds out the control delay: writes the other end of the exposures and counts frames until the brightness follows.
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
            for _ in 0..TRIALS {
                at = 1 - at;
                if let Some(delay) =
                    self.trial(kernel, ends[at], |level| ((level > middle) == (step > 0.0)) == (at == 1))?
                {
                    votes[delay as usize] += 1;
                }
                if votes.iter().any(|v| *v >= AGREEING) {
                    break;
                }
            }
            let (delay, most) = votes
                .iter()
                .enumerate()
                .max_by_key(|(d, v)| (**v, MAX_DELAY as usize - d))
                .unwrap_or((0, &0));
            if *most >= AGREEING {
                self.schedule.set_delay(delay as u32);
                self.sure = true;
            }
        }
        Ok(())
    }

    /// Writes an exposure and waits until it certainly acts: the mean brightness then.
    fn settled(&mut self, kernel: &mut dyn Kernel, slot: usize) -> Result<f32, CameraError> {
        let mut level = self.level(kernel)?;
        self.write(kernel, level.0, slot)?;
        for _ in 0..=MAX_DELAY + 1 {
            level = self.level(kernel)?;
        }
        Ok(level.1)
    }

    /// Writes an exposure and counts frames until `reached`; `None` where a frame was lost just then, or nothing happened.
    fn trial(
        &mut self,
        kernel: &mut dyn Kernel,
        slot: usize,
        reached: impl Fn(f32) -> bool,
    ) -> Result<Option<u32>, CameraError> {
        let (after, _) = self.level(kernel)?;
        self.write(kernel, after, slot)?;
        let in_time = self.lateness(kernel) <= IN_TIME;
        let (mut before, mut found) = (after, None);
        for _ in 0..=MAX_DELAY + 1 {
            let (sequence, level) = self.level(kernel)?;
            if found.is_none() && reached(level) {
                let whole = sequence == before.wrapping_add(1) && in_time;
                found = Some(whole.then(|| sequence.wrapping_sub(after) - 1));
            }
            before = sequence;
        }
        Ok(found.flatten().filter(|d| *d <= MAX_DELAY))
    }

    /// Waits for a frame: its number and its mean brightness.
    fn level(&mut self, kernel: &mut dyn Kernel) -> Result<(u32, f32), CameraError> {
        for _ in 0..MOST_BROKEN {
            let Some(buffer) = self.dequeue(kernel, SILENCE.0)? else { continue };
            let whole = self.setup.picture.layout.frame_bytes();
            let good = buffer.flags & abi::BUFFER_ERROR == 0 && buffer.bytes_used as usize >= whole;
            let bytes = self.setup.video.bytes(buffer.index).get(..whole).filter(|_| good);
            let level = bytes.map(|bytes| {
                luma::sample(&self.setup.picture.layout, bytes, &mut self.codes);
                luma::mean(&self.codes)
            });
            self.queue(buffer.index)?;
            if let Some(level) = level {
                return Ok((buffer.sequence, level));
            }
        }
        let found = format!("{MOST_BROKEN} broken frames in a row");
        Err(CameraError::Unfit { path: self.path().into(), found, expected: "whole ones".into() })
    }
}
