//! Each kind of fault, tested through the processing thread and the server.

use super::*;
use crate::probe::{Config, Probe, Worker};
use crate::scene;
use crate::server::{Options, app};
use crate::source::{Pace, ReplaySource, SceneSource};
use axum::body::Body;
use axum::http::Request;
use serde_json::Value;
use std::time::Duration;
use tower::ServiceExt;

/// Number of bursts for each kind of fault; the environment variable `HEMILUX_FAULT_BURSTS` replaces it.
const BURSTS: u64 = 150;

/// Number of bursts without faults at the start, from which the probe learns the usual light of the source.
const SOUND: u64 = 8;

/// Largest accepted relative difference between the flux of a set and that of its burst.
const WRONG: f32 = 0.04;

/// Returns a source that repeats the first burst of a scene, so that the light is constant.
fn recording(scene: &str, pace: Pace) -> ReplaySource {
    let mut scene = SceneSource::new(scene::by_name(scene).expect("a scene"), Pace::Free);
    let mut burst = Burst::default();
    scene.next(&mut burst).expect("a burst");
    let bursts = vec![burst];
    ReplaySource::of_bursts(*scene.calibration(), bursts, pace).expect("bursts")
}

fn spec(text: &str) -> FaultSpec {
    text.parse().expect("a specification")
}

/// Counts over a run of bursts with faults.
#[derive(Debug, Default)]
struct Outcome {
    sets: u64,
    refused: u64,
    with_frames_left_out: u64,
    /// Largest number of bursts from a fault to the next set with all of its frames; 1 is the next burst.
    recovery: u64,
    /// Descriptions of the violated expectations.
    wrong: Vec<String>,
}

/// Names of the scenes, from an overcast sky to a sunlit one.
const SCENES: [&str; 3] = ["overcast", "room", "sky"];

/// Processes `bursts` bursts with `faults` of each of [`SCENES`].
fn run(faults: &str, bursts: u64) -> Outcome {
    let mut all = Outcome::default();
    for scene in SCENES {
        let one = run_scene(scene, faults, bursts);
        println!("{scene}, {faults}: {one:?}");
        all.refused += one.refused;
        all.with_frames_left_out += one.with_frames_left_out;
        all.wrong.extend(one.wrong);
    }
    assert!(all.wrong.is_empty(), "{faults}: {:#?}", all.wrong);
    all
}

/// Processes `bursts` bursts of a scene with `faults`; the flux of each set is compared with that of the bursts without faults.
fn run_scene(scene: &str, faults: &str, bursts: u64) -> Outcome {
    let recording = |pace| recording(scene, pace);
    let mut sound =
        Worker::try_new(Box::new(recording(Pace::Free)), "sound".into(), Config::steady()).expect("a worker");
    sound.step().expect("a frame");
    let expected = sound.link().sets().latest().expect("a set").scalar_flux;
    let spec = FaultSpec { sound: SOUND, ..spec(faults) };
    let source = FaultSource::new(Box::new(recording(Pace::Free)), spec);
    let counts = source.counts();
    let total = || counts.named().map(|(_, n)| n).sum::<u64>();
    let mut worker = Worker::try_new(Box::new(source), "faults".into(), Config::steady()).expect("a worker");
    let (mut outcome, mut since, mut last_ns) = (Outcome::default(), None, 0);
    for burst in 0..bursts {
        let before = total();
        let is_ok = worker.step().is_ok();
        since = if total() > before { Some(0) } else { since.map(|n| n + 1) };
        let set = worker.link().sets().latest().expect("the first bursts are sound");
        let away = set.scalar_flux.iter().zip(expected).map(|(a, b)| (a / b - 1.0).abs());
        let away = away.fold(0.0, f32::max);
        let left_out = &set.frames_left_out;
        if away > WRONG {
            let line = format!("{scene}: burst {burst}: flux differs by {away}: {left_out:?}, {counts:?}");
            outcome.wrong.push(line);
        }
        outcome.sets += u64::from(is_ok);
        outcome.refused += u64::from(!is_ok);
        if is_ok {
            assert!(set.timestamp_ns > last_ns, "{faults}: burst {burst}: time goes on");
            assert!(crate::clock::monotonic_ns() - set.timestamp_ns < 5_000_000_000, "{faults}: not older");
            last_ns = set.timestamp_ns;
        }
        let is_whole = is_ok && set.frames_left_out.is_empty();
        outcome.with_frames_left_out += u64::from(is_ok && !is_whole);
        match since {
            Some(bursts) if is_whole && bursts > 0 => {
                outcome.recovery = outcome.recovery.max(bursts);
                since = None;
            }
            Some(bursts) if bursts > 2 => outcome.wrong.push(format!("{scene}: burst {burst}: no recovery")),
            Some(_) => {}
            None if is_whole => {}
            None => outcome.wrong.push(format!("{scene}: sound burst {burst}: {left_out:?}")),
        }
    }
    assert!(total() > bursts / 50, "{faults}: {} of {bursts} bursts were damaged", total());
    outcome
}

fn bursts() -> u64 {
    std::env::var("HEMILUX_FAULT_BURSTS").ok().and_then(|n| n.parse().ok()).unwrap_or(BURSTS)
}

#[test]
fn wrong_frames_make_no_wrong_set_and_the_second_burst_after_them_is_complete() {
    for kind in ["torn", "black", "saturated", "swapped", "label"] {
        let outcome = run(&format!("{kind}=0.05,seed=3"), bursts());
        assert!(outcome.with_frames_left_out + outcome.refused > 0, "{kind}: {outcome:?}");
    }
}

