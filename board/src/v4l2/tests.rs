//! Tests of the camera with the scripted kernel: the exposure of every frame, with and without faults.

use super::Size;
use super::abi;
use super::capture::Camera;
use super::fake::{FakeKernel, Fault, Kind, Manner, Quirk, Script};
use super::frame::{Broken, RawFrame};
use super::schedule::Known;
use super::setup::{Options, StandIn};
use super::{CameraError, device};
use hemilux_core::Response;
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

pub(super) fn options() -> Options {
    Options {
        size: Size::new(64, 48),
        exposures_s: vec![0.001, 0.006, 0.036],
        response: Some(Response::Linear),
        ..Options::of("/dev/video0")
    }
}

/// Numbers of frames of a run, by the correctness of the reported exposure.
#[derive(Debug, Default)]
struct Tally {
    frames: usize,
    right: usize,
    wrong: usize,
    verified: usize,
}

/// Takes `count` frames and compares their reported exposures with the true ones.
fn run(camera: &mut Camera, kernel: &mut FakeKernel, count: usize) -> Tally {
    let (mut frame, mut tally) = (RawFrame::default(), Tally::default());
    while tally.frames < count {
        if !camera.next(kernel, SECOND, &mut frame).expect("a camera that goes on") {
            continue;
        }
        tally.frames += 1;
        tally.verified += usize::from(frame.taken.known == Known::Verified);
        let Some(slot) = frame.taken.slot else { continue };
        let truth = kernel.world().truth[&frame.taken.sequence];
        let right = camera.settings()[slot].value == truth;
        tally.right += usize::from(right);
        tally.wrong += usize::from(!right);
    }
    tally
}

#[test]
fn exposures_are_right_for_delays_of_0_to_4_frames_with_losses_and_signals() {
    for delay in 0..=4 {
        let mut kernel = FakeKernel::new(Script { delay, loss: 0.05, interrupt: 7, ..Script::default() });
        let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
        assert_eq!(camera.delay(), Some(delay), "found by the step test");
        let tally = run(&mut camera, &mut kernel, 3000);
        let (lost, counters) = (camera.counters().lost, camera.counters());
        println!("delay {delay}: {tally:?}, {counters:?}");
        assert!(lost > 100, "frames were lost: {lost}");
        assert_eq!(
            (tally.wrong, counters.mismatches, counters.resyncs),
            (0, 0, 0),
            "delay {delay}: {tally:?}"
        );
        assert_eq!(tally.right, tally.frames, "every frame has its exposure");
        assert!(tally.verified > tally.frames / 2, "delay {delay}: {tally:?}");
    }
}

