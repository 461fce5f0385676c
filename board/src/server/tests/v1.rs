//! Tests of the requests under `/v1`.

use super::*;
use hemilux_core::wire::BinarySet;

#[tokio::test]
async fn lights_are_returned_in_the_requested_form() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for (query, accept, kind, start) in [
        ("", "*/*", "application/json", "{\"version\":1,"),
        ("?format=text", "application/json", "text/plain; charset=utf-8", "# run "),
        ("", "application/xml", "application/xml", "<lights version=\"1\""),
        ("?format=binary", "*/*", "application/vnd.hemilux.lights", "HMLX"),
        ("?format=csv", "*/*", "text/csv; charset=utf-8", "# hemilux light set"),
        ("?format=glb", "*/*", "model/gltf-binary", "glTF"),
        ("?format=usda&lights=4", "*/*", "model/vnd.usda", "#usda 1.0"),
        ("?format=rad", "*/*", "text/plain; charset=us-ascii", "# hemilux light set"),
        ("?format=mitsuba&coordinates=blender", "*/*", "application/xml", "<?xml "),
    ] {
        let got = fetch(&app, "GET", &format!("/v1/lights{query}"), &[("accept", accept)], "").await;
        assert_eq!((got.status, got.header("content-type")), (200, kind), "{query}");
        assert!(got.body.starts_with(start.as_bytes()), "{query}");
        assert_eq!(got.header("cache-control"), "no-store", "{query}");
    }
    assert_eq!(
        fetch(&app, "GET", "/v1/lights", &[("accept", "image/png")], "").await.status,
        406,
        "no such form"
    );
    let (status, _, body) = get(&app, "/v1/lights?coordinates=maya").await;
    assert!(status == 400 && body.contains("coordinates=probe|"), "{status}: {body}");
    for uri in [
        "/data?format=json",
        "/xml?colour=red",
        "/v1/events?format=json",
        "/v1/events?after=3",
        "/lights.json?lights=0",
        "/v1/lights?format=glb&coordinates=unity",
    ] {
        assert_eq!(get(&app, uri).await.0, 400, "{uri}");
    }
}

/// Returns direction and irradiance of each light of a light set, by the id of the light.
fn by_id(set: &Value) -> std::collections::BTreeMap<u64, (Vec<f64>, Vec<f64>)> {
    let reals =
        |v: &Value| v.as_array().expect("numbers").iter().map(|v| v.as_f64().expect("a number")).collect();
    let light =
        |l: &Value| (l["id"].as_u64().expect("an id"), (reals(&l["direction"]), reals(&l["irradiance"])));
    set["lights"].as_array().expect("lights").iter().map(light).collect()
}

#[tokio::test]
async fn axes_are_converted_and_merging_lights_keeps_ids_and_energy() {
    // The source ends after three frames: all requests get the last one.
    let probe = probe(3);
    let app = routes(&probe);
    wait_for(&probe, 2).await;
    let probe_axes = get_json(&app, "/v1/lights?after=0").await;
    let all = by_id(&probe_axes);
    assert!(all.len() > 20, "{} lights", all.len());
    for (name, turned) in [
        ("three", (|d: &[f64]| vec![d[0], d[2], -d[1]]) as fn(&[f64]) -> Vec<f64>),
        ("unity", |d| vec![d[0], d[2], d[1]]),
        ("unreal", |d| vec![d[0], -d[1], d[2]]),
        ("ros", |d| d.to_vec()),
    ] {
        let set = get_json(&app, &format!("/v1/lights?after=0&coordinates={name}")).await;
        let lights = by_id(&set);
        assert!(lights.iter().all(|(id, (d, _))| *d == turned(&all[id].0)), "{name}");
    }
    let thin = get_json(&app, "/v1/lights?after=0&lights=5").await;
    let few = by_id(&thin);
    assert!(few.len() == 5 && few.keys().all(|id| all.contains_key(id)), "{few:?}");
    assert_eq!(thin["requested"], 5, "requested");
    let sum = |lights: &std::collections::BTreeMap<_, (Vec<f64>, Vec<f64>)>| {
        lights.values().map(|(_, e)| e[1]).sum::<f64>()
    };
    assert!((sum(&few) / sum(&all) - 1.0).abs() < 1e-4, "energy");
    assert!(thin.get("ambient_sh").is_none(), "only where asked for");
}

async fn get_json(app: &Router, uri: &str) -> Value {
    let got = fetch(app, "GET", uri, &[], "").await;
    assert_eq!(got.status, 200, "{uri}: {}", got.text());
    got.json()
}

/// Waits until the light set of `frame` is published.
async fn wait_for(probe: &Probe, frame: u64) {
    let mut frames = probe.link().sets().subscribe();
    let there = frames.wait_for(|set| set.as_ref().is_some_and(|s| s.frame >= frame));
    drop(tokio::time::timeout(Duration::from_secs(20), there).await.expect("in time").expect("a probe"));
}

