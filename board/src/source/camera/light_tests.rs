//! Cameras whose exposures follow lamps and light, against the scripted kernel.

use super::*;
use crate::probe::settings::{Change, Setting};
use crate::probe::{Config, Link, Worker};
use crate::v4l2::fake::{FakeKernel, Script};
use std::time::Instant;

/// The response of the scripted camera, as a lens file states it.
const LINEAR: &str = "[response]\nmodel = \"linear\"\n";

/// A probe that reads the scripted camera.
struct Bench {
    kernel: FakeKernel,
    worker: Worker,
    link: Arc<Link>,
    _lens: tempfile::NamedTempFile,
}

impl Bench {
    /// Creates a probe that reads a camera with `options`, whose lens file ends with `response`.
    fn new(options: &str, response: &str, config: Config) -> Self {
        let lens = tempfile::NamedTempFile::new().expect("a file");
        let text = format!(
            "[lens]\nmodel = \"equidistant\"\nsize = [64, 48]\ncentre = [31.5, 23.5]\nfocal = [15.0, 15.0]\n\
             max_angle_deg = 85.0\n{response}"
        );
        std::fs::write(lens.path(), text).expect("written");
        let spec = format!("/dev/video0,lens={}{options}", lens.path().display());
        let spec = CameraSpec::parse(&spec).expect("options");
        let kernel = FakeKernel::new(Script { light: 0.3, noise: 1, ..Script::default() });
        let source = CameraSource::open(Box::new(kernel.clone()), &spec).expect("a source");
        let worker = Worker::try_new(Box::new(source), "test".into(), config).expect("a worker");
        let link = worker.link();
        Self { kernel, worker, link, _lens: lens }
    }

    /// Makes `sets` light sets. Returns the exposure times of their bursts, milliseconds, one list for each change, and the clipped
    /// fraction of the last set's light.
    fn run(&mut self, sets: u64) -> (Vec<Vec<f64>>, f32) {
        let frame = |link: &Link| link.sets().latest().map_or(0, |set| set.frame);
        let (end, began) = (frame(&self.link) + sets, Instant::now());
        let mut lists: Vec<Vec<f64>> = Vec::new();
        while frame(&self.link) < end {
            let _ = self.worker.step();
            let status = self.link.camera().unwrap_or_default();
            let list: Vec<f64> = status.exposures.iter().map(|e| (e.seconds * 1e4).round() / 10.0).collect();
            if !list.is_empty() && lists.last() != Some(&list) {
                lists.push(list);
            }
            assert!(began.elapsed() < Duration::from_secs(60), "{:?}", self.link.status().failure());
        }
        (lists, self.link.sets().latest().map_or(1.0, |set| set.clipped))
    }
}

/// By hand: 3 periods of 100 Hz are 30 ms, and 4 periods of 120 Hz are 33.3 ms.
#[test]
fn the_longest_exposure_is_a_whole_number_of_mains_periods_unless_exposures_are_named() {
    let longest = |options: &str, lamps| {
        let mut config = Config::steady();
        config.pipeline.lamps = lamps;
        let (lists, _) = Bench::new(options, "", config).run(40);
        lists.last().and_then(|list| list.last().copied())
    };
    assert_eq!(longest("", Lamps::Mains50), Some(30.0), "three periods");
    assert_eq!(longest("", Lamps::Mains60), Some(33.3), "four periods");
    assert_eq!(longest("", Lamps::Off), Some(33.3), "no lamps");
    assert_eq!(longest(",exposures=0.001/0.0333", Lamps::Mains50), Some(33.3), "named");
}

#[test]
fn exposures_of_a_camera_follow_light_that_changes_by_1000_and_stay_in_light_that_does_not() {
    let mut bench = Bench::new("", LINEAR, Config::steady());
    bench.run(30);
    for light in [300.0, 0.3, 30.0] {
        bench.kernel.world().script.light = light;
        let (lists, clipped) = bench.run(30);
        assert!(lists.len() <= 4, "at most three changes after light of {light}: {lists:?}");
        assert!(clipped <= 0.001, "{clipped} of light of {light}: {lists:?}");
        let (lists, _) = bench.run(60);
        assert_eq!(lists.len(), 1, "no change in steady light of {light}: {lists:?}");
    }
}

#[test]
fn exposures_of_a_setting_replace_those_of_the_camera_and_go_with_it() {
    let config = Config { exposures_s: Some(vec![0.002, 0.02]), ..Config::steady() };
    let mut bench = Bench::new("", "", config);
    let (lists, _) = bench.run(20);
    assert_eq!(lists.last(), Some(&vec![2.0, 20.0]), "as set");
    let mut change = Change::default();
    let exposures = Setting::named("exposures_s").expect("a setting");
    change.add(exposures, serde_json::Value::Null).expect("those of the source");
    bench.link.settings().change(&change).expect("a change");
    let (lists, _) = bench.run(40);
    assert_eq!(lists.last(), Some(&vec![0.9, 5.5, 33.3]), "the camera's own: its response is unknown");
}
