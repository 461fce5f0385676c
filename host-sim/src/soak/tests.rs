use super::*;
use hemilux::calibration::{Burst, Calibration, Pixels};
use hemilux::source::SourceError;
use hemilux_core::{Exposure, MergeMode};

/// A source whose frames have the light of their lower half multiplied by `factor`.
struct TornFrames {
    inner: Box<dyn Source>,
    factor: f32,
}

impl Source for TornFrames {
    fn calibration(&self) -> &Calibration {
        self.inner.calibration()
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.inner.exposures()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.inner.set_exposures(seconds)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.inner.next(burst)?;
        for frame in &mut burst.frames {
            if let Pixels::U16(codes) = &mut frame.pixels {
                let from = codes.len() / 2;
                codes[from..].iter_mut().for_each(|code| *code = (self.factor * f32::from(*code)) as u16);
            }
        }
        Ok(())
    }
}

/// Processes the first `bursts` bursts of a run of `frames`, with the exposures `seconds`, and judges their sets.
fn judged(
    faults: &str,
    frames: u64,
    bursts: u64,
    seconds: Option<&[f64]>,
    merge: MergeMode,
    wrap: impl FnOnce(Box<dyn Source>) -> Box<dyn Source>,
) -> Outcome {
    let camera = camera(frames).expect("a camera");
    let daylight = camera.daylight();
    let source = FaultSource::new(wrap(Box::new(camera)), faults.parse().expect("faults"));
    let (counts, tally) = (source.counts(), Arc::new(Tally::new()));
    let mut config = Config { exposures_s: seconds.map(<[f64]>::to_vec), ..Config::steady() };
    config.pipeline.merge = merge;
    let mut worker = Worker::try_new(Box::new(source), "soak".into(), config).expect("a worker");
    let link = worker.link();
    let mut judge = SetJudge::new(brightest().expect("a flux"), &daylight, &tally, &counts);
    for _ in 0..bursts {
        let is_ok = worker.step().is_ok();
        judge.judge_burst(&link, is_ok);
    }
    judge.into_outcome()
}

#[test]
fn no_fault_in_dim_light_makes_a_wrong_set() {
    // The light rises from 1/500 to 1/100 of the brightest; rows of the shortest exposure have a mean of one to fourteen codes.
    let two = Some(&[0.000_926, 0.033_333][..]);
    for (seconds, merge) in [(None, MergeMode::All), (two, MergeMode::All), (two, MergeMode::Needed)] {
        for (seed, kind) in ["torn", "swapped", "black", "saturated", "label"].into_iter().enumerate() {
            let faults = format!("{kind}=0.05,sound=8,seed={seed}");
            let outcome = judged(&faults, 8_000, 1_000, seconds, merge, |camera| camera);
            let seen: u64 = outcome.faults.iter().map(|fault| fault.seen).sum();
            assert!(seen > 30, "{kind}: {seen} faults");
            assert_eq!(outcome.wrong, 0, "{kind}, {seconds:?}, {merge:?}: {:#?}", outcome.words);
        }
    }
}

#[test]
fn sets_of_torn_bursts_of_one_exposure_are_wrong() {
    let torn = |factor| move |inner| -> Box<dyn Source> { Box::new(TornFrames { inner, factor }) };
    // A single frame cannot contradict another one, so that the probe merges it.
    let wrong =
        |factor| judged("all=0", 16_000, 50, Some(&[0.033_333]), MergeMode::Needed, torn(factor)).wrong;
    assert_eq!(wrong(1.0), 0, "bursts without a fault");
    // The lower half has about half of the light.
    assert_eq!([wrong(0.8), wrong(1.2)], [50, 50]);
}
