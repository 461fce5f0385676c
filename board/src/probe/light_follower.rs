//! Exposure times that follow the light of the scene.

use crate::calibration::{Burst, Calibration};
use crate::exposure_plan::{Planner, TimeRange};
use crate::noise::Noise;
use crate::source::Source;
use hemilux_core::mains::{Flicker, Lamps};

/// Limit between the flicker frequencies of lamps on mains of 50 Hz (100 Hz) and of 60 Hz (120 Hz), hertz.
const BETWEEN_HZ: f32 = 110.0;

/// Changes the exposure times of a source according to the light in its bursts.
#[derive(Debug, Default)]
pub(super) struct LightFollower {
    /// The exposure planner, and the calibration and the range of exposure times for which it was made; `None`
    /// before the first burst.
    planner: Option<(Calibration, TimeRange, Planner)>,
    /// The mains frequency of the lamps that the source was last told.
    lamps: Lamps,
    /// One bit for each frame index, set if the frame is new since the last plan.
    renewed: u16,
}

impl LightFollower {
    /// Passes to the source the mains frequency of the lamps: that of `setting`, or for [`Lamps::Auto`] the one
    /// found in the burst.
    pub(super) fn follow_lamps(&mut self, source: &mut dyn Source, setting: Lamps, flicker: &Flicker) {
        let found = match flicker.frequency_hz {
            Some(hz) if hz < BETWEEN_HZ => Lamps::Mains50,
            Some(_) => Lamps::Mains60,
            None => self.lamps,
        };
        let lamps = if setting == Lamps::Auto { found } else { setting };
        if lamps != self.lamps {
            self.lamps = lamps;
            source.set_lamps(lamps);
        }
    }

    /// Passes to a new source the mains frequency of the lamps that the earlier source was last told.
    pub(super) fn greet(&self, source: &mut dyn Source) {
        source.set_lamps(self.lamps);
    }

    /// Plans the exposures of the bursts after `burst`, in which the fraction `clipped` of the light is clipped. Returns true if the
    /// exposures change.
    ///
    /// Exposures are planned when each frame of `burst` is new since the last plan: in a sliding window, once per round of all exposures.
    /// Sources of fixed exposures are left unchanged. A burst whose exposures differ from the present ones of the source is ignored: it is
    /// incomplete, or from before a change of exposures.
    pub(super) fn follow(&mut self, source: &mut dyn Source, burst: &Burst, clipped: f64) -> bool {
        let Some(range) = source.exposure_range() else { return false };
        if !burst.frames.iter().map(|frame| frame.exposure).eq(source.exposures()) {
            self.renewed = 0;
            return false;
        }
        self.renewed |= !burst.stale;
        if !(0..burst.frames.len()).all(|index| self.renewed >> (index & 15) & 1 != 0) {
            return false;
        }
        self.renewed = 0;
        let calibration = source.calibration();
        let is_other = |(c, r, _): &(Calibration, TimeRange, Planner)| c != calibration || *r != range;
        if self.planner.as_ref().is_none_or(is_other) {
            let levels = calibration.levels;
            let assumed = || Noise::assumed(levels.black, levels.white - levels.black);
            let noise = source.noise().unwrap_or_else(assumed);
            self.planner =
                Planner::new(calibration, range, &noise).map(|planner| (*calibration, range, planner));
        }
        let next = self.planner.as_mut().and_then(|(_, _, planner)| planner.next(burst, clipped));
        let Some(seconds) = next else { return false };
        match source.set_exposures(Some(&seconds)) {
            Ok(()) => tracing::debug!("exposures follow the light: {seconds:?} s"),
            Err(why) => tracing::warn!("exposures that follow the light: {why}"),
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::{Pipeline, Settings};
    use crate::scene;
    use crate::source::{Pace, SceneSource, SourceError};
    use hemilux_core::Exposure;

    /// Follows a scene for `bursts` bursts, the first with the exposure times `seconds`; returns the exposure times, seconds,
    /// and the clipped fraction of light of each burst.
    fn follow(name: &str, seconds: &[f64], bursts: usize) -> Vec<(Vec<f64>, f64)> {
        let mut source = SceneSource::new(scene::by_name(name).expect("a scene"), Pace::Free);
        source.set_exposures(Some(seconds)).expect("any exposures");
        let mut pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), Settings::default())
            .expect("a pipeline");
        let (mut follower, mut burst) = (LightFollower::default(), Burst::default());
        let mut all = Vec::new();
        for _ in 0..bursts {
            source.next(&mut burst).expect("a burst");
            let clipped = pipeline.process(&burst).expect("lights").seen.clipped;
            all.push((source.exposures().iter().map(|e| e.seconds).collect(), clipped));
            follower.follow(&mut source, &burst, clipped);
        }
        all
    }

