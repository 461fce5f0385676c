//! Bursts with other exposures than those of the source, frames of bursts that are not processed, and the mains frequency that is found in
//! bursts.

use super::*;
use crate::calibration::{Calibration, Pixels};
use crate::scene;
use crate::source::{Pace, SceneSource};
use hemilux_core::mains::Lamps;
use hemilux_core::wire::FrameFault;
use std::f64::consts::TAU;
use std::sync::Mutex;

fn overcast() -> SceneSource {
    SceneSource::new(scene::by_name("overcast").expect("a scene"), Pace::Free)
}

/// A worker whose source has the exposure times `declared`, seconds, and whose burst has those of `found`.
fn worker(declared: &[f64], found: &[f64]) -> Worker {
    let mut source = overcast();
    source.set_exposures(Some(declared)).expect("any exposures");
    let mut worker = Worker::try_new(Box::new(source), "test".into(), Config::steady()).expect("a worker");
    receive(&mut worker, found);
    worker
}

fn receive(worker: &mut Worker, seconds: &[f64]) {
    let frame =
        |s: &f64| Frame { exposure: Exposure { seconds: *s, gain: 1.0 }, pixels: Pixels::U8(Vec::new()) };
    worker.burst.frames = seconds.iter().map(frame).collect();
}

#[test]
fn only_a_burst_without_the_shortest_exposure_is_refused() {
    let declared = [1e-3, 6e-3, 33e-3];
    for (found, is_accepted) in [
        (&declared[..], true),
        (&[1e-3, 6e-3], true),
        (&[1e-3], true),
        (&[6e-3, 33e-3], false),
        (&[33e-3], false),
        // Less than 1 % longer than the shortest exposure of the source.
        (&[1.005e-3, 33e-3], true),
        (&[1.02e-3, 33e-3], false),
    ] {
        let checked = worker(&declared, found).check_complete();
        let expected =
            format!("burst: found {} frames without the shortest exposure, expected 3 frames", found.len());
        let expected = if is_accepted { Ok(()) } else { Err(SourceError::Broken(expected)) };
        assert_eq!(checked, expected, "{found:?}");
    }
}

#[test]
fn a_burst_from_before_a_change_of_exposures_is_accepted() {
    let mut worker = worker(&[1e-3, 6e-3, 33e-3], &[1e-3, 6e-3, 33e-3]);
    worker.source.set_exposures(Some(&[0.5e-3, 3e-3, 16e-3])).expect("any exposures");
    assert_eq!(worker.check_complete(), Ok(()), "the exposures known so far");
    // The shortest exposure of the burst equals no exposure of the source.
    receive(&mut worker, &[0.9e-3, 5.4e-3, 30e-3]);
    assert_eq!(worker.check_complete(), Ok(()), "exposures known neither before nor after");
    receive(&mut worker, &[3e-3, 16e-3, 33e-3]);
    assert!(
        worker.check_complete().is_err(),
        "the second exposure of the source is the shortest of the burst"
    );
}

/// Bursts are compared with the exposures of the source without a tolerance: a change of the exposures by less than the margin is shown, too.
#[test]
fn exposures_that_differ_from_the_known_ones_by_a_thousandth_are_shown() {
    let (before, after) = ([1e-3, 6e-3, 33e-3], [1e-3, 6e-3, 33.033e-3]);
    let mut worker = worker(&before, &after);
    worker.source.set_exposures(Some(&after)).expect("any exposures");
    assert_eq!(worker.link.settings.exposures().seconds, before);
    assert_eq!(worker.check_complete(), Ok(()));
    assert_eq!(worker.link.settings.exposures().seconds, after);
}

/// A still scene, one frame per call after the first burst. Call number `at` fails; the frame that it renews is black until it is renewed
/// again.
struct FailingOnce {
    scene: SceneSource,
    calls: usize,
    at: usize,
}

impl Source for FailingOnce {
    fn calibration(&self) -> &Calibration {
        self.scene.calibration()
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.scene.exposures()
    }

    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        self.scene.set_sliding(is_sliding)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.scene.next(burst)?;
        self.calls += 1;
        if !(self.at..self.at + 2).contains(&self.calls) {
            return Ok(());
        }
        // The scene renders all frames that are new to the worker again.
        let index = (self.at - 1) % burst.frames.len();
        if let Pixels::U8(codes) = &mut burst.frames[index].pixels {
            codes.fill(0);
        }
        if self.calls == self.at { Err(SourceError::Broken("a frame".into())) } else { Ok(()) }
    }
}

