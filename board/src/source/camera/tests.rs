//! Cameras as sources, tested with the scripted kernel.

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
fn a_camera_that_is_connected_after_the_start_is_used() {
    let kernel = FakeKernel::new(Script { formats: vec!["BA81"], ..Script::default() });
    kernel.world().gone_until_ns = u64::MAX;
    let missing = CameraSource::open(Box::new(kernel.clone()), &spec("")).expect_err("not there").to_string();
    assert_eq!(missing, "/dev/video0: found no camera, expected one that is plugged in", "without waiting");

    let source = CameraSource::open_or_wait(Box::new(kernel.clone()), &spec("")).expect("a source");
    assert_eq!(source.calibration().layout.width(), 640, "as it is asked for");
    let mut worker = Worker::try_new(Box::new(source), "test".into(), Config::steady()).expect("a worker");
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

/// The scripted camera is linear, as in the lens file; the sensor of the second camera exposes 1.0, 3.9 and 31.2 ms.
#[test]
fn the_status_has_verified_and_measured_exposures_and_frame_counts() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let text = "[lens]\nmodel = \"equidistant\"\nsize = [64, 48]\ncentre = [31.5, 23.5]\nfocal = [15.0, 15.0]\n\
                max_angle_deg = 85.0\n[response]\nmodel = \"linear\"\n";
    std::fs::write(file.path(), text).expect("written");
    let spec = spec(&format!(",exposures=0.0009/0.0055/0.0333,lens={}", file.path().display()));
    let status = |script: Script, known: &str| {
        let source = CameraSource::open(Box::new(FakeKernel::new(script)), &spec).expect("a source");
        let mut worker =
            Worker::try_new(Box::new(source), "test".into(), Config::steady()).expect("a worker");
        let (link, began) = (worker.link(), Instant::now());
        loop {
            let _ = worker.step();
            if let Some(status) = link.camera()
                && status.exposures.iter().filter(|e| e.known == known).count() >= 2
                && status.frames.complete > 200
            {
                return status;
            }
            assert!(began.elapsed() < Duration::from_secs(30), "{:?}", link.camera());
        }
    };
    let good = status(Script { loss: 0.05, ..Script::default() }, "verified");
    let asked = good.exposures.iter().all(|e| (e.seconds / e.asked_s - 1.0).abs() < 1e-9);
    assert!(asked && good.exposures.len() == 3, "as asked: {good:?}");
    assert!(good.known.verified > 100 && good.known.measured == 0 && good.frames.lost > 0, "{good:?}");
    assert_eq!(good.delay_frames, Some(2), "{good:?}");

    let really = Some(vec![5, 10, 20, 39, 78, 156, 312, 625]);
    let coarse = status(Script { really, range: (5, 20000), ..Script::default() }, "measured");
    let ratio = coarse.exposures[2].seconds / coarse.exposures[1].seconds;
    assert!((ratio / 8.0 - 1.0).abs() < 0.05, "31.2 to 3.9 ms: {coarse:?}");
    // Before the first ratios are measured, successive frames with equal exposures agree with each other.
    assert!(20 * coarse.known.verified < coarse.known.measured, "{coarse:?}");
}

/// The modes are those of the driver of imx219: the lens file is of the full view, the pictures are of a small mode.
#[test]
fn a_lens_file_with_a_crop_is_converted_to_the_mode_or_refused() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let open = |centre: [f64; 2], crop: &str, options: &str| {
        let text = format!(
            "[lens]\nmodel = \"equidistant\"\nsize = [1640, 1232]\ncentre = {centre:?}\nfocal = [400.0, 402.0]\n\
             max_angle_deg = 80.0\n{crop}"
        );
        std::fs::write(file.path(), text).expect("written");
        let spec = CameraSpec::parse(&format!("imx219,lens={}{options}", file.path().display()));
        let kernel = FakeKernel::new(crate::v4l2::media::pi_4_script());
        CameraSource::open(Box::new(kernel), &spec.expect("options"))
    };
    let crop = "crop = [0, 0, 3280, 2464]\nbinning = [2, 2]\n";
    let source = open([819.5, 615.5], crop, "").expect("the same mode");
    assert_eq!(source.calibration().lens.intrinsics().centre_px.to_array(), [819.5, 615.5], "as it is");
    // 640 x 480 covers 1280 x 960 at 1000, 752, binned by two; computed by hand, the centre moves 500 and 376 pixels to the left and up.
    let source = open([819.5, 615.5], crop, ",size=640x480").expect("converted");
    let c = source.calibration();
    assert_eq!((c.layout.width(), c.layout.height()), (640, 480), "as asked");
    let (centre, focal) = (c.lens.intrinsics().centre_px, c.lens.intrinsics().focal_px);
    assert_eq!((centre.to_array(), focal.to_array()), ([319.5, 239.5], [400.0, 402.0]), "moved");
    let line = open([100.0, 100.0], crop, ",size=640x480").expect_err("not shown").to_string();
    assert!(
        line.contains("found pictures of 15 % of the sensor") && line.contains("as in the lens file"),
        "{line}"
    );
    let line = open([819.5, 615.5], "", ",size=640x480").expect_err("no crop").to_string();
    assert!(
        line.contains("found pictures of 640 x 480 pixels, expected 1640 x 1232 as in the lens file"),
        "{line}"
    );
    let line = open([819.5, 615.5], "crop = [0, 0, 3000, 2464]\nbinning = [2, 2]\n", "")
        .expect_err("odd")
        .to_string();
    assert!(line.contains("expected a crop that is size times binning"), "{line}");
}