    #[test]
    fn few_exposures_cover_each_scene_from_the_third_burst() {
        // The overcast sky has a ratio of three between zenith and horizon; the lamps of the other scenes are hundreds of times as bright as the
        // walls.
        for (name, most) in [("overcast", 1), ("room", 3), ("sky", 3), ("lamps", 3)] {
            for first in [&[1e-4][..], &[0.033], &[0.000_926, 0.005_555, 0.033_333]] {
                let bursts = follow(name, first, 8);
                for (seconds, clipped) in &bursts[2..] {
                    assert!(*clipped <= 0.001, "{name} from {first:?}: {bursts:?}");
                    assert!((1..=most).contains(&seconds.len()), "{name} from {first:?}: {bursts:?}");
                }
            }
        }
    }

    /// A scene whose noise is known.
    struct Noisy(SceneSource, Noise);

    impl Source for Noisy {
        fn calibration(&self) -> &Calibration {
            self.0.calibration()
        }

        fn exposures(&self) -> Vec<Exposure> {
            self.0.exposures()
        }

        fn noise(&self) -> Option<Noise> {
            Some(self.1)
        }

        fn exposure_range(&self) -> Option<TimeRange> {
            self.0.exposure_range()
        }

        fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
            self.0.set_exposures(seconds)
        }

        fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
            self.0.next(burst)
        }
    }

    /// The noise of a sample limits how dark a covered sample is: with a read noise of 5 % of the range, a sky whose radiances have a ratio
    /// of three needs two exposures.
    #[test]
    fn measured_noise_replaces_the_assumed_noise() {
        let planned = |noise: Option<f64>| {
            let scene = SceneSource::new(scene::by_name("overcast").expect("a scene"), Pace::Free);
            let levels = scene.calibration().levels;
            let codes = levels.white - levels.black;
            let mut source: Box<dyn Source> = match noise {
                Some(part) => Box::new(Noisy(
                    scene,
                    Noise { read: part * codes, gain: codes / 5e3, dark: levels.black },
                )),
                None => Box::new(scene),
            };
            source.set_exposures(Some(&[1e-4])).expect("any exposures");
            let (mut follower, mut burst) = (LightFollower::default(), Burst::default());
            for _ in 0..4 {
                source.next(&mut burst).expect("a burst");
                follower.follow(source.as_mut(), &burst, 0.0);
            }
            source.exposures().len()
        };
        assert_eq!([planned(None), planned(Some(1e-4)), planned(Some(0.05))], [1, 1, 2]);
    }

    #[test]
    fn bursts_with_other_exposures_than_the_source_are_ignored() {
        let mut source = SceneSource::new(scene::by_name("overcast").expect("a scene"), Pace::Free);
        let mut burst = Burst::default();
        source.next(&mut burst).expect("a burst");
        burst.frames.pop();
        let before = source.exposures();
        assert!(!LightFollower::default().follow(&mut source, &burst, 0.5), "an incomplete burst");
        assert_eq!(source.exposures(), before);
    }
}
