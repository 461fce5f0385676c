//! Tests of the requests of the thesis's appendix A.1.

use super::*;
use hemilux_core::SamplerKind;

#[tokio::test]
async fn every_request_answers_in_its_own_type() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
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
async fn each_request_for_data_returns_the_next_frame() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let mut last = None;
    for _ in 0..5 {
        let (_, _, body) = get(&app, "/lights.json").await;
        let set: Value = serde_json::from_str(&body).expect("JSON");
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
    let app = routes(&probe);
    for (i, name) in SamplerKind::NAMES.iter().enumerate() {
        let lights = 20 + i;
        let uri = format!("/change?algorithm={name}&samples={lights}&extrapolation=average&gui=on");
        let (status, _, page) = get(&app, &uri).await;
        assert!(status == 200 && page.contains(name), "{status}: {page}");
        let (_, _, body) = get(&app, "/lights.json").await;
        let set: Value = serde_json::from_str(&body).expect("JSON");
        assert_eq!(set["sampler"], **name, "sampler");
        assert_eq!(set["requested"], lights, "samples");
    }
    let config = probe.link().settings().applied().borrow().config.clone();
    assert!(config.gui && config.pipeline.extrapolation != Default::default(), "{config:?}");
}

#[tokio::test]
async fn wrong_changes_are_refused_with_the_accepted_parameters() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
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
        assert!(
            body.contains(&SamplerKind::NAMES.join("|")) && body.contains("gui=on|off"),
            "{query}: {body}"
        );
    }
    assert_eq!(probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
}

#[tokio::test]
async fn unknown_paths_and_methods_are_refused_on_one_line() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
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
    assert_eq!(probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
}

#[tokio::test]
async fn the_last_set_is_stale_when_the_source_fails() {
    let probe = probe(3);
    let app = routes(&probe);
    let mut frames = probe.link().sets().subscribe();
    let third = frames.wait_for(|set| set.as_ref().is_some_and(|s| s.frame == 2));
    drop(tokio::time::timeout(Duration::from_secs(20), third).await.expect("three frames"));
    let (status, _, body) = get(&app, "/lights.json").await;
    let set: Value = serde_json::from_str(&body).expect("JSON");
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
async fn requests_before_the_first_set_are_answered_503() {
    let probe = probe(0);
    let app = routes(&probe);
    let request = Request::builder().uri("/lights.json").header("host", "[::1]:8080");
    let response = app.oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    assert_eq!(response.status(), StatusCode::SERVICE_UNAVAILABLE, "503");
    assert_eq!(response.headers()["retry-after"], "1", "Retry-After");
}