#[tokio::test]
async fn after_waits_for_a_later_frame_and_returns_at_once_in_another_run() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let mut frame = get_json(&app, "/v1/lights").await["frame"].as_u64().expect("a number");
    for _ in 0..10 {
        let next = get_json(&app, &format!("/v1/lights?after={frame}")).await["frame"].as_u64();
        assert!(next > Some(frame), "{next:?} after {frame}");
        frame = next.expect("a number");
    }
    let began = std::time::Instant::now();
    let set = get_json(&app, "/v1/lights?after=999999999").await;
    assert!(set["frame"].as_u64() >= Some(frame) && began.elapsed() < Duration::from_millis(1000), "at once");
}

#[tokio::test]
async fn a_failed_source_is_stale_in_every_form() {
    let probe = probe(3);
    let app = routes(&probe);
    wait_for(&probe, 2).await;
    tokio::time::sleep(Duration::from_millis(1600)).await;
    let json = get_json(&app, "/v1/lights?after=0").await;
    assert_eq!(json["stale"]["reason"], "<unplugged>", "{json}");
    let binary = fetch(&app, "GET", "/v1/lights?after=0&format=binary", &[], "").await;
    let head = BinarySet::try_new(&binary.body).expect("a set").head();
    assert!(head.stale.is_some_and(|s| s.reason == "<unplugged>" && s.age_ms >= 1500), "{head:?}");
    assert!(get(&app, "/v1/lights?after=0&format=text").await.2.contains("# stale "), "text");
    assert!(get(&app, "/v1/lights?after=0&format=xml").await.2.contains(" ms &lt;unplugged&gt;\""), "XML");
    let xr = get_json(&app, "/v1/xr").await;
    assert_eq!(xr["stale"]["reason"], "<unplugged>", "{xr}");
}

#[tokio::test]
async fn every_value_that_the_schema_allows_is_accepted() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let config = get_json(&app, "/v1/config").await;
    assert_eq!(config["can_save"], false, "no file");
    let settings = config["settings"].as_object().expect("settings").clone();
    assert!(settings.len() >= 4, "{config}");
    for (name, setting) in &settings {
        assert_eq!(setting["value"], config["values"][name], "{name}");
        assert!(setting["description"].as_str().is_some_and(|d| d.ends_with('.')), "{name}");
        let kinds = setting["type"].as_array().map_or_else(|| vec![setting["type"].clone()], Clone::clone);
        let mut values = match kinds[0].as_str() {
            Some("string") => setting["enum"].as_array().expect("words").clone(),
            Some("integer") => {
                let (least, most) =
                    (setting["minimum"].clone(), setting["maximum"].as_u64().expect("a number"));
                vec![least, most.min(300).into()]
            }
            Some("number") => vec![setting["minimum"].clone(), 0.5.into(), setting["maximum"].clone()],
            Some("boolean") => vec![true.into(), false.into()],
            Some("array") => vec![serde_json::json!([0.002, 0.03]), serde_json::json!([0.001])],
            other => panic!("{name}: {other:?}"),
        };
        if kinds.contains(&"null".into()) {
            values.push(Value::Null);
        }
        for value in values {
            let mut wish = serde_json::json!({"sampler": "adaptive"});
            wish[name] = value.clone();
            let wish = wish.to_string();
            let got = patch(&app, "/v1/config", &wish).await;
            assert_eq!((got.status, &got.json()["values"][name]), (200, &value), "{wish}: {}", got.text());
        }
    }
    let set = get_json(&app, "/v1/lights").await;
    assert_eq!(set["requested"], 300, "in the next set");
}

#[tokio::test]
async fn wrong_settings_are_refused_with_a_reason_for_each_field() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let wish = "{\"lights\": 20, \"sampler\": \"guess\", \"colour\": 1}";
    let got = fetch(&app, "PATCH", "/v1/config", &[], wish).await;
    let errors = got.json()["errors"].clone();
    assert_eq!((got.status, errors.as_object().map(|e| e.len())), (400, Some(2)), "{errors}");
    assert!(errors["sampler"].as_str().is_some_and(|e| e.contains("adaptive")), "{errors}");
    for wrong in [
        "",
        "[]",
        "20",
        "{",
        "{\"lights\": 0}",
        "{\"lights\": \"20\"}",
        "{\"lights\": 2.5}",
        "{\"lights\": null}",
        "{\"sampler\":\"q2tree\",\"lights\":1}",
    ] {
        assert_eq!(fetch(&app, "PATCH", "/v1/config", &[], wrong).await.status, 400, "{wrong}");
    }
    assert_eq!(
        fetch(&app, "PATCH", "/v1/config?save=1", &[], "{\"lights\": 20}").await.status,
        409,
        "no file"
    );
    assert_eq!(fetch(&app, "PATCH", "/v1/config?x=1", &[], "{\"lights\": 20}").await.status, 400, "query");
    assert_eq!(probe.link().settings().applied().borrow().config, Config::steady(), "unchanged");
}

