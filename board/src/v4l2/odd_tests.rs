//! Cameras that contradict the documentation of V4L2 or the values that their drivers report: no exposure is wrong, and bursts are delivered if
//! the camera can take them.

use super::capture::Camera;
use super::device;
use super::fake::{FakeKernel, Manner, Quirk, Script};
use super::frame::RawFrame;
use super::schedule::Known;
use super::supervise::{Outcome, Supervisor};
use super::tests::options;
use std::time::Duration;

/// Result of running a camera for a minute of simulated time.
#[derive(Debug, Default)]
struct Minute {
    frames: usize,
    /// Number of frames whose exposure is verified or measured.
    certain: usize,
    /// Number of frames whose reported exposure differs from the true one by more than 10 %.
    wrong: usize,
    /// Number of frames whose exposure is verified or measured, and differs from the true one by more than 10
    /// %.
    wrong_certain: usize,
    /// Number of exposures of a burst.
    exposures: usize,
    reopened: u64,
    lost: u64,
    resyncs: u64,
    /// Reasons for which the camera was closed during the minute.
    down: Vec<String>,
}

fn script(quirks: &[Quirk]) -> Script {
    Script { quirks: quirks.into(), ..Script::default() }
}

/// Runs a camera for a minute of simulated time and compares each exposure with the true one, up to a common factor.
fn minute(script: Script) -> Minute {
    let kernel = FakeKernel::new(script);
    let mut supervisor = Supervisor::open(Box::new(kernel.clone()), options()).expect("a camera");
    let (begun, mut frame, mut minute) = (kernel.world().now_ns, RawFrame::default(), Minute::default());
    while kernel.world().now_ns - begun < 60_000_000_000 {
        match supervisor.step(&mut frame) {
            Outcome::Frame => {}
            Outcome::Nothing => continue,
            Outcome::Down(reason) => {
                minute.down.push(reason);
                continue;
            }
        }
        minute.frames += 1;
        let Some(camera) = supervisor.camera() else { continue };
        minute.exposures = camera.settings().len();
        minute.lost = camera.counters().lost;
        minute.resyncs = camera.counters().resyncs;
        let is_certain = matches!(frame.taken.known, Known::Verified | Known::Measured);
        minute.certain += usize::from(is_certain);
        let Some(slot) = frame.taken.slot else { continue };
        let world = kernel.world();
        let Some(value) = world.last_fetched else { continue };
        let off = (camera.seconds()[slot] / (1e-4 * world.really(value) as f64)).ln().abs();
        minute.wrong += usize::from(off > 0.1);
        minute.wrong_certain += usize::from(off > 0.1 && is_certain);
    }
    minute.reopened = supervisor.reopened();
    minute
}

/// Expected result of a minute of a camera with a frame rate of 25 Hz.
struct Expected {
    quirk: Quirk,
    exposures: usize,
    /// Least number of frames, and least number of frames whose exposure is verified or measured.
    frames: usize,
    certain: usize,
}

fn assert_minute(expected: &Expected, found: &Minute) {
    let text = format!("{:?}: {found:?}", expected.quirk);
    println!("{text}");
    assert_eq!(found.exposures, expected.exposures, "{text}");
    assert!(found.frames >= expected.frames && found.certain >= expected.certain, "{text}");
    assert!(found.wrong_certain == 0 && found.reopened == 0, "{text}");
}

const MS: fn(u64) -> Duration = Duration::from_millis;

#[test]
fn exposure_controls_that_read_back_wrong_values_still_set_a_burst() {
    for quirk in [Quirk::ReadsAs(156), Quirk::ReadsOld, Quirk::Unreadable, Quirk::NoMenu] {
        let found = minute(script(&[quirk]));
        assert_minute(&Expected { quirk, exposures: 3, frames: 1490, certain: 900 }, &found);
        assert_eq!(found.wrong, 0, "{quirk:?}: {found:?}");
    }
}

