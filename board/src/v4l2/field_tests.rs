//! Tests against simulated faults that were reported for real cameras.
use super::Size;
use super::capture::Camera;
use super::fake::{FakeKernel, Script};
use super::frame::RawFrame;
use super::schedule::Known;
use super::setup::Options;
use super::supervise::{Outcome, Supervisor};
use hemilux_core::Response;

/// Exposures that a common webcam accepts, units of 100 us.
const COARSE: [i64; 8] = [5, 10, 20, 39, 78, 156, 312, 625];

fn open(script: Script, exposures_s: [f64; 3]) -> (FakeKernel, Supervisor) {
    let kernel = FakeKernel::new(script);
    let options = Options {
        size: Size::new(64, 48),
        exposures_s: exposures_s.into(),
        response: Some(Response::Linear),
        ..Options::of("/dev/video0")
    };
    let supervisor = Supervisor::open(Box::new(kernel.clone()), options).expect("a camera");
    (kernel, supervisor)
}

/// One write in a hundred fails, as with some USB cameras. The camera stays open over 60 s (1500 frames).
#[test]
fn a_failed_write_loses_a_frame_and_the_camera_stays_open() {
    let script = Script { fail_write_every: 100, ..Script::default() };
    let (kernel, mut supervisor) = open(script, [0.001, 0.006, 0.036]);
    let (begun, mut frame, mut frames) = (kernel.world().now_ns, RawFrame::default(), 0);
    while kernel.world().now_ns - begun < 60_000_000_000 {
        match supervisor.step(&mut frame) {
            Outcome::Frame => frames += 1,
            Outcome::Nothing => {}
            Outcome::Down(why) => println!("{why}"),
        }
    }
    assert!(
        supervisor.reopened() == 0 && frames > 1400,
        "{frames} frames, reopened {}",
        supervisor.reopened()
    );
}

/// The test requests exposures of 0.9, 5.5 and 33.3 ms; near these, the camera has 1.0, 3.9, 7.8 and 31.2 ms.
#[test]
fn a_camera_with_a_list_of_exposures_is_set_to_the_nearest() {
    let script = Script { accepts: Some(COARSE.into()), range: (5, 20000), ..Script::default() };
    let (_kernel, supervisor) = open(script, [0.0009, 0.0055, 0.0333]);
    let values: Vec<_> = supervisor.camera().expect("up").settings().iter().map(|s| s.value).collect();
    assert_eq!(values.len(), 3, "three exposures, not {values:?}");
}

/// The control reads back the written value, but the sensor uses another one: frames of such a camera must not count
/// as verified.
#[test]
fn exposures_that_differ_from_the_control_are_not_verified() {
    let script = Script { really: Some(COARSE.into()), range: (5, 20000), ..Script::default() };
    let (kernel, mut supervisor) = open(script, [0.0009, 0.0055, 0.0333]);
    let (mut frame, mut wrong, mut count) = (RawFrame::default(), 0, 0);
    while count < 500 {
        if supervisor.step(&mut frame) != Outcome::Frame {
            continue;
        }
        count += 1;
        let Some(slot) = frame.taken.slot else { continue };
        let said = supervisor.camera().map(Camera::settings).expect("up")[slot].value;
        let world = kernel.world();
        let was = world.really(world.truth[&frame.taken.sequence]);
        let off = (said as f64 / was as f64).ln().abs();
        wrong += usize::from(frame.taken.known == Known::Verified && off > 0.1);
    }
    assert_eq!(wrong, 0, "verified frames whose exposure is more than 10 % off");
}
