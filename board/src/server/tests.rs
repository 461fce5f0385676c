//! Routes without sockets.

use super::*;
use crate::calibration::{Burst, Calibration};
use crate::probe::{Config, Probe};
use crate::samplers::NAMES;
use crate::scene;
use crate::server::app as routes;
use crate::source::{Pace, SceneSource, Source, SourceError};
use axum::body::Body;
use axum::http::Request;
use hemilux_core::merge::Exposure;
use std::time::Duration;
use tower::ServiceExt;

/// A scene that gives `left` bursts and then fails.
struct Mortal {
    scene: SceneSource,
    left: usize,
}

impl Source for Mortal {
    fn calibration(&self) -> &Calibration {
        self.scene.calibration()
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.scene.exposures()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.left = self.left.checked_sub(1).ok_or_else(|| SourceError::Gone("<unplugged>".into()))?;
        self.scene.next(burst)
    }
}

fn probe(bursts: usize) -> Probe {
    let scene = scene::by_name("lamps").expect("a scene");
    let scene = SceneSource::new(scene, Pace::Every(Duration::from_millis(20)));
    Probe::start(Box::new(Mortal { scene, left: bursts }), "test:mortal".into(), Config::default())
        .expect("a probe")
}

/// Status, content type and body of the answer to a request with these headers.
async fn ask(app: &Router, method: &str, uri: &str, headers: &[(&str, &str)]) -> (u16, String, String) {
    let mut request = Request::builder().method(method).uri(uri);
    if !headers.iter().any(|(name, _)| *name == "host") {
        request = request.header("host", "localhost:8080");
    }
    let request = headers.iter().fold(request, |r, (name, value)| r.header(*name, *value));
    let response =
        app.clone().oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    let status = response.status().as_u16();
    let kind = response.headers().get("content-type").map_or("", |v| v.to_str().expect("text")).to_owned();
    let bytes = axum::body::to_bytes(response.into_body(), 1 << 24).await.expect("a body");
    (status, kind, String::from_utf8(bytes.to_vec()).expect("UTF-8"))
}

async fn get(app: &Router, uri: &str) -> (u16, String, String) {
    ask(app, "GET", uri, &[]).await
}

#[tokio::test]
async fn every_request_answers_in_its_own_type() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    for (uri, kind, part) in [
        ("/", "text/html; charset=utf-8", "<canvas"),
        ("/info", "text/html; charset=utf-8", "test:mortal"),
        ("/change", "text/html; charset=utf-8", "<form action=\"/change\""),
        ("/data", "text/plain; charset=utf-8", "# sampler "),
        ("/xml", "application/xml", "<lights version=\"1\""),
        ("/lights.json", "application/json", "\"valid\":true,\"stale\":null"),
        ("/healthz", "text/plain; charset=utf-8", "ok"),
    ] {
        let (status, found, body) = get(&app, uri).await;
        assert_eq!((status, found.as_str()), (200, kind), "{uri}: {body}");
        assert!(body.contains(part), "{uri}: {body}");
    }
    let (_, _, info) = get(&app, "/info").await;
    assert!(info.contains("frame rate") && info.contains("pyramid"), "{info}");
}

#[tokio::test]
async fn data_is_the_next_frame_each_time() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    let mut last = None;
    for _ in 0..5 {
        let (_, _, body) = get(&app, "/lights.json").await;
        let set: serde_json::Value = serde_json::from_str(&body).expect("JSON");
        let frame = set["frame"].as_u64();
        assert!(frame > last, "{frame:?} after {last:?}");
        assert_eq!(set["run"].as_str(), Some(probe.link().run()), "run");
        assert!(set["lights"].as_array().is_some_and(|l| l.len() <= 64), "at most as many as asked for");
        last = frame;
    }
}

#[tokio::test]
async fn a_change_is_in_the_next_set() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    for (i, name) in NAMES.iter().enumerate() {
        let lights = 20 + i;
        let uri = format!("/change?algorithm={name}&samples={lights}&extrapolation=average&gui=on");
        let (status, _, page) = get(&app, &uri).await;
        assert!(status == 200 && page.contains(name), "{status}: {page}");
        let (_, _, body) = get(&app, "/lights.json").await;
        let set: serde_json::Value = serde_json::from_str(&body).expect("JSON");
        assert_eq!(set["sampler"], **name, "sampler");
        assert_eq!(set["requested"], lights, "samples");
    }
    let config = probe.link().applied().borrow().config.clone();
    assert!(config.gui && config.pipeline.extrapolation != Default::default(), "{config:?}");
}