/// The frames follow each other in the order of the exposures, so that call 10 renews frame 0, and call 11 frame 1.
#[test]
fn a_false_frame_of_a_burst_that_failed_is_named_in_the_next_set() {
    for (at, index) in [(10, 0), (11, 1), (12, 2)] {
        let source = FailingOnce {
            scene: SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free),
            calls: 0,
            at,
        };
        let mut config = Config::steady();
        (config.pipeline.window, config.pipeline.lamps) = (WindowMode::Sliding, Lamps::Off);
        let mut worker = Worker::try_new(Box::new(source), "test".into(), config).expect("a worker");
        for call in 1..=at {
            assert_eq!(worker.step().is_err(), call == at, "call {call}");
        }
        worker.step().expect("a burst");
        let set = worker.link.sets.latest().expect("a set");
        let named: Vec<_> = set.frames_left_out.iter().map(|frame| (frame.index, frame.fault)).collect();
        assert_eq!(named, [(index, FrameFault::Black)], "call {at} fails");
    }
}

/// A still scene whose light is modulated with `hz`, in bursts of three frames at 28 frames per second.
struct Flickering {
    scene: SceneSource,
    hz: f64,
    bursts: u64,
    /// The mains frequencies that the source was told.
    told: Arc<Mutex<Vec<Lamps>>>,
}

impl Source for Flickering {
    fn calibration(&self) -> &Calibration {
        self.scene.calibration()
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.scene.exposures()
    }

    fn set_lamps(&mut self, lamps: Lamps) {
        self.told.lock().expect("not poisoned").push(lamps);
        self.scene.set_lamps(lamps);
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.scene.next(burst)?;
        self.bursts += 1;
        let seconds = self.bursts as f64 * 3.0 / 28.0;
        burst.phase_ns = (seconds * 1e9) as u64;
        let factor = 0.7 + 0.3 * (TAU * self.hz * seconds).sin();
        let black = self.scene.calibration().levels.black;
        for frame in &mut burst.frames {
            if let Pixels::U8(codes) = &mut frame.pixels {
                codes.iter_mut().for_each(|code| {
                    *code = (black + factor * (f64::from(*code) - black)).round() as u8;
                });
            }
        }
        Ok(())
    }
}

/// Runs the worker over bursts of modulated light with the setting `lamps`; returns the mains frequencies that the source was told, and the
/// longest exposure time at the end, milliseconds.
fn told(hz: f64, lamps: Lamps) -> (Vec<Lamps>, f64) {
    let told = Arc::new(Mutex::new(Vec::new()));
    let source = Flickering { scene: overcast(), hz, bursts: 0, told: Arc::clone(&told) };
    let mut config = Config::steady();
    config.pipeline.lamps = lamps;
    let mut worker = Worker::try_new(Box::new(source), "test".into(), config).expect("a worker");
    for _ in 0..40 {
        worker.step().expect("a burst");
    }
    let longest = worker.link.settings.exposures().seconds.last().copied().unwrap_or_default();
    let told = told.lock().expect("not poisoned").clone();
    (told, (longest * 1e4).round() / 10.0)
}

/// By hand: three periods of 100 Hz are 30 ms, four of 120 Hz 33.3 ms. The scene has 33.3 ms without lamps.
#[test]
fn the_mains_frequency_that_is_found_in_bursts_is_passed_to_the_source_once() {
    assert_eq!(told(100.0, Lamps::Auto), (vec![Lamps::Mains50], 30.0));
    assert_eq!(told(120.0, Lamps::Auto), (vec![Lamps::Mains60], 33.3));
    assert_eq!(told(0.0, Lamps::Auto), (vec![], 33.3), "steady light");
}

#[test]
fn a_set_mains_frequency_takes_precedence_over_the_light() {
    assert_eq!(told(120.0, Lamps::Mains50), (vec![Lamps::Mains50], 30.0));
    assert_eq!(told(100.0, Lamps::Off), (vec![Lamps::Off], 33.3));
}