#[test]
fn controls_that_are_written_late_or_in_vain_make_no_wrong_exposure() {
    for (quirk, certain) in [
        (Quirk::SlowWrites(MS(10)), 900),
        (Quirk::SlowWrites(MS(30)), 400),
        (Quirk::SlowWrites(MS(60)), 200),
        (Quirk::Forgets(50), 900),
        (Quirk::AutomaticAgain(700), 900),
        (Quirk::RepeatsPicture(50), 900),
        (Quirk::DarkStart(20), 900),
    ] {
        let found = minute(script(&[quirk]));
        assert_minute(&Expected { quirk, exposures: 3, frames: 1400, certain }, &found);
        assert_eq!(found.wrong, 0, "{quirk:?}: {found:?}");
    }
}

/// No constant control delay describes such a camera; with equal steps between the exposures, a few ratios agree by
/// chance.
#[test]
fn a_control_delay_that_varies_makes_few_frames_certain() {
    let found = minute(script(&[Quirk::Jitters]));
    println!("Jitters: {found:?}");
    assert!(found.exposures == 3 && found.reopened == 0, "{found:?}");
    assert!(found.wrong_certain <= 30 && found.certain < 300, "{found:?}");
}

#[test]
fn frame_numbers_that_do_not_count_frames_lose_few_frames() {
    for (quirk, frames) in [
        (Quirk::Unnumbered, 1490),
        (Quirk::EverySecond, 1490),
        (Quirk::JumpsAhead(100), 1490),
        (Quirk::Restarts(300), 1480),
    ] {
        let found = minute(script(&[quirk]));
        assert_minute(&Expected { quirk, exposures: 3, frames, certain: 900 }, &found);
        assert!(found.wrong <= 5, "{quirk:?}: {found:?}");
        assert!(found.lost < 30, "{quirk:?}: {found:?}");
    }
}

#[test]
fn requests_that_fail_occasionally_lose_a_frame_and_the_camera_stays_open() {
    for (quirk, frames) in [
        (Quirk::DequeueFails(100), 1470),
        (Quirk::StartFails(2), 1490),
        (Quirk::StartIsBusy(6), 1490),
        (Quirk::Oversized, 1490),
        (Quirk::Ranges, 1490),
        (Quirk::NoStride, 1490),
    ] {
        let found = minute(script(&[quirk]));
        assert_minute(&Expected { quirk, exposures: 3, frames, certain: 900 }, &found);
    }
    let busy = Camera::open(&mut FakeKernel::new(script(&[Quirk::StartIsBusy(1000)])), &options());
    let line = busy.err().expect("busy").to_string();
    assert!(line.starts_with("/dev/video0: STREAMON: found Device or resource busy"), "{line}");
}

#[test]
fn frame_rates_other_than_the_reported_one_are_followed() {
    let found = minute(script(&[Quirk::Slows]));
    assert_minute(&Expected { quirk: Quirk::Slows, exposures: 3, frames: 1000, certain: 700 }, &found);
    let (quirk, period) = (Quirk::ReportsInterval, MS(130));
    let found = minute(Script { period, ..script(&[quirk]) });
    assert_minute(&Expected { quirk, exposures: 3, frames: 440, certain: 280 }, &found);
    assert_eq!(found.wrong, 0, "{found:?}");
    let cameras = device::list(&mut FakeKernel::new(script(&[Quirk::Ranges]))).expect("cameras");
    let sizes: Vec<_> = cameras[0].formats[0].sizes.iter().map(|s| (s.width, s.height)).collect();
    assert_eq!(sizes, [(32, 24), (128, 96)], "the ends of the range");
    assert_eq!(cameras[0].formats[0].sizes[0].rates, [50.0, 5.0], "the ends of the range");
}

#[test]
fn inverted_and_ineffective_controls_are_reported_and_not_used() {
    for (script, told) in [
        (script(&[Quirk::Inverted]), "shorter exposures for larger values: one exposure is used"),
        (
            Script { accepts: Some(vec![156]), manner: Manner::Ignores, light: 1.0, ..script(&[]) },
            "no effect: one exposure is used",
        ),
    ] {
        let camera = Camera::open(&mut FakeKernel::new(script.clone()), &options()).expect("a camera");
        let lines: Vec<_> = camera.agreed().iter().map(|a| a.got.as_str()).collect();
        assert!(lines.contains(&told), "{lines:?}");
        let found = minute(script);
        assert!(found.exposures == 1 && found.certain == 0 && found.frames > 1490, "{found:?}");
    }
}