#[tokio::test]
async fn wrong_changes_change_nothing_and_say_what_is_accepted() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    for query in [
        "algorithm=guess",
        "algorithm=",
        "algorithm",
        "samples=0",
        "algorithm=q2tree&samples=1",
        "samples=50001",
        "samples=-1",
        "samples=1e3",
        "samples=99999999999999999999",
        "samples=32&samples=33",
        "samples=32&extrapolation=some",
        "samples=32&gui=yes",
        "samples=32&colour=red",
        "%3Cscript%3E=1",
        "samples=%ff",
    ] {
        let (status, kind, body) = get(&app, &format!("/change?{query}")).await;
        assert_eq!((status, kind.as_str()), (400, "text/plain; charset=utf-8"), "{query}: {body}");
        assert!(body.contains(&NAMES.join("|")) && body.contains("gui=on|off"), "{query}: {body}");
    }
    assert_eq!(probe.link().applied().borrow().config, Config::default(), "unchanged");
}

#[tokio::test]
async fn changes_that_other_sites_ask_for_are_refused() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    let change = "/change?samples=20";
    for header in [
        ("origin", "http://evil.example"),
        ("referer", "http://evil.example/a"),
        ("sec-fetch-site", "cross-site"),
    ] {
        assert_eq!(ask(&app, "GET", change, &[header]).await.0, 403, "{header:?}");
        assert_eq!(ask(&app, "GET", "/change", &[header]).await.0, 200, "{header:?}: the form is shown");
    }
    assert_eq!(probe.link().applied().borrow().config, Config::default(), "unchanged");
    assert_eq!(ask(&app, "GET", change, &[("origin", "http://localhost:8080")]).await.0, 200, "our own page");
}

#[tokio::test]
async fn hosts_that_are_not_this_machine_are_refused() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    for uri in ["/", "/lights.json", "/change?samples=20", "/nothing"] {
        assert_eq!(ask(&app, "GET", uri, &[("host", "evil.example")]).await.0, 421, "{uri}");
        assert_eq!(
            ask(&app, "GET", uri, &[("host", "localhost"), ("host", "localhost")]).await.0,
            400,
            "{uri}"
        );
    }
    let open = routes(probe.link(), Guard::Open);
    assert_eq!(ask(&open, "GET", "/lights.json", &[("host", "probe.lan")]).await.0, 200, "open");
}

#[tokio::test]
async fn other_requests_and_methods_get_one_line() {
    let probe = probe(usize::MAX);
    let app = routes(probe.link(), Guard::Loopback);
    for (method, uri, expected) in [
        ("GET", "/nothing", 404),
        ("GET", "/../etc/passwd", 404),
        ("GET", "/data/", 404),
        ("POST", "/lights.json", 405),
        ("DELETE", "/", 405),
    ] {
        let (status, _, body) = ask(&app, method, uri, &[]).await;
        assert_eq!((status, body.lines().count()), (expected, 1), "{method} {uri}: {body}");
    }
    assert_eq!(ask(&app, "HEAD", "/change?samples=20", &[]).await.0, 405, "HEAD changes nothing");
    assert_eq!(probe.link().applied().borrow().config, Config::default(), "unchanged");
}

#[tokio::test]
async fn the_last_set_is_stale_when_the_source_dies() {
    let probe = probe(3);
    let app = routes(probe.link(), Guard::Loopback);
    let mut frames = probe.link().subscribe();
    let third = frames.wait_for(|set| set.as_ref().is_some_and(|s| s.frame == 2));
    drop(tokio::time::timeout(Duration::from_secs(20), third).await.expect("three frames"));
    let (status, _, body) = get(&app, "/lights.json").await;
    let set: serde_json::Value = serde_json::from_str(&body).expect("JSON");
    assert_eq!((status, set["frame"].as_u64()), (200, Some(2)), "{body}");
    assert_eq!(set["stale"]["reason"], "<unplugged>", "{body}");
    assert!(set["stale"]["age_ms"].as_u64() >= Some(1400), "{body}");
    let (_, _, xml) = get(&app, "/xml").await;
    assert!(xml.contains(" ms &lt;unplugged&gt;\""), "{xml}");
    let (_, _, text) = get(&app, "/data").await;
    assert!(text.contains(" ms <unplugged>\n"), "{text}");
    let (_, _, info) = get(&app, "/info").await;
    assert!(info.contains("&lt;unplugged&gt;"), "{info}");
    assert_eq!(get(&app, "/healthz").await.0, 503, "not healthy");
}

#[tokio::test]
async fn before_the_first_set_there_is_none() {
    let probe = probe(0);
    let app = routes(probe.link(), Guard::Loopback);
    let request = Request::builder().uri("/lights.json").header("host", "[::1]:8080");
    let response = app.oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    assert_eq!(response.status(), StatusCode::SERVICE_UNAVAILABLE, "503");
    assert_eq!(response.headers()["retry-after"], "1", "Retry-After");
}
