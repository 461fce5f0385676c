//! Cameras as sources, against the scripted kernel.

use super::*;
use crate::probe::{Config, Worker};
use crate::v4l2::fake::{FakeKernel, Fault, Script};
use crate::v4l2::frame::{RawFrame, Taken};
use crate::v4l2::schedule::Known;
use hemilux_core::format::Format;
use std::time::Instant;

fn spec(options: &str) -> CameraSpec {
    CameraSpec::parse(&format!("/dev/video0{options}")).expect("options")
}

fn refused(script: Script, options: &str) -> String {
    let opened = CameraSource::open_or_wait(Box::new(FakeKernel::new(script)), &spec(options));
    let line = opened.expect_err("refused").to_string();
    assert!(line.contains("expected") && !line.contains('\n'), "one line: {line}");
    line
}

#[test]
fn a_camera_that_comes_after_the_probe_is_waited_for() {
    let kernel = FakeKernel::new(Script { formats: vec!["BA81"], ..Script::default() });
    kernel.world().gone_until_ns = u64::MAX;
    let missing = CameraSource::open(Box::new(kernel.clone()), &spec("")).expect_err("not there").to_string();
    assert_eq!(missing, "/dev/video0: found no camera, expected one that is plugged in", "without waiting");

    let source = CameraSource::open_or_wait(Box::new(kernel.clone()), &spec("")).expect("a source");
    assert_eq!(source.calibration().layout.width(), 640, "as it is asked for");
    let mut worker = Worker::try_new(Box::new(source), "test".into(), Config::default()).expect("a worker");
    let link = worker.link();
    while link.status().failure().is_none() {
        let _ = worker.step();
    }
    assert_eq!(link.status().failure(), Some(missing), "clients are told");
    assert!(link.sets().latest().is_none(), "no lights of a camera that is not there");

    kernel.world().gone_until_ns = 0;
    let began = Instant::now();
    while link.sets().latest().is_none() {
        let _ = worker.step();
        assert!(began.elapsed() < Duration::from_secs(30), "it comes up: {:?}", link.status().failure());
    }
    assert_eq!(link.status().failure(), None, "bursts");
    let set = link.sets().latest().expect("a set");
    assert!(set.scalar_flux[1] > 0.0 && !set.lights.is_empty(), "light: {set:?}");
}

/// A lens file for 1280 x 720 pixels serves the decoded pictures of 640 x 360.
#[test]
fn a_lens_is_scaled_with_the_jpeg_pictures() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let text = "[lens]\nmodel = \"equidistant\"\nsize = [1280, 720]\ncentre = [639.5, 359.5]\n\
                focal = [229.0, 229.0]\nmax_angle_deg = 90.0\n";
    std::fs::write(file.path(), text).expect("written");
    let script = Script { formats: vec!["MJPG"], size: (1280, 720), ..Script::default() };
    let spec = spec(&format!(",lens={}", file.path().display()));
    let source = CameraSource::open(Box::new(FakeKernel::new(script)), &spec).expect("a source");
    let c = source.calibration();
    let (centre, focal) = (c.lens.intrinsics().centre_px, c.lens.intrinsics().focal_px);
    assert_eq!((c.layout.width(), c.layout.height(), c.compressed), (640, 360, true), "scaled to a half");
    assert_eq!((centre.to_array(), focal.to_array()), ([319.5, 179.5], [114.5, 114.5]), "the same rays");
}

#[test]
fn the_calibration_is_that_of_the_camera_once_it_is_there() {
    let kernel = FakeKernel::new(Script { formats: vec!["pBAA"], size: (64, 48), ..Script::default() });
    kernel.world().gone_until_ns = u64::MAX;
    let mut source = CameraSource::open_or_wait(Box::new(kernel.clone()), &spec("")).expect("a source");
    kernel.world().gone_until_ns = 0;
    let (mut burst, began) = (Burst::default(), Instant::now());
    while source.next(&mut burst).is_err() {
        assert!(began.elapsed() < Duration::from_secs(30), "it comes up");
    }
    let c = source.calibration();
    assert!(matches!(c.layout.format(), Format::Raw10(_)), "{c:?}");
    assert_eq!(
        (c.layout.width(), c.layout.height(), c.layout.bytes_per_line(), c.levels.white),
        (64, 48, 80 + 16, 1023.0),
        "as granted"
    );
    assert_eq!(source.exposures().len(), burst.frames.len(), "as agreed");
}

/// The scripted camera is linear; without a lens file, a camera's own pictures are taken to follow sRGB.
#[test]
fn a_camera_whose_frames_contradict_its_exposures_is_explained() {
    let kernel = FakeKernel::new(Script { formats: vec!["GREY"], ..Script::default() });
    let mut source = CameraSource::open(Box::new(kernel), &spec("")).expect("a source");
    let (mut burst, began) = (Burst::default(), Instant::now());
    let line = loop {
        match source.next(&mut burst) {
            Err(SourceError::Gone(line)) => break line,
            other => assert!(began.elapsed() < Duration::from_secs(30), "it is told: {other:?}"),
        }
    };
    assert!(
        line.contains("/dev/video0: found ") && line.contains("expected") && line.contains("[response]"),
        "{line}"
    );
}

