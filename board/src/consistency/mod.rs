//! Detects the frames of a burst that contradict the other frames.
//!
//! The radiances of two frames of one scene have the inverse ratio of their exposures. The samples of a grid of pixels of each frame are
//! converted to relative exposure, and frames of neighbouring exposures are compared. A frame contradicts its burst if all neighbours of
//! the frame contradict it and agree with each other. The expected ratio of each pair of exposures is the usual one of the earlier bursts,
//! or of those at the same phase of the lamps, so that flickering light and exposure times with a constant error are not faults.

mod by_phase;
mod compare;
mod history;
mod jump;
mod lamp_phase;
mod levels;
mod recent;
mod samples;
#[cfg(test)]
mod tests;
mod verdicts;

use crate::calibration::{Burst, Calibration, Frame};
use crate::recorded::RecordedBurst;
use compare::{Comparison, Scratch};
use hemilux_core::wire::{FrameFault, FramesLeftOut};
use hemilux_core::{Exposure, MAX_EXPOSURES, ResponseError};
use history::History;
use lamp_phase::LampPhase;
use levels::{Judgement, Levels, Seen};
use recent::Recent;
use samples::{Grid, Sampled};
use verdicts::{Pair, Verdicts, Wrong, verdict, worst};

/// Detects contradicting frames in successive bursts of one camera.
#[derive(Debug)]
pub struct Inspector {
    grid: Grid,
    frames: Vec<Sampled>,
    /// One bit for each element of `frames`, set if it has samples.
    sampled: u16,
    scratch: Scratch,
    /// Running statistics of each pair of neighbouring exposures, by the index of the shorter one.
    history: [History; MAX_EXPOSURES],
    /// Comparison of the row sums of samples that are too dark for a comparison one by one.
    levels: Levels,
    recent: Recent,
    lamps: LampPhase,
    is_uncertain: bool,
    /// The frames of the last burst with stale frames, which are stored for comparison when new ones replace them.
    waiting: Option<Waiting>,
}

/// The frames of a burst with stale frames.
#[derive(Debug)]
struct Waiting {
    /// Exposure time times gain of each frame, seconds.
    lights: [f64; MAX_EXPOSURES],
    count: usize,
    /// One bit for each frame, set if it is sound.
    sound: u16,
}

impl Inspector {
    /// Allocates the memory for bursts of `exposures` frames.
    ///
    /// # Errors
    /// [`ResponseError`] for a response of the camera that is not monotone between black and white level.
    pub fn try_new(calibration: &Calibration, exposures: usize) -> Result<Self, ResponseError> {
        let grid = Grid::try_new(calibration)?;
        let mut frames = Vec::with_capacity(MAX_EXPOSURES);
        frames.resize_with(exposures.min(MAX_EXPOSURES), || grid.empty());
        let scratch = Scratch::with_capacity(grid.len());
        let (history, levels) = ([History::default(); MAX_EXPOSURES], Levels::new(grid.code, grid.least));
        Ok(Self {
            grid,
            frames,
            sampled: 0,
            scratch,
            history,
            levels,
            recent: Recent::default(),
            lamps: LampPhase::default(),
            is_uncertain: false,
            waiting: None,
        })
    }

    /// Sets the exposures of the frames of the next whole bursts: one frame of another exposure is then in doubt if no comparison confirms it.
    pub fn expect(&mut self, exposures: &[Exposure]) {
        self.levels.expect(exposures.iter().map(|exposure| exposure.seconds * exposure.gain));
    }

    /// Sets the frequency of the lamps that light the scene, hertz; `None` while no lamps are found. Contradictions that return at the same
    /// phase of the lamps are no faults.
    pub fn follow_lamps(&mut self, frequency_hz: Option<f32>) {
        self.lamps.set_frequency(frequency_hz);
    }

