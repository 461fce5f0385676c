//! Tests of the pictures of the server, which are decoded and compared.

use super::*;
use crate::calibration::Pixels;
use image::{DynamicImage, ImageFormat};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

fn decode(got: &Got, kind: &str, format: ImageFormat) -> DynamicImage {
    assert_eq!(
        (got.status, got.header("content-type")),
        (200, kind),
        "{}",
        String::from_utf8_lossy(&got.body)
    );
    image::load_from_memory_with_format(&got.body, format).expect("a picture")
}

fn mean(picture: &DynamicImage) -> f64 {
    let bytes = picture.to_rgb8().into_raw();
    bytes.iter().map(|v| f64::from(*v)).sum::<f64>() / bytes.len() as f64
}

#[tokio::test]
async fn exposures_are_jpegs_of_ascending_brightness() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let (width, height, last) = {
        let scene = SceneSource::new(scene::by_name("lamps").expect("a scene"), Pace::Free);
        (scene.calibration().layout.width(), scene.calibration().layout.height(), scene.exposures().len() - 1)
    };
    let mut means = Vec::new();
    for i in 0..=last {
        let got = fetch(&app, "GET", &format!("/image?{i}"), &[], "").await;
        let picture = decode(&got, "image/jpeg", ImageFormat::Jpeg);
        assert_eq!((picture.width(), picture.height()), (width, height), "exposure {i}");
        means.push(mean(&picture));
    }
    assert!(means.windows(2).all(|w| w[1] > w[0]), "{means:?}");
    let longest =
        mean(&decode(&fetch(&app, "GET", "/image", &[], "").await, "image/jpeg", ImageFormat::Jpeg));
    assert!((longest - means[last]).abs() < 2.0, "the longest by default: {longest} {means:?}");
    let same = fetch(&app, "GET", &format!("/v1/image/{last}"), &[], "").await;
    assert!((mean(&decode(&same, "image/jpeg", ImageFormat::Jpeg)) - means[last]).abs() < 2.0, "by path");
    for wrong in [format!("{}", last + 1), "-1".into(), "x".into(), "1=2".into()] {
        let (status, _, body) = get(&app, &format!("/image?{wrong}")).await;
        assert!(
            status == 400 && body.contains(&format!("0 (the shortest) to {last}")),
            "{wrong}: {status} {body}"
        );
    }
}

/// A camera with a queue of bursts: each burst is delivered three bursts after it was taken. All pixels of a picture have a code that states the
/// number of the burst.
struct Queue {
    scene: SceneSource,
    waiting: VecDeque<Burst>,
    /// Time at which each burst was taken, nanoseconds.
    taken_ns: Arc<Mutex<Vec<u64>>>,
}

fn code_of(number: usize) -> u8 {
    (20 + 5 * (number % 40)) as u8
}

impl Adapter for Queue {
    fn inner(&self) -> &dyn Source {
        &self.scene
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        &mut self.scene
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        let mut new = Burst::default();
        self.scene.next(&mut new)?;
        let mut taken_ns = self.taken_ns.lock().expect("no panic");
        for frame in &mut new.frames {
            let Pixels::U8(codes) = &mut frame.pixels else { panic!("bytes") };
            codes.fill(code_of(taken_ns.len()));
        }
        taken_ns.push(new.before_ns);
        self.waiting.push_back(new);
        let old = if self.waiting.len() > 3 { self.waiting.pop_front() } else { None };
        old.map(|old| *burst = old).ok_or(SourceError::NotYet)
    }
}

#[tokio::test]
async fn a_capture_is_taken_after_the_request_also_with_late_bursts() {
    let taken_ns = Arc::default();
    let scene = scene::by_name("lamps").expect("a scene");
    let scene = SceneSource::new(scene, Pace::Every(Duration::from_millis(20)));
    let queue = Queue { scene, waiting: VecDeque::new(), taken_ns: Arc::clone(&taken_ns) };
    let probe = Probe::start(Box::new(queue), "test:queue".into(), Config::steady()).expect("a probe");
    let app = routes(&probe);
    for _ in 0..5 {
        let asked_ns = crate::clock::monotonic_ns();
        let got = fetch(&app, "GET", "/capture", &[], "").await;
        let number: usize = got.header("hemilux-frame").parse().expect("a number");
        let taken = taken_ns.lock().expect("no panic")[number];
        assert!(taken >= asked_ns, "burst {number}: {} us before the request", (asked_ns - taken) / 1000);
        let seen = mean(&decode(&got, "image/jpeg", ImageFormat::Jpeg));
        assert!((seen - f64::from(code_of(number))).abs() < 2.0, "burst {number}: {seen}");
    }
    let newest = fetch(&app, "GET", "/image", &[], "").await.header("hemilux-frame").parse::<usize>();
    let queued = taken_ns.lock().expect("no panic").len() - newest.expect("a number");
    assert!(queued >= 3, "the newest burst is an old one here: {queued}");
}