#[test]
fn frames_that_are_all_broken_are_named_as_the_reason() {
    let faults = vec![(300, Fault::AllError)];
    let kernel = FakeKernel::new(Script { formats: vec!["BA81"], faults, ..Script::default() });
    let mut source = CameraSource::open(Box::new(kernel), &spec("")).expect("a source");
    let (mut burst, began) = (Burst::default(), Instant::now());
    let line = loop {
        match source.next(&mut burst) {
            Err(SourceError::Gone(line)) => break line,
            other => assert!(began.elapsed() < Duration::from_secs(30), "it is told: {other:?}"),
        }
    };
    assert!(line.contains("with the error flag") && line.contains("expected complete frames"), "{line}");
}

#[test]
fn what_does_not_pass_by_waiting_is_refused_in_a_line() {
    let of = |formats: &[&'static str], size| Script { formats: formats.to_vec(), size, ..Script::default() };
    let line = refused(of(&["H264"], (64, 48)), "");
    assert!(line.contains("found the pixel formats H264") && line.contains("MJPG"), "{line}");
    let line = refused(of(&["MJPG", "YUYV"], (64, 48)), ",format=NV12");
    assert!(line.ends_with("expected NV12"), "{line}");
    let line = refused(of(&["YUYV"], (63, 48)), "");
    assert!(line.contains("found 63 x 48 pixels of YUYV, expected an even number of columns"), "{line}");
    let line = refused(of(&["NV12"], (64, 47)), "");
    assert!(
        line.contains("found 64 x 47 pixels of NV12, expected an even number of columns and rows"),
        "{line}"
    );
    let line = refused(Script { busy: 1000, ..Script::default() }, "");
    assert!(line.contains("open: found"), "{line}");
}

#[test]
fn a_lens_names_the_size_and_what_it_is_not_for_is_refused() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let lens = |width: u32| {
        let text = format!(
            "[lens]\nmodel = \"equidistant\"\nsize = [{width}, 48]\ncentre = [31.5, 23.5]\nfocal = [15.0, 15.0]\nmax_angle_deg = 90.0\n"
        );
        std::fs::write(file.path(), text).expect("written");
        spec(&format!(",lens={}", file.path().display()))
    };
    let source =
        CameraSource::open(Box::new(FakeKernel::new(Script::default())), &lens(64)).expect("it suits");
    let asked = Terms::assumed(&Options::of("/dev/video0")).picture.width();
    assert_eq!((source.calibration().layout.width(), asked), (64, 640), "not the usual size");
    let error =
        CameraSource::open(Box::new(FakeKernel::new(Script::default())), &lens(80)).expect_err("another");
    let line = error.to_string();
    assert!(
        line.contains("found pictures of 64 x 48 pixels, expected 80 x 48 as the lens file says"),
        "{line}"
    );
}

#[test]
fn a_burst_is_moved_and_not_copied_on_its_way_to_the_merge() {
    let taken = Taken { sequence: 0, timestamp_ns: 0, slot: None, known: Known::Predicted };
    let terms = Terms { seconds: vec![0.001, 0.006], ..Terms::assumed(&Options::of("/dev/video0")) };
    let frame = |code| RawFrame { taken, bytes: vec![code; 4096] };
    let mut raw = RawBurst { frames: vec![frame(1), frame(2)], terms: Arc::new(terms) };
    let mut burst = Burst::default();
    let buffers = |raw: &RawBurst| raw.frames.iter().map(|f| f.bytes.as_ptr()).collect::<Vec<_>>();
    let merged = |burst: &Burst| {
        let bytes = burst.frames.iter().map(|f| match &f.pixels {
            Pixels::U8(bytes) => bytes.as_ptr(),
            Pixels::U16(_) => std::ptr::null(),
        });
        bytes.collect::<Vec<_>>()
    };
    let first = buffers(&raw);
    hand_over(&mut raw, &mut burst);
    assert_eq!(merged(&burst), first, "the same memory");
    raw.frames = vec![frame(3), frame(4)];
    let second = buffers(&raw);
    hand_over(&mut raw, &mut burst);
    assert_eq!((merged(&burst), buffers(&raw)), (second, first), "and the old memory goes back");
}

/// On paper: frames 40 ms apart, stamped when they have come.
#[test]
fn a_burst_began_a_frame_and_its_exposure_before_its_first_timestamp_at_the_earliest() {
    let mut terms = Terms::assumed(&Options::of("/dev/video0"));
    (terms.period_ns, terms.seconds) = (40_000_000, vec![0.001, 0.006, 0.036]);
    let frame = |ms: u64| RawFrame {
        taken: Taken { sequence: 0, timestamp_ns: ms * 1_000_000, slot: None, known: Known::Predicted },
        bytes: Vec::new(),
    };
    let burst = RawBurst { frames: vec![frame(1080), frame(1000), frame(1040)], terms: Arc::new(terms) };
    assert_eq!(burst.before_ns(), 954_000_000, "the second frame: 40 and 6 ms");
    assert_eq!(burst.timestamp_ns(), 1_080_000_000, "the newest");
}