    /// Returns the memory of the inspector on the heap, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let frames = self.frames.iter().map(Sampled::bytes).sum::<usize>();
        // `levels` stores the samples of the frames of two more bursts, from the first burst on.
        self.grid.bytes() + 3 * frames + self.scratch.bytes()
    }

    /// Returns true if the remaining frames of the last burst may be wrong: they contradict each other, or too few samples of them could be
    /// compared to identify the wrong frame.
    #[must_use]
    pub fn is_uncertain(&self) -> bool {
        self.is_uncertain
    }

    /// Returns the frames of `burst` that contradict its other frames; at least one frame remains. The frames in [`Burst::stale`] must be
    /// those of the last inspected burst.
    pub fn inspect(&mut self, burst: &Burst) -> FramesLeftOut {
        let mut left_out = FramesLeftOut::NONE;
        self.is_uncertain = false;
        let frames = &burst.frames[..burst.frames.len().min(MAX_EXPOSURES)];
        if frames.len() < 2 {
            self.sampled = 0;
            return left_out;
        }
        while self.frames.len() < frames.len() {
            self.frames.push(self.grid.empty());
        }
        self.store_replaced(burst);
        for (index, (frame, sampled)) in frames.iter().zip(&mut self.frames).enumerate() {
            // A frame that was part of the last inspected burst has the same samples.
            if burst.is_new(index) || self.sampled >> index & 1 == 0 {
                self.grid.sample(frame, sampled);
                self.sampled |= 1 << index;
            }
        }
        let phase = self.lamps.advance(burst.phase_s());
        let verdicts = self.compare(frames, phase);
        let mut indices: [usize; MAX_EXPOSURES] = core::array::from_fn(|i| i);
        let mut kept = &mut indices[..frames.len()];
        while let Some(Wrong { at, fault, is_certain }) = worst(kept, &verdicts) {
            left_out.insert(kept[at], fault);
            self.is_uncertain |= !is_certain;
            kept[at..].rotate_left(1);
            let fewer = kept.len() - 1;
            kept = &mut kept[..fewer];
        }
        self.judge_levels(frames, kept, &verdicts, burst.stale != 0, &mut left_out);
        left_out
    }

    /// Stores the frames of a sliding window that the new frames of `burst` replace. The frames of a window are of different times: each frame
    /// is compared with the frame of its exposure one round before, so that steady motion changes all exposures by the same factor.
    fn store_replaced(&mut self, burst: &Burst) {
        if let Some(Waiting { lights, count, sound }) = self.waiting.take() {
            let sampled = &self.frames[..count];
            let seen = Seen { lights: &lights[..count], sampled, kept: &[], is_window: true };
            self.levels.keep(&seen, |index| sound >> (index & 15) & 1 != 0 && burst.is_new(index));
        }
    }

    /// Adds to `left_out` the frames of `kept` whose rows change as those of false frames, and determines whether the remaining
    /// frames may be wrong.
    fn judge_levels(
        &mut self,
        frames: &[Frame],
        kept: &[usize],
        verdicts: &Verdicts,
        is_window: bool,
        left_out: &mut FramesLeftOut,
    ) {
        let mut lights = [0.0; MAX_EXPOSURES];
        lights.iter_mut().zip(frames).for_each(|(light, frame)| *light = frame.light());
        let sampled = &self.frames[..frames.len()];
        let seen = Seen { lights: &lights[..frames.len()], sampled, kept, is_window };
        let judged = self.levels.judge(&seen, |index| verdicts.agreeing_rows(index, kept));
        let falsified = kept.iter().filter_map(|index| match judged[*index] {
            Judgement::False(fault) => Some((*index, fault)),
            _ => None,
        });
        if falsified.clone().count() < kept.len() {
            falsified.for_each(|(index, fault)| left_out.insert(index, fault));
        } else {
            self.is_uncertain = true;
        }
        let mut indices = [0; MAX_EXPOSURES];
        let mut count = 0;
        for index in kept.iter().copied().filter(|index| !left_out.contains(*index)) {
            indices[count] = index;
            count += 1;
        }
        let rest = &indices[..count];
        // If half of the frames or more are called wrong, the others may be the wrong ones; so may they be if no comparison confirms a
        // remaining frame that contradicts a wrong one.
        self.is_uncertain |= 2 * count <= frames.len();
        self.is_uncertain |= rest.windows(2).any(|pair| verdicts.differ(pair[0], pair[1]));
        let repeated = self.recent.add(&seen, self.levels.floor);
        let is_doubtful = |index: usize| repeated >> index & 1 == 0 && judged[index] == Judgement::Doubtful;
        self.is_uncertain |= rest.iter().any(|index| is_doubtful(*index));
        let is_unconfirmed =
            |index: &usize| judged[*index] == Judgement::Unknown && !verdicts.are_usual(*index, rest);
        self.is_uncertain |= !left_out.is_empty() && rest.iter().any(is_unconfirmed);
        let is_sound = |index: usize| rest.contains(&index) && !is_doubtful(index);
        if is_window {
            let sound =
                (0..frames.len()).filter(|index| is_sound(*index)).fold(0, |bits, i| bits | 1 << (i & 15));
            self.waiting = Some(Waiting { lights, count: frames.len(), sound });
        } else {
            self.levels.keep(&seen, is_sound);
        }
    }

    /// Compares the frames of neighbouring exposures and adds the results to the history; if they do not all agree, also compares the
    /// frames two places apart.
    fn compare(&mut self, frames: &[Frame], phase: Option<f32>) -> Verdicts {
        let mut verdicts = Verdicts::default();
        for apart in [1, 2] {
            for low in 0..frames.len().saturating_sub(apart) {
                let pair = Pair { of: low, by: low + apart };
                let seen = self.see(frames, pair);
                let found = if apart == 1 {
                    verdict(&seen, &mut self.history[low], phase)
                } else {
                    verdict(&seen, &mut self.history[low].joined(&self.history[low + 1]), phase)
                };
                verdicts.set(pair, found, seen.rows);
            }
            if verdicts.are_all_usual(frames.len()) {
                break;
            }
        }
        verdicts
    }

    fn see(&mut self, frames: &[Frame], Pair { of: low, by: high }: Pair) -> Comparison {
        let factor = (frames[low].light() / frames[high].light()) as f32;
        let (short, long) = (&self.frames[low], &self.frames[high]);
        let Grid { least, code, .. } = self.grid;
        Comparison::new(compare::Pair { short, long, factor, least, code }, &mut self.scratch)
    }
}

