//! The sliding window of the pipeline: a map after every frame.

use super::{Pipeline, PipelineError};
use crate::calibration::Burst;
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{Coverage, Exposure, FrontEnd, NewFrame, Window};

/// The energy of each texel in the newest frame of each exposure.
pub(super) struct Sliding {
    window: Window<Vec<u64>>,
    exposures: Vec<Exposure>,
    /// One bit for each exposure, set if its newest frame is not in the window yet.
    waiting: u16,
}

impl Sliding {
    /// Creates the window of `exposures`, to which all frames of the next burst are added.
    pub(super) fn open(
        front: &mut FrontEnd<Vec<u64>>,
        exposures: Vec<Exposure>,
    ) -> Result<Self, PipelineError> {
        let words = front.window_words(&exposures)?;
        let window = front.window(&exposures, vec![0; words])?;
        Ok(Self { window, exposures, waiting: u16::MAX })
    }

    /// Number of exposures.
    pub(super) fn exposures(&self) -> usize {
        self.exposures.len()
    }
}

impl Pipeline {
    /// Adds the new frames of `burst` without `left_out` to the window, after the earlier ones that were left out when they were new and are
    /// confirmed by the new ones: those of a change of all light. A window is opened with all frames if the exposures are others.
    pub(super) fn slide(
        &mut self,
        burst: &Burst,
        left_out: &FramesLeftOut,
        mut added_up: impl FnMut(),
    ) -> Result<Coverage, PipelineError> {
        let exposures = burst.frames.iter().map(|frame| frame.exposure);
        let known = self.sliding.take().filter(|known| exposures.clone().eq(known.exposures.iter().copied()));
        let mut sliding = match known {
            Some(known) => known,
            None => Sliding::open(&mut self.front, exposures.collect())?,
        };
        sliding.waiting |= !burst.stale;
        let is_ready = |index: &usize| sliding.waiting >> (index & 15) & 1 != 0 && !left_out.contains(*index);
        let ready = || (0..burst.frames.len()).filter(is_ready);
        let oldest_first = ready().filter(|i| !burst.is_new(*i)).chain(ready().filter(|i| burst.is_new(*i)));
        let mut added = 0;
        for index in oldest_first {
            let frame = NewFrame { index, samples: burst.frames[index].pixels.samples() };
            self.seen = Some(self.front.slide(&mut sliding.window, frame, &mut added_up)?);
            added |= 1 << (index & 15);
        }
        sliding.waiting &= !added;
        self.was_seen |= added != 0;
        self.sliding = Some(sliding);
        self.seen.ok_or(PipelineError::NoFrame)
    }

    /// Returns the memory of the sliding window, bytes; 0 without one.
    #[must_use]
    pub fn window_bytes(&self) -> usize {
        self.sliding.as_ref().map_or(0, |sliding| sliding.window.bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Pixels;
    use crate::pipeline::{Settings, WindowMode};
    use crate::scene;
    use crate::source::{Pace, SceneSource, Source};
    use hemilux_core::MergeMode;
    use hemilux_core::mains::Lamps;
    use hemilux_core::wire::FrameFault;

    fn sliding() -> Settings {
        Settings { window: WindowMode::Sliding, lamps: Lamps::Off, ..Settings::default() }
    }

    fn pipeline(source: &SceneSource, settings: Settings) -> Pipeline {
        Pipeline::try_new(*source.calibration(), &source.exposures(), settings).expect("a pipeline")
    }

    #[test]
    fn a_window_of_one_burst_has_the_light_of_the_burst_within_a_thousandth() {
        for name in scene::NAMES {
            let mut source = SceneSource::new(scene::by_name(name).expect("a scene"), Pace::Free);
            let mut burst = Burst::default();
            source.next(&mut burst).expect("a burst");
            let all = Settings { merge: MergeMode::All, lamps: Lamps::Off, ..Settings::default() };
            let expected = pipeline(&source, all).process(&burst).expect("lights").horizontal_irradiance;
            let mut sliding = pipeline(&source, sliding());
            let found = sliding.process(&burst).expect("lights").horizontal_irradiance;
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-3, "{name}: {found}, expected {expected}");
            }
            assert!(sliding.window_bytes() < 2_000_000, "{name}: {} bytes", sliding.window_bytes());
        }
    }

    #[test]
    fn each_frame_gives_a_set_and_a_false_frame_is_named_once() {
        let mut source = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
        let mut pipeline = pipeline(&source, sliding());
        assert!(source.set_sliding(true));
        let mut burst = Burst::default();
        let mut step = |pipeline: &mut Pipeline, is_black: bool| {
            let before = burst.frames.clone();
            source.next(&mut burst).expect("a frame");
            let changed = (0..before.len()).filter(|i| before[*i] != burst.frames[*i]).count();
            let newest = (0..3).find(|index| burst.is_new(*index)).expect("a new frame");
            if let (true, Pixels::U8(codes)) = (is_black, &mut burst.frames[newest].pixels) {
                codes.fill(0);
            }
            let processed = pipeline.process(&burst).expect("lights");
            let found = (processed.scalar_flux, processed.frames_left_out);
            burst.stale = u16::MAX;
            (changed, newest, found)
        };
        let newest: Vec<_> =
            (0..5).map(|_| step(&mut pipeline, false)).map(|(_, newest, _)| newest).collect();
        assert_eq!(newest, [0, 1, 2, 0, 1]);
        let (changed, _, (before, left_out)) = step(&mut pipeline, false);
        assert!(changed == 1 && left_out.is_empty());
        step(&mut pipeline, false);
        let (_, newest, (flux, left_out)) = step(&mut pipeline, true);
        let named: Vec<_> = left_out.iter().map(|frame| (frame.index, frame.fault)).collect();
        assert_eq!(named, [(newest, FrameFault::Black)]);
        assert!((flux[1] / before[1] - 1.0).abs() < 0.02, "{flux:?}, expected {before:?}");
    }

    #[test]
    fn a_sliding_window_with_the_removal_of_flicker_is_refused() {
        let refused = Settings { lamps: Lamps::Mains50, ..sliding() }.check().expect_err("both");
        assert_eq!(
            refused.to_string(),
            "window = sliding with mains = 50, expected mains = off, since flicker is removed from bursts alone"
        );
    }
}
