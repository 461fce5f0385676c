//! Groups the frames of a pipe to bursts: the newest frame of each exposure.

use super::header::Header;

/// Largest difference between the natural logarithms of two exposures that count as one exposure: 5 %.
const SAME: f64 = 0.05;

/// Largest number of frames between the oldest and the newest frame of a burst, as a multiple of the burst's number of frames.
const ROUNDS: u64 = 2;

/// A complete frame that was read from a pipe.
#[derive(Clone, Debug)]
pub(super) struct Piped {
    pub header: Header,
    /// CLOCK_MONOTONIC of the start of the exposure or, where that is unknown, of the frame's arrival, nanoseconds.
    pub time_ns: u64,
    pub bytes: Vec<u8>,
}

impl Piped {
    fn log_exposure(&self) -> f64 {
        (self.header.seconds * self.header.gain).ln()
    }
}

/// Collects the frames of a pipe until there is one frame of each exposure.
#[derive(Debug, Default)]
pub(super) struct Collector {
    frames: Vec<Piped>,
}

impl Collector {
    /// Adds a frame; the memory of frames that it replaces is moved to `spare`. Returns true if the frame completes a burst.
    pub fn push(&mut self, new: Piped, spare: &mut Vec<Vec<u8>>) -> bool {
        let (count, newest, log) = (new.header.count, new.header.sequence, new.log_exposure());
        let picture = new.header.picture;
        let stays = |old: &Piped| {
            let age = newest.checked_sub(old.header.sequence);
            old.header.picture == picture
                && age.is_some_and(|age| age < ROUNDS * count as u64)
                && (old.log_exposure() - log).abs() > SAME
        };
        for at in (0..self.frames.len()).rev() {
            if !stays(&self.frames[at]) {
                spare.push(self.frames.swap_remove(at).bytes);
            }
        }
        self.frames.push(new);
        self.frames.len() >= count
    }

    /// Removes the frames of the complete burst and returns them in ascending order of exposure.
    pub fn take(&mut self) -> Vec<Piped> {
        let mut frames = std::mem::take(&mut self.frames);
        frames.sort_by(|a, b| a.log_exposure().total_cmp(&b.log_exposure()));
        frames
    }
}
