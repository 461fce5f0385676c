//! Frames of a pipe to bursts: the newest frame of each exposure.

use super::header::Header;

/// Frames whose exposures differ by less, in logarithms, are of the same exposure: 5 %.
const SAME: f64 = 0.05;

/// Most frames, in bursts, between the oldest and the newest frame of a burst.
const ROUNDS: u64 = 2;

/// A complete frame.
#[derive(Clone, Debug)]
pub(super) struct Piped {
    pub header: Header,
    /// CLOCK_MONOTONIC of the start of its exposure or, where that is unknown, of its arrival.
    pub time_ns: u64,
    pub bytes: Vec<u8>,
}

impl Piped {
    fn log_exposure(&self) -> f64 {
        (self.header.seconds * self.header.gain).ln()
    }
}

/// Collects frames until there is one of each exposure.
#[derive(Debug, Default)]
pub(super) struct Collector {
    frames: Vec<Piped>,
}

impl Collector {
    /// Takes a frame; the memory of frames that it replaces goes to `spare`. True when the burst is complete.
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

    /// The burst, ascending.
    pub fn take(&mut self) -> Vec<Piped> {
        let mut frames = std::mem::take(&mut self.frames);
        frames.sort_by(|a, b| a.log_exposure().total_cmp(&b.log_exposure()));
        frames
    }
}