#[tokio::test]
async fn settings_are_saved_on_request() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("hemilux.toml");
    std::fs::write(&path, "# ours\n").expect("a file");
    let file = ConfigFile::open(&path).expect("a configuration").file;
    let probe = probe(usize::MAX);
    let app = app(probe.link(), Options { file: Some(file), ..Options::default() }).router();
    assert_eq!(patch(&app, "/v1/config", "{\"lights\": 21}").await.status, 200, "not kept");
    assert_eq!(std::fs::read_to_string(&path).expect("a file"), "# ours\n", "untouched");
    let got = patch(&app, "/v1/config?save=1", "{\"gui\": true}").await;
    assert_eq!(got.status, 200, "{}", got.text());
    let kept = ConfigFile::open(&path).expect("a configuration").kept;
    assert_eq!(
        (kept.settings["lights"].as_integer(), kept.settings["gui"].as_bool()),
        (Some(21), Some(true)),
        "kept"
    );
}

#[tokio::test]
async fn the_estimate_has_the_names_and_sizes_of_webxr() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    let xr = get_json(&app, "/v1/xr").await;
    let real = |v: &Value| v.as_f64().expect("a number");
    let d = &xr["primaryLightDirection"];
    let length = (real(&d["x"]).powi(2) + real(&d["y"]).powi(2) + real(&d["z"]).powi(2)).sqrt();
    assert!((length - 1.0).abs() < 1e-4 && real(&d["y"]) > 0.0 && d["w"] == 0.0, "up is +Y: {d}");
    assert!(real(&xr["primaryLightIntensity"]["y"]) > 0.0, "{xr}");
    assert_eq!(xr["sphericalHarmonicsCoefficients"].as_array().map(Vec::len), Some(27), "27 floats");
}

#[tokio::test]
async fn events_begin_with_the_newest_set_and_continue_with_each_frame() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    wait_for(&probe, 0).await;
    let request = Request::builder().uri("/v1/events?lights=3").header("host", "localhost");
    let response =
        app.clone().oneshot(request.body(Body::empty()).expect("a request")).await.expect("an answer");
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let mut stream = response.into_body().into_data_stream();
    let mut frames = Vec::new();
    while frames.len() < 6 {
        let chunk = futures_util::StreamExt::next(&mut stream).await.expect("more").expect("bytes");
        let text = std::str::from_utf8(&chunk).expect("UTF-8");
        assert!(text.ends_with("\n\n"), "{text}");
        let Some((id, data)) = text.split_once("\ndata: ") else { continue };
        let set: Value = serde_json::from_str(data).expect("JSON");
        assert_eq!(id, format!("id: {}-{}", probe.link().run(), set["frame"]), "its id");
        assert!(set["lights"].as_array().is_some_and(|l| l.len() <= 3), "thinned");
        frames.push(set["frame"].as_u64().expect("a number"));
    }
    assert!(frames.windows(2).all(|w| w[1] > w[0]), "{frames:?}");
}

#[tokio::test]
async fn metrics_and_status_count_requests_and_frames() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for _ in 0..3 {
        get(&app, "/data").await;
    }
    get(&app, "/nothing").await;
    ask(&app, "GET", "/", &[("host", "evil.example")]).await;
    let (_, kind, text) = get(&app, "/metrics").await;
    assert_eq!(kind, "text/plain; version=0.0.4; charset=utf-8");
    for line in [
        "hemilux_requests_total{path=\"/data\",status=\"2xx\"} 3",
        "hemilux_requests_total{path=\"other\",status=\"4xx\"} 1",
        "hemilux_refused_total{reason=\"host\"} 1",
        "hemilux_delivery_seconds_count 3",
        "hemilux_source_up 1",
        "hemilux_camera_frames_total{exposure=\"verified\"} 7",
        "hemilux_camera_frames_total{exposure=\"measured\"} 5",
        "hemilux_camera_broken_total{fault=\"short\"} 2",
        "hemilux_camera_lost_total 3",
        "hemilux_camera_writes_total{fault=\"refused\"} 4",
        "hemilux_camera_view_ratio 0.25",
        "hemilux_camera_exposure_seconds{exposure=\"1\",known=\"measured\"} 0.0039",
    ] {
        assert!(text.lines().any(|l| l == line), "{line} in {text}");
    }
    let status = get_json(&app, "/v1/status").await;
    assert_eq!(
        (&status["source"], &status["needs_token"]),
        (&"test:mortal".into(), &false.into()),
        "{status}"
    );
    assert!(status["last"]["lights"].as_u64() > Some(0), "{status}");
    let camera = &status["camera"];
    assert_eq!(
        (&camera["exposures"][1]["known"], &camera["frames"]["short"], &camera["view"]["share"]),
        (&"measured".into(), &2.into(), &0.25.into()),
        "{camera}"
    );
}