/// A frame that was left out of a recorded burst.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Name of the frame's file in the folder of the burst.
    pub file: String,
    /// Index of the frame in its burst, in ascending order of exposure.
    pub index: usize,
    /// Kind of contradiction between the frame and the other frames of its burst.
    pub fault: FrameFault,
}

impl std::fmt::Display for LeftOut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let why = match self.fault {
            FrameFault::Black => "it is black where its neighbours are not",
            FrameFault::Saturated => "it is saturated where its neighbours are not",
            FrameFault::OtherScene => "its scene differs from that of its neighbours",
            FrameFault::WrongExposure => "its exposure is not the stated one",
            FrameFault::Torn => "a part of its rows has another exposure",
            FrameFault::Repeated => "it repeats a frame of another exposure",
            FrameFault::Incomplete => "the shortest exposure of its burst is missing",
            _ => "it contradicts its neighbours",
        };
        write!(f, "{}: left out: {why}", self.file)
    }
}

/// Returns the descriptions of the frames `found` of a recorded burst.
#[must_use]
pub fn described(read: &RecordedBurst, found: &FramesLeftOut) -> Vec<LeftOut> {
    let files = found.iter().filter_map(|f| read.files.get(f.index).map(|file| (f, file)));
    files.map(|(f, file)| LeftOut { file: file.clone(), index: f.index, fault: f.fault }).collect()
}

/// Removes the frames `found` from a recorded burst and returns their descriptions.
pub fn remove(read: &mut RecordedBurst, found: &FramesLeftOut) -> Vec<LeftOut> {
    let exposures = read.burst.frames.len().min(read.files.len());
    let left_out = described(read, found);
    let kept = |index: &usize| !found.contains(*index);
    read.files = (0..exposures).filter(kept).map(|i| std::mem::take(&mut read.files[i])).collect();
    let frames = std::mem::take(&mut read.burst.frames).into_iter().enumerate();
    read.burst.frames = frames.filter(|(index, _)| kept(index)).map(|(_, frame)| frame).collect();
    left_out
}

/// Removes the frames of the recorded burst `read` that contradict its other frames, and returns their descriptions.
///
/// # Errors
/// [`ResponseError`] for a response of the camera that is not monotone between black and white level.
pub fn leave_out(read: &mut RecordedBurst) -> Result<Vec<LeftOut>, ResponseError> {
    let found = Inspector::try_new(&read.calibration, read.burst.frames.len())?.inspect(&read.burst);
    Ok(remove(read, &found))
}
