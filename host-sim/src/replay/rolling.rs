//! Sets of a sliding window from recorded bursts: one for every frame, in the order of the frames' times.

use super::{ReplayJob, SequencePosition, process, report};
use crate::error::SimError;
use hemilux::calibration::Burst;
use hemilux::consistency;
use hemilux::pipeline::Pipeline;
use hemilux::recorded::RecordedBurst;

/// The newest frame of each exposure, as a camera lends it to the probe.
#[derive(Default)]
pub(super) struct RollingBurst {
    burst: Burst,
    /// Number of sets so far.
    sets: usize,
}

impl RollingBurst {
    /// Processes the frames of a recorded burst one after the other; all at once for the first burst and after a change of the exposures.
    pub(super) fn process(
        &mut self,
        job: &ReplayJob,
        pipeline: &mut Pipeline,
        read: &mut RecordedBurst,
        place: SequencePosition<'_>,
    ) -> Result<(), SimError> {
        let exposures = |burst: &Burst| burst.frames.iter().map(|frame| frame.exposure).collect::<Vec<_>>();
        if exposures(&self.burst) != exposures(&read.burst) {
            self.burst = std::mem::take(&mut read.burst);
            return self.process_newest(job, pipeline, read, place);
        }
        for (index, time_ns) in in_time_order(read) {
            std::mem::swap(&mut self.burst.frames[index], &mut read.burst.frames[index]);
            self.burst.stale = !(1 << index);
            self.burst.timestamp_ns = time_ns;
            self.process_newest(job, pipeline, read, place)?;
        }
        Ok(())
    }

    fn process_newest(
        &mut self,
        job: &ReplayJob,
        pipeline: &mut Pipeline,
        read: &RecordedBurst,
        place: SequencePosition<'_>,
    ) -> Result<(), SimError> {
        let found = pipeline.inspect(&self.burst);
        let mut newly_found = found;
        newly_found.retain(|index| self.burst.is_new(index));
        let left_out = consistency::described(read, &newly_found);
        report(place.folder, &left_out);
        process(
            job,
            pipeline,
            &self.burst,
            found,
            SequencePosition { index: self.sets, ..place },
            &left_out,
        )?;
        self.sets += 1;
        Ok(())
    }
}

/// Returns the index and the time, nanoseconds, of each frame in the order of the times; in the order of the exposures where a time is unknown.
fn in_time_order(read: &RecordedBurst) -> Vec<(usize, u64)> {
    let mut frames: Vec<_> = read.times_ns.iter().copied().enumerate().collect();
    if frames.iter().all(|(_, time_ns)| *time_ns != 0) {
        frames.sort_by_key(|(_, time_ns)| *time_ns);
    } else {
        frames.iter_mut().for_each(|(_, time_ns)| *time_ns = read.burst.timestamp_ns);
    }
    frames
}
