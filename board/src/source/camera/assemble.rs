//! Groups the frames of a camera to bursts: the newest frame of each exposure, as soon as there is one frame of each.

use crate::v4l2::frame::RawFrame;

/// Largest number of rounds of all exposures between the oldest and the newest frame of a burst: usually one, and two after a lost frame.
/// Frames that are further apart may show different scenes.
const ROUNDS: u32 = 2;

/// Collects the frames of a camera until there is one of each exposure.
#[derive(Debug, Default)]
pub(super) struct Assembler {
    frames: Vec<RawFrame>,
    /// True for each exposure of which there is a frame since the last burst.
    there: Vec<bool>,
    /// Whether the frame of that exposure was not handed over yet.
    fresh: Vec<bool>,
}

impl Assembler {
    /// Removes all frames and continues with bursts of `slots` exposures.
    pub fn reset(&mut self, slots: usize) {
        self.frames.resize_with(slots, RawFrame::default);
        self.there.clear();
        self.there.resize(slots, false);
        self.fresh.clear();
        self.fresh.resize(slots, false);
    }

    /// Exchanges `frame` with the stored frame of its exposure; returns true when there is a new frame of each exposure, which completes a
    /// burst.
    pub fn push(&mut self, frame: &mut RawFrame) -> bool {
        let Some(slot) = frame.taken.slot.filter(|s| *s < self.frames.len()) else { return false };
        let newest = frame.taken.sequence;
        std::mem::swap(&mut self.frames[slot], frame);
        (self.there[slot], self.fresh[slot]) = (true, true);
        let most = ROUNDS * self.frames.len() as u32;
        for (there, old) in self.there.iter_mut().zip(&self.frames) {
            *there &= newest.wrapping_sub(old.taken.sequence) < most;
        }
        self.there.iter().all(|there| *there)
    }

    /// Exchanges the frames of the complete burst, in order of the exposures, with the memory of `burst`.
    pub fn take(&mut self, burst: &mut Vec<RawFrame>) {
        burst.resize_with(self.frames.len(), RawFrame::default);
        std::mem::swap(&mut self.frames, burst);
        self.there.fill(false);
        self.fresh.fill(false);
    }

    /// Hands over the frames that were not handed over before, for memory of old ones, and keeps the others for the next window. Returns
    /// one bit for each exposure whose frame is new.
    pub fn take_new(&mut self, burst: &mut Vec<RawFrame>) -> u16 {
        burst.resize_with(self.frames.len(), RawFrame::default);
        let mut new = 0;
        for (index, (own, frame)) in self.frames.iter_mut().zip(burst).enumerate() {
            if std::mem::take(&mut self.fresh[index]) {
                std::mem::swap(own, frame);
                own.taken = frame.taken;
                new |= 1 << index;
            }
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::frame::Taken;
    use crate::v4l2::schedule::Known;

    fn push(assembler: &mut Assembler, sequence: u32, slot: Option<usize>) -> Option<Vec<u32>> {
        let taken = Taken { sequence, timestamp_ns: 0, slot, known: Known::Predicted };
        let whole = assembler.push(&mut RawFrame { taken, bytes: Vec::new() });
        whole.then(|| {
            let mut burst = Vec::new();
            assembler.take(&mut burst);
            burst.iter().map(|f| f.taken.sequence).collect()
        })
    }

    #[test]
    fn a_burst_has_the_newest_frame_of_each_exposure() {
        let mut a = Assembler::default();
        a.reset(3);
        let bursts: Vec<_> = [(0, 0), (1, 1), (2, 2), (3, 0), (5, 2), (6, 0), (7, 1)]
            .into_iter()
            .filter_map(|(sequence, slot)| push(&mut a, sequence, Some(slot)))
            .collect();
        assert_eq!(bursts, [vec![0, 1, 2], vec![6, 7, 5]], "frame 4 is lost, 6 replaces 3");
    }

    #[test]
    fn old_frames_and_frames_of_unknown_exposure_are_left_out() {
        let mut a = Assembler::default();
        a.reset(2);
        let pushed = [(0, Some(0)), (1, None), (4, Some(1)), (5, Some(0))];
        let bursts: Vec<_> = pushed.into_iter().filter_map(|(n, slot)| push(&mut a, n, slot)).collect();
        assert_eq!(bursts, [vec![5, 4]], "0 is too old for 4");
    }
}