#[test]
fn the_noise_of_the_lens_file_is_the_noise_of_the_camera() {
    let noise = |sensor: &str| {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let lens = "[lens]\nmodel = \"equidistant\"\nsize = [64, 48]\ncentre = [31.5, 23.5]\nfocal = [15.0, 15.0]\n\
                    max_angle_deg = 85.0\n";
        std::fs::write(file.path(), format!("{lens}{sensor}")).expect("written");
        let spec = spec(&format!(",lens={}", file.path().display()));
        CameraSource::open(Box::new(FakeKernel::new(Script::default())), &spec).expect("a source").noise()
    };
    let stated = "[sensor]\nblack = 4.0\nread_noise = 1.5\ncodes_per_electron = 0.03\n";
    assert_eq!(noise(stated), Some(Noise { read: 1.5, gain: 0.03, dark: 4.0 }));
    assert_eq!(noise(""), None, "without a statement");
}

/// A lens file for 1280 x 720 pixels applies to the decoded pictures of 640 x 360.
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
fn the_calibration_follows_the_camera_when_it_is_connected() {
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

/// Reads the camera of `kernel` until it is gone and returns the reason.
fn reason_of_end(kernel: FakeKernel) -> String {
    let mut source = CameraSource::open(Box::new(kernel), &spec("")).expect("a source");
    let (mut burst, began) = (Burst::default(), Instant::now());
    loop {
        match source.next(&mut burst) {
            Err(SourceError::Gone(line)) => return line,
            other => assert!(began.elapsed() < Duration::from_secs(30), "it is told: {other:?}"),
        }
    }
}

/// The scripted camera is linear; without a lens file, the probe assumes the sRGB curve.
#[test]
fn frames_that_contradict_their_exposures_are_named_as_the_reason() {
    let kernel = FakeKernel::new(Script { formats: vec!["GREY"], ..Script::default() });
    let line = reason_of_end(kernel);
    assert!(
        line.contains("/dev/video0: found ") && line.contains("expected") && line.contains("[response]"),
        "{line}"
    );
}

#[test]
fn frames_that_are_all_broken_are_named_as_the_reason() {
    let kinds =
        [(Fault::AllError, "with the error flag"), (Fault::AllShort, "short"), (Fault::AllEmpty, "empty")];
    for (fault, named) in kinds {
        let script = Script { formats: vec!["BA81"], faults: vec![(300, fault)], ..Script::default() };
        let kernel = FakeKernel::new(script);
        let line = reason_of_end(kernel);
        assert!(line.contains(named) && line.contains("expected complete frames"), "{line}");
    }
}

/// The timestamps are of the wall clock, constant, at half speed, or jump back and forth by three seconds.
#[test]
fn a_live_camera_is_fresh_and_a_failed_one_stale_with_any_timestamps() {
    const S: u64 = 1_000_000_000;
    let stamps: [fn(u64) -> u64; 5] = [
        |ns| 1_700_000_000 * S + ns,
        |_| S,
        |ns| ns / 2,
        |ns| ns + 3 * S * (ns / S % 2),
        |ns| ns.saturating_sub(3 * S * (ns / S % 2)),
    ];
    let ages = |stamps: fn(u64) -> u64| {
        let script =
            Script { formats: vec!["BA81"], stamps: Some(stamps), real_time: true, ..Script::default() };
        let kernel = FakeKernel::new(script);
        let source = CameraSource::open(Box::new(kernel.clone()), &spec("")).expect("a source");
        let mut worker =
            Worker::try_new(Box::new(source), "test".into(), Config::steady()).expect("a worker");
        let link = worker.link();
        let mut run = |time: Duration| {
            let (began, mut oldest) = (Instant::now(), 0);
            while began.elapsed() < time {
                let _ = worker.step();
                let newest = link.sets().subscribe().borrow().clone();
                oldest = oldest.max(newest.map_or(0, |set| link.staleness(&set).age_ms));
            }
            oldest
        };
        let live = run(Duration::from_millis(2500));
        kernel.world().gone_until_ns = u64::MAX;
        (live, run(Duration::from_millis(2500)))
    };
    let ages: Vec<_> = std::thread::scope(|scope| {
        let running: Vec<_> = stamps.into_iter().map(|stamps| scope.spawn(move || ages(stamps))).collect();
        running.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    for (clock, (live, dead)) in ages.iter().enumerate() {
        assert!(
            *live < 1500 && *dead > 1800,
            "clock {clock}: {live} ms while alive, {dead} ms after its end"
        );
    }
}

/// The test makes the sets of one simulated minute, or of `HEMILUX_CAMERA_SECONDS` simulated seconds, with a probability of 1 % for every
/// fault at each frame and a disconnection every minute: each set has the light of the scene, which is constant.
#[test]
fn faults_at_every_hundredth_frame_make_no_wrong_set_and_leak_no_memory() {
    let seconds = std::env::var("HEMILUX_CAMERA_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(60u64);
    let pulls = (1..=seconds / 60).map(|n| (n * 1300, Fault::Disconnect(Duration::from_millis(2500))));
    let script = Script {
        formats: vec!["BA81"],
        faults: pulls.collect(),
        loss: 0.01,
        chance: 0.01,
        interrupt: 100,
        fail_write_every: 100,
        ..Script::default()
    };
    let kernel = FakeKernel::new(script);
    let mut source = CameraSource::open(Box::new(kernel.clone()), &spec("")).expect("a source");
    let exposures = source.exposures();
    let settings = crate::pipeline::Settings { lights: 16, ..Default::default() };
    let mut pipeline =
        crate::pipeline::Pipeline::try_new(*source.calibration(), &exposures, settings).expect("a pipeline");
    let (mut burst, mut fluxes, mut resident) = (Burst::default(), Vec::new(), Vec::new());
    let began = kernel.world().now_ns;
    // A busy machine skips bursts, so that it may take more simulated time to process enough sets.
    while kernel.world().now_ns - began < seconds * 1_000_000_000 || fluxes.len() <= 50 {
        if source.next(&mut burst).is_ok() {
            fluxes.push(pipeline.process(&burst).expect("lights").scalar_flux[1]);
            resident.push(resident_kb());
        }
    }
    let status = source.counters();
    let mut sorted = fluxes.clone();
    sorted.sort_unstable_by(f32::total_cmp);
    let median = sorted[sorted.len() / 2];
    let wrong = fluxes.iter().filter(|f| (**f / median - 1.0).abs() > 0.02).count();
    println!("{} sets, {wrong} wrong, {status:?}, {:?} kB", fluxes.len(), resident.last());
    assert!(fluxes.len() > 50 && wrong == 0, "{wrong} of {} sets", fluxes.len());
    let pulled = u64::from(kernel.world().generation);
    assert!(
        pulled > 0 && status.1 <= pulled && pulled - status.1 <= 1,
        "reopened for {pulled} disconnects alone: {status:?}"
    );
    let broken = status.0.broken;
    let each =
        [broken.flagged, broken.empty, broken.short, broken.repeated, status.0.lost, status.0.failed_writes];
    assert!(each.iter().all(|count| *count > seconds / 10), "each fault happened: {status:?}");
    // Memory is measured in the long run alone, which has a process of its own: other tests allocate memory too.
    if seconds >= 3600 {
        let (before, after) = (resident[resident.len() / 3], resident[resident.len() - 1]);
        assert!(after <= before + 1024, "{before} then {after} kB");
    }
}

/// Returns the resident memory of this process, kB.
fn resident_kb() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").expect("Linux");
    4 * text.split_whitespace().nth(1).and_then(|pages| pages.parse::<u64>().ok()).expect("pages")
}

#[test]
fn permanent_faults_are_refused_on_one_line() {
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
fn pictures_of_another_size_than_the_lens_files_are_refused() {
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
        line.contains("found pictures of 64 x 48 pixels, expected 80 x 48 as in the lens file"),
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
    hand_over(&mut raw, u16::MAX, &mut burst);
    assert_eq!(merged(&burst), first, "the same memory");
    raw.frames = vec![frame(3), frame(4)];
    let second = buffers(&raw);
    hand_over(&mut raw, u16::MAX, &mut burst);
    assert_eq!((merged(&burst), buffers(&raw)), (second, first), "and the old memory goes back");
}

/// Computed by hand: the frames are 40 ms apart, and their timestamp is the time of their arrival.
#[test]
fn the_earliest_start_of_a_burst_is_a_period_and_an_exposure_before_its_timestamp() {
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