#[test]
fn every_three_frames_hold_one_burst_of_three_exposures() {
    let mut kernel = FakeKernel::new(Script { delay: 3, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let mut frame = RawFrame::default();
    let mut slots = Vec::new();
    while slots.len() < 30 {
        camera.next(&mut kernel, SECOND, &mut frame).expect("a frame");
        slots.extend(frame.taken.slot);
    }
    for three in slots[10..].windows(3) {
        let mut three = three.to_vec();
        three.sort_unstable();
        assert_eq!(three, [0, 1, 2], "a burst in every three frames: {slots:?}");
    }
}

#[test]
fn a_wrong_delay_is_corrected_and_counted() {
    for (believed, real) in [(2, 1), (0, 3), (4, 2), (1, 4)] {
        let mut kernel = FakeKernel::new(Script { delay: real, loss: 0.05, ..Script::default() });
        let mut camera =
            Camera::open(&mut kernel, &Options { delay: Some(believed), ..options() }).expect("a camera");
        run(&mut camera, &mut kernel, 60);
        let counters = camera.counters();
        assert_eq!(
            (camera.delay(), counters.resyncs),
            (Some(real), 1),
            "{believed} for {real}: {counters:?}"
        );
        assert!(counters.mismatches > 0, "counted");
        let after = run(&mut camera, &mut kernel, 500);
        assert_eq!(after.wrong, 0, "{believed} for {real}: {after:?}");
    }
}

#[test]
fn a_delay_that_changes_while_streaming_is_measured_again() {
    let faults = vec![(400, Fault::Delay(3))];
    let mut kernel = FakeKernel::new(Script { delay: 1, loss: 0.05, faults, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    run(&mut camera, &mut kernel, 600);
    assert_eq!((camera.delay(), camera.counters().resyncs), (Some(3), 1), "{:?}", camera.counters());
    assert_eq!(run(&mut camera, &mut kernel, 500).wrong, 0, "right again");
}

#[test]
fn clamped_exposures_are_reported_with_the_granted_value() {
    let mut kernel = FakeKernel::new(Script { range: (20, 100), ..Script::default() });
    let camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let got: Vec<_> = camera.settings().iter().map(|s| (s.value, s.asked_s, s.seconds)).collect();
    assert_eq!(got, [(20, 0.001, 0.002), (60, 0.006, 0.006), (100, 0.036, 0.01)], "asked and got");
    let told: Vec<_> =
        camera.agreed().iter().map(|a| format!("{}: {} -> {}", a.what, a.asked, a.got)).collect();
    assert!(told.contains(&"exposure: 36.00 ms -> 10.00 ms".into()), "{told:?}");
}

#[test]
fn automatic_modes_of_a_uvc_camera_are_switched_off() {
    let mut kernel = FakeKernel::new(Script::default());
    let _camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let world = kernel.world();
    let mode = world.written.iter().position(|w| *w == (abi::EXPOSURE_AUTO, 1));
    let time = world.written.iter().position(|w| w.0 == abi::EXPOSURE_ABSOLUTE);
    assert!(mode.is_some() && mode < time, "manual before the time: {:?}", world.written);
    assert!(world.written.contains(&(abi::DYNAMIC_FRAME_RATE, 0)), "the frame rate stays");
}

#[test]
fn controls_that_streamon_resets_are_set_again() {
    let mut kernel = FakeKernel::new(Script { reset_at_start: true, loss: 0.05, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let tally = run(&mut camera, &mut kernel, 1000);
    assert_eq!(tally.wrong, 0, "{tally:?}");
    assert!(tally.verified > 500, "{tally:?}");
    let held = [abi::EXPOSURE_AUTO, abi::AUTO_WHITE_BALANCE, abi::SHARPNESS, abi::DYNAMIC_FRAME_RATE];
    assert_eq!(held.map(|id| kernel.world().control(id)), [1, 0, 0, 0], "manual, and all automatics off");
    assert!(camera.agreed().iter().any(|a| a.got == "reset, set again"), "{:?}", camera.agreed());
}

#[test]
fn a_control_that_cannot_be_switched_off_is_named() {
    let mut kernel = FakeKernel::new(Script { least_sharpness: 2, ..Script::default() });
    let camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let refused: Vec<_> = camera.agreed().iter().filter(|a| a.what == "control").collect();
    assert_eq!(refused.len(), 1, "{refused:?}");
    assert_eq!((refused[0].asked.as_str(), refused[0].got.as_str()), ("Sharpness = 0", "2"), "by name");
}

/// For requests of 0.9, 5.5 and 33.3 ms, the sensor exposes for 1.0, 3.9 and 31.2 ms.
#[test]
fn exposures_that_differ_from_the_control_are_measured() {
    let really = Some(vec![5, 10, 20, 39, 78, 156, 312, 625]);
    let mut kernel = FakeKernel::new(Script { really, range: (5, 20000), ..Script::default() });
    let options = Options { exposures_s: vec![0.0009, 0.0055, 0.0333], ..options() };
    let mut camera = Camera::open(&mut kernel, &options).expect("a camera");
    run(&mut camera, &mut kernel, 100);
    let (seconds, true_s) = (camera.seconds(), [0.001, 0.0039, 0.0312]);
    for (k, pair) in seconds.windows(2).enumerate() {
        let off = pair[1] / pair[0] / (true_s[k + 1] / true_s[k]);
        assert!((off - 1.0).abs() < 0.05, "step {k}: {off}, {seconds:?}");
    }
    let mut frame = RawFrame::default();
    let mut known = Vec::new();
    while known.len() < 100 {
        camera.next(&mut kernel, SECOND, &mut frame).expect("a frame");
        known.push(frame.taken.known);
    }
    let count = |k: Known| known.iter().filter(|f| **f == k).count();
    assert!(count(Known::Measured) > 50 && count(Known::Verified) == 0, "{known:?}");
    assert_eq!(camera.counters().mismatches, 0, "not contradicted: measured");
}

/// Cameras with a list of exposures refuse, ignore or round down other values; each uses the nearest value of its list.
#[test]
fn the_nearest_of_an_exposure_list_is_found_for_each_way_of_refusing() {
    for (list, expected) in
        [(vec![3, 50, 123, 250, 900], vec![3, 50, 250]), (vec![7, 70, 300], vec![7, 70, 300])]
    {
        for manner in [Manner::Refuses, Manner::Ignores, Manner::RoundsDown] {
            let script =
                Script { accepts: Some(list.clone()), manner, range: (1, 20000), ..Script::default() };
            let options = Options { exposures_s: vec![0.0005, 0.0055, 0.0333], ..options() };
            let camera = Camera::open(&mut FakeKernel::new(script), &options).expect("a camera");
            let values: Vec<_> = camera.settings().iter().map(|s| s.value).collect();
            assert_eq!(values, expected, "{manner:?} of {list:?}");
        }
    }
}

/// The line time is 100 us: 64 + 936 pixels at 10 MHz.
#[test]
fn vblank_is_set_before_the_exposure_and_the_gain_stays() {
    let mut kernel =
        FakeKernel::new(Script { kind: Kind::Csi, formats: vec!["BA81"], delay: 2, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let lines: Vec<_> = camera.settings().iter().map(|s| s.value).collect();
    assert_eq!(lines, [10, 60, 360], "lines of 100 us");
    let written = kernel.world().written.clone();
    let blank = written.iter().position(|w| w.0 == abi::VBLANK).expect("VBLANK");
    let exposure = written.iter().position(|w| w.0 == abi::EXPOSURE).expect("EXPOSURE");
    assert!(blank < exposure, "{written:?}");
    assert_eq!(
        written.iter().filter(|w| [abi::VBLANK, abi::ANALOGUE_GAIN].contains(&w.0)).count(),
        2,
        "once each"
    );
    let tally = run(&mut camera, &mut kernel, 300);
    assert_eq!((tally.wrong, tally.right), (0, 300), "{tally:?}");
}

/// On paper: at 28 Hz, bursts of one to six frames are 0.14 to 0.43 or 0.57 to 0.86 periods of 100 and of 120 Hz apart, at 30 Hz bursts of
/// three frames are 10 and 12 periods apart.
#[test]
fn the_frame_rate_shows_mains_light_at_differing_phases_where_the_driver_sets_it() {
    let period = |quirks: Vec<Quirk>, options: Options, kind: Kind, formats: Vec<&'static str>| {
        let mut kernel = FakeKernel::new(Script { quirks, kind, formats, ..Script::default() });
        Camera::open(&mut kernel, &options).expect("a camera").period().as_secs_f64()
    };
    let takes = || vec![Quirk::TakesRates];
    let uvc = |quirks, options| period(quirks, options, Kind::Uvc, vec!["GREY"]);
    let rate: f64 = 1.0 / uvc(takes(), options());
    assert!((rate - 28.0).abs() < 0.01, "{rate}");
    for (hz, frames) in [100.0, 120.0].into_iter().flat_map(|hz| (1..=6).map(move |n| (hz, f64::from(n)))) {
        let apart: f64 = hz * frames / rate;
        assert!((apart - apart.round()).abs() > 0.139, "{hz} Hz, {frames} frames: {apart}");
    }
    let named: f64 = 1.0 / uvc(takes(), Options { spreads_phases: false, ..options() });
    assert!((named - 30.0).abs() < 0.01, "a rate that was named: {named}");
    assert_eq!(uvc(Vec::new(), options()), 0.04, "a driver of one rate");
    // The sensor's lines take 100 us.
    let sensor =
        period(Vec::new(), Options { exposures_s: vec![0.001, 0.002], ..options() }, Kind::Csi, vec!["BA81"]);
    assert!((sensor - 0.04).abs() < 1e-9, "the sensor's frames are as long as the rate says: {sensor}");
}

#[test]
fn exposures_that_change_while_the_camera_streams_are_those_of_their_frames() {
    for delay in [0, 2, 3] {
        let mut kernel = FakeKernel::new(Script { delay, loss: 0.02, ..Script::default() });
        let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
        let lists = [&[0.002, 0.02][..], &[0.0005], &[0.001, 0.004, 0.016, 0.036]];
        for wished in lists {
            run(&mut camera, &mut kernel, 50);
            assert!(camera.set_exposures(&mut kernel, wished).expect("a camera that goes on"), "taken");
            let seconds = camera.seconds();
            let is_near = |(s, w): (&f64, &f64)| (s - w).abs() < 1e-9;
            assert!(seconds.len() == wished.len() && seconds.iter().zip(wished).all(is_near), "{seconds:?}");
            let tally = run(&mut camera, &mut kernel, 100);
            assert!(tally.wrong == 0 && tally.right > 85, "{wished:?} after {delay} frames: {tally:?}");
        }
    }
    let mut kernel = FakeKernel::new(Script { kind: Kind::NoExposure, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    assert!(!camera.set_exposures(&mut kernel, &[0.01]).expect("a camera that goes on"), "no control");
    assert_eq!(camera.range(), None, "no control");
}

#[test]
fn a_known_sensor_is_set_to_the_mode_of_its_whole_area() {
    let script = Script {
        kind: Kind::Csi,
        sensor: "imx219 10-0010",
        formats: vec!["BA81"],
        size: (1640, 1232),
        ..Script::default()
    };
    let asked = |options: Options| {
        let kernel = FakeKernel::new(script.clone());
        let camera = Camera::open(&mut kernel.clone(), &options).expect("a camera");
        let bin = camera.picture().layout.bin();
        (kernel.world().script.pads.clone(), bin)
    };
    assert_eq!(asked(options()), (vec![(1640, 1232)], 2), "not the small mode, and binned");
    assert_eq!(asked(Options { full_view: false, ..options() }).0, [(64, 48)], "a size that was named");
}

#[test]
fn broken_frames_are_dropped_and_counted() {
    let faults = vec![(300, Fault::Short), (310, Fault::Error), (320, Fault::Repeat), (330, Fault::Empty)];
    let mut kernel = FakeKernel::new(Script { faults, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let tally = run(&mut camera, &mut kernel, 400);
    let expected = Broken { flagged: 1, empty: 1, short: 1, repeated: 1, damaged: 0 };
    assert_eq!((camera.counters().broken, tally.wrong), (expected, 0), "{tally:?}");
}

#[test]
fn jpeg_frames_have_exposures_and_damaged_ones_are_counted() {
    let faults = (300..310).map(|at| (at, Fault::Damaged)).collect();
    let script = Script { formats: vec!["MJPG"], faults, loss: 0.05, ..Script::default() };
    let mut kernel = FakeKernel::new(script);
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let tally = run(&mut camera, &mut kernel, 600);
    let damaged = camera.counters().broken.damaged;
    assert!((1..=10).contains(&damaged) && tally.wrong == 0, "{damaged} damaged, {tally:?}");
    assert!(tally.verified > 300, "{tally:?}");
}

#[test]
fn a_camera_without_an_exposure_control_still_delivers_frames() {
    let mut kernel = FakeKernel::new(Script { kind: Kind::NoExposure, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    let mut frame = RawFrame::default();
    assert!(camera.next(&mut kernel, SECOND, &mut frame).expect("a frame"), "whole");
    assert_eq!(
        (frame.taken.slot, frame.taken.known),
        (Some(0), Known::Unknown),
        "one exposure, of its own making"
    );
    assert_eq!(camera.settings().len(), 1, "the frame's time");
}

#[test]
fn another_control_can_replace_the_exposure() {
    let stand_in = StandIn { control: "brightness".into(), values: vec![10, 60, 200] };
    let mut kernel =
        FakeKernel::new(Script { kind: Kind::NoExposure, delay: 0, loss: 0.05, ..Script::default() });
    let mut camera =
        Camera::open(&mut kernel, &Options { stand_in: Some(stand_in), ..options() }).expect("a camera");
    assert_eq!(camera.delay(), Some(0), "found by the step test");
    let tally = run(&mut camera, &mut kernel, 1000);
    assert_eq!((tally.right, tally.verified), (1000, 0), "predicted only: {tally:?}");
}

#[test]
fn in_the_dark_delay_and_exposures_are_reported_as_unknown() {
    let mut kernel = FakeKernel::new(Script { light: 1e-3, ..Script::default() });
    let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
    assert_eq!(camera.delay(), None, "nothing to see");
    let mut frame = RawFrame::default();
    camera.next(&mut kernel, SECOND, &mut frame).expect("a frame");
    assert_eq!(frame.taken.known, Known::Unknown, "not claimed");
}

#[test]
fn each_cause_of_a_stream_failure_has_its_own_error() {
    let ends = [
        (Fault::Disconnect(SECOND), "found no camera"),
        (Fault::Stall(Duration::from_secs(20)), "no frame in 1000 ms"),
        (Fault::SourceChange, "another picture format"),
    ];
    for (fault, told) in ends {
        let mut kernel = FakeKernel::new(Script { faults: vec![(300, fault)], ..Script::default() });
        let mut camera = Camera::open(&mut kernel, &options()).expect("a camera");
        let mut frame = RawFrame::default();
        let error =
            (0..1000).find_map(|_| camera.next(&mut kernel, SECOND, &mut frame).err()).expect("an end");
        assert!(error.to_string().contains(told), "{error}");
        drop(camera);
        assert_eq!(kernel.held(), (0, 0), "all closed");
    }
}

#[test]
fn a_busy_camera_is_retried_and_then_reported() {
    let mut kernel = FakeKernel::new(Script { busy: 3, ..Script::default() });
    assert!(Camera::open(&mut kernel, &options()).is_ok(), "the fourth time");
    let mut kernel = FakeKernel::new(Script { busy: 1000, ..Script::default() });
    let Err(error) = Camera::open(&mut kernel, &options()) else { panic!("busy") };
    let line = error.to_string();
    assert!(
        matches!(error, CameraError::Failed { .. }) && line.starts_with("/dev/video0: open: found "),
        "{line}"
    );
}

#[test]
fn cameras_are_listed_with_formats_and_ranges() {
    let mut kernel = FakeKernel::new(Script::default());
    let cameras = device::list(&mut kernel).expect("cameras");
    assert_eq!(cameras.len(), 1, "{cameras:?}");
    assert_eq!((cameras[0].name.as_str(), cameras[0].exposure_s), ("fake", Some([1e-4, 0.5])), "{cameras:?}");
    assert_eq!(cameras[0].formats[0].sizes[0].rates, [25.0], "{cameras:?}");
    let mut kernel = FakeKernel::new(Script { kind: Kind::Csi, formats: vec!["BA81"], ..Script::default() });
    let cameras = device::list(&mut kernel).expect("cameras");
    assert_eq!(cameras[0].sensor.as_deref(), Some("/dev/v4l-subdev0".as_ref()), "{cameras:?}");
    assert_eq!(kernel.held(), (0, 0), "all closed");
}