#[tokio::test]
async fn a_missing_fresh_shot_is_answered_with_the_reason() {
    let probe = probe(3);
    let app = routes(&probe);
    while probe.link().status().failure().is_none() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let got = fetch(&app, "GET", "/capture", &[], "").await;
    let body = String::from_utf8_lossy(&got.body).into_owned();
    assert_eq!((got.status, got.header("retry-after")), (503, "1"), "{body}");
    assert_eq!(body.trim_end(), "no fresh shot: <unplugged>", "one line");
}

#[tokio::test]
async fn a_screenshot_is_kept_and_served_while_gui_is_on() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let (status, _, body) = get(&app, "/screenshot").await;
    assert!(status == 409 && body.contains("/change?gui=on"), "off: {status} {body}");
    get(&app, "/change?gui=on").await;
    let mut names = Vec::new();
    for _ in 0..3 {
        let (status, kind, body) = get(&app, "/screenshot").await;
        assert_eq!((status, kind.as_str()), (200, "text/html; charset=utf-8"), "{body}");
        let name =
            body.split("<img src=\"").nth(1).and_then(|b| b.split('"').next()).expect("a picture").to_owned();
        assert!(!names.contains(&name), "{name} is unique");
        names.push(name);
    }
    let newest = fetch(&app, "GET", &names[2], &[], "").await;
    let picture = decode(&newest, "image/png", ImageFormat::Png);
    assert_eq!((picture.width(), picture.height()), (720, 180), "the polar map");
    assert_eq!(get_status(&app, &names[0]).await, 200, "older ones are kept");
    assert_eq!(get_status(&app, "/screenshots/other.png").await, 404, "another name");
    get(&app, "/change?gui=off").await;
    assert_eq!(get(&app, "/screenshot").await.0, 409, "off again");
}

async fn get_status(app: &Router, uri: &str) -> u16 {
    fetch(app, "GET", uri, &[], "").await.status
}

#[tokio::test]
async fn the_map_is_a_png_with_or_without_marks() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let plain = decode(&fetch(&app, "GET", "/v1/map.png", &[], "").await, "image/png", ImageFormat::Png);
    let marked =
        decode(&fetch(&app, "GET", "/v1/map.png?marks=1", &[], "").await, "image/png", ImageFormat::Png);
    assert_eq!((plain.width(), plain.height()), (marked.width(), marked.height()), "one size");
    let white = |p: &DynamicImage| p.to_rgb8().pixels().filter(|p| p.0 == [255; 3]).count();
    assert!(white(&marked) > white(&plain) + 100, "rings: {} {}", white(&marked), white(&plain));
    assert_eq!(get(&app, "/v1/map.png?marks=2").await.0, 400, "marks");
}

#[tokio::test]
async fn the_map_has_the_energy_of_the_light_set() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let newest = || probe.link().sets().latest().expect("a set");
    // The lamps of the scene change from frame to frame: the test fails unless map and light set are of the
    // same frame.
    let mut got = fetch(&app, "GET", "/v1/map.exr", &[], "").await;
    let mut latest = newest();
    while latest.frame.to_string() != got.header("hemilux-frame") {
        got = fetch(&app, "GET", "/v1/map.exr", &[], "").await;
        latest = newest();
    }
    assert_eq!((got.status, got.header("content-type")), (200, "image/x-exr"), "OpenEXR");
    let read = exr::prelude::read_first_rgba_layer_from_file;
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), &got.body).expect("written");
    let new = |size: exr::math::Vec2<usize>, _: &_| (size, vec![[0.0f32; 3]; size.width() * size.height()]);
    let set = |pixels: &mut (exr::math::Vec2<usize>, Vec<[f32; 3]>),
               at: exr::math::Vec2<usize>,
               (r, g, b, _): (f32, f32, f32, f32)| {
        pixels.1[at.y() * pixels.0.width() + at.x()] = [r, g, b];
    };
    let image = read(file.path(), new, set).expect("an image");
    let (size, pixels) = image.layer_data.channel_data.pixels;
    assert_eq!((size.width(), size.height()), (360, 180), "two to one");
    let row = |y: usize| {
        let edge = |y: usize| (y as f64 / 180.0 * std::f64::consts::PI).cos();
        (edge(y) - edge(y + 1)) * std::f64::consts::TAU / 360.0
    };
    let flux: f64 = pixels.iter().enumerate().map(|(i, p)| f64::from(p[1]) * row(i / 360)).sum();
    let expected = f64::from(latest.scalar_flux[1]);
    assert!((flux / expected - 1.0).abs() < 1e-3, "{flux}, expected {expected}");
    assert!(pixels[90 * 360..].iter().all(|p| *p == [0.0; 3]), "dark below the horizon");
}
