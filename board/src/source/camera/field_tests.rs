//! A camera whose driver sets timestamps from the wall clock.
use super::*;
use crate::probe::{Config, Worker};
use crate::v4l2::fake::{FakeKernel, Script};
use std::time::Instant;

#[test]
fn a_failed_camera_is_stale_with_timestamps_of_another_clock() {
    let script = Script { formats: vec!["BA81"], wall_clock: true, ..Script::default() };
    let kernel = FakeKernel::new(script);
    let spec = CameraSpec::parse("/dev/video0").expect("options");
    let source = CameraSource::open_or_wait(Box::new(kernel.clone()), &spec).expect("a source");
    let mut worker = Worker::try_new(Box::new(source), "test".into(), Config::steady()).expect("a worker");
    let link = worker.link();
    while link.sets().latest().is_none() {
        let _ = worker.step();
    }
    kernel.world().gone_until_ns = u64::MAX;
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(4) {
        let _ = worker.step();
    }
    let set = link.sets().latest().expect("a set");
    let age = link.staleness(&set).age_ms;
    assert!(age > 1500, "gone for 4 s, {age} ms old: /healthz says ok");
}