#[test]
fn incomplete_late_and_misdated_bursts_make_no_wrong_set() {
    for kind in ["drop", "size", "clock", "late", "vanish"] {
        let outcome = run(&format!("{kind}=0.05,seed=5,late_s=0.01,gone_s=0"), bursts());
        assert_eq!(outcome.refused > 0, ["drop", "size", "vanish"].contains(&kind), "{kind}: {outcome:?}");
    }
}

#[test]
fn faults_of_every_kind_together_make_no_wrong_set() {
    let outcome = run("all=0.01,seed=9,late_s=0.001,gone_s=0,hang_s=0.01", 2 * bursts());
    assert!(outcome.refused > 0 && outcome.with_frames_left_out > 0, "{outcome:?}");
}

#[test]
fn a_step_of_the_wall_clock_changes_the_wall_time_of_sets_alone() {
    const HOUR_MS: i64 = 3_600_000;
    let source = recording("room", Pace::Free);
    let mut worker = Worker::try_new(Box::new(source), "clock".into(), Config::steady()).expect("a worker");
    let link = worker.link();
    let mut sets = Vec::new();
    for step_ms in [0, HOUR_MS, -HOUR_MS] {
        crate::clock::step::WALL_MS.set(step_ms);
        for _ in 0..10 {
            worker.step().expect("a set");
            let set = link.sets().latest().expect("a set");
            assert!(link.staleness(&set).age_ms < 5000, "step of {step_ms} ms: {:?}", link.staleness(&set));
            sets.push((step_ms, set));
        }
    }
    let (_, first) = &sets[0];
    for pair in sets.windows(2) {
        let [(_, before), (step_ms, set)] = pair else { unreachable!("pairs") };
        assert!(set.timestamp_ns > before.timestamp_ns, "step of {step_ms} ms: time goes on");
        assert_eq!(
            (set.scalar_flux, &set.flicker),
            (first.scalar_flux, &first.flicker),
            "step of {step_ms} ms"
        );
        let stepped = set.wall_ms.cast_signed() - first.wall_ms.cast_signed() - step_ms;
        assert!((0..60_000).contains(&stepped), "step of {step_ms} ms: {stepped} ms more");
    }
}

async fn lights(probe: &Probe) -> Value {
    let router = app(probe.link(), Options::default()).router();
    let request =
        Request::get("/v1/lights").header("host", "localhost").body(Body::empty()).expect("a request");
    let response = router.oneshot(request).await.expect("an answer");
    let bytes = axum::body::to_bytes(response.into_body(), 1 << 20).await.expect("a body");
    serde_json::from_slice(&bytes).expect("JSON")
}

#[tokio::test]
async fn while_a_source_hangs_or_is_gone_the_last_set_is_returned_as_stale() {
    for kind in ["hang", "vanish"] {
        let source = recording("overcast", Pace::Every(Duration::from_millis(20)));
        let source =
            FaultSource::new(Box::new(source), spec(&format!("{kind}=0.2,hang_s=4,gone_s=4,seed=2")));
        let counts = source.counts();
        let probe = Probe::start(Box::new(source), "test".into(), Config::steady()).expect("a probe");
        let began = Instant::now();
        while counts.named().all(|(_, n)| n == 0) || probe.link().sets().latest().is_none() {
            assert!(began.elapsed() < Duration::from_secs(10), "{kind}: no fault");
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        let failed_at = Instant::now();
        let stale = lights(&probe).await;
        assert!(stale["stale"]["age_ms"].as_u64().is_some() && stale["valid"] == true, "{kind}: {stale}");
        assert!(failed_at.elapsed() < Duration::from_secs(4), "{kind}: answered while it lasts");
        tokio::time::sleep(Duration::from_secs(4).saturating_sub(failed_at.elapsed())).await;
        let fresh = loop {
            let set = lights(&probe).await;
            if set["stale"].is_null() {
                break set;
            }
            assert!(failed_at.elapsed() < Duration::from_secs(20), "{kind}: {set}");
        };
        assert!(fresh["frame"].as_u64() > stale["frame"].as_u64(), "{kind}: another frame");
    }
}

#[test]
fn valid_specifications_are_parsed_and_others_refused_on_one_line() {
    let read = spec("all=0.01,hang=0,seed=7,gone_s=0.5");
    assert_eq!((read.shares[0], read.shares[10], read.seed), (0.01, 0.0, 7));
    assert_eq!(read.gone, Duration::from_millis(500));
    for text in ["", "black", "black=2", "blue=0.1", "seed=-1", "hang_s=1e9", "all=0.2", "black=nan"] {
        let line = text.parse::<FaultSpec>().expect_err(text);
        assert!(line.starts_with("found ") && line.contains("expected") && !line.contains('\n'), "{line}");
    }
}

#[test]
fn equal_seeds_give_equal_faults_in_the_stated_share() {
    let draw = |seed| {
        let (spec, mut random) = (spec("all=0.05"), Random(seed));
        (0..10_000).map(|_| spec.choose(random.part())).collect::<Vec<_>>()
    };
    let faults = draw(1);
    assert!(faults == draw(1) && faults != draw(2), "by the seed alone");
    for kind in Fault::ALL {
        let count = faults.iter().filter(|fault| **fault == Some(kind)).count();
        // The number of faults is binomial with a mean of 500 and a standard deviation of 22.
        assert!((400..600).contains(&count), "{kind:?}: {count}");
    }
}
