//! `/v1/calibration`: the action `save` alone writes files, every step can be undone, wrong requests are refused on one line.

use super::*;

async fn post(app: &Router, body: &str) -> Got {
    fetch(app, "POST", "/v1/calibration", &[], body).await
}

fn app_with(probe: &Probe, path: &std::path::Path) -> Router {
    app(probe.link(), Options { calibration_file: Some(path.into()), ..Options::default() }).router()
}

const CIRCLE: &str = r#"{"do": "circle", "centre": [320, 240], "radius": 230, "field_deg": 180}"#;

#[tokio::test]
async fn only_save_writes_and_a_better_lens_is_not_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lens.toml");
    let better = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [640, 480]\ncentre = [319.5, 239.5]\nfocal = [146.0, 146.0]\n\
        max_angle_deg = 90.0\n[calibration]\ntypical_uncertainty_deg = 0.01\ncovered_deg = 80.0\n";
    std::fs::write(&path, better).expect("a file");
    let probe = probe(usize::MAX);
    let app = app_with(&probe, &path);
    let state = post(&app, CIRCLE).await.json();
    assert_eq!((&state["unsaved"], &state["circle"]["radius"]), (&true.into(), &230.0.into()), "{state}");
    let read = || std::fs::read_to_string(&path).expect("a file");
    assert_eq!(read(), better, "nothing is written");
    let got = post(&app, r#"{"do": "save"}"#).await;
    let why = got.json()["errors"]["save"].as_str().expect("a line").to_owned();
    assert_eq!(got.status, 409, "{why}");
    assert!(
        why.contains("lens.toml")
            && why.contains("force")
            && !why.contains(folder.path().to_str().expect("UTF-8")),
        "{why}"
    );
    assert_eq!(read(), better, "the better lens stays");
    let got = post(&app, r#"{"do": "save", "force": true}"#).await;
    assert_eq!((got.status, got.json()["unsaved"].clone()), (200, false.into()));
    assert!(read().contains("method = \"circle\""), "{}", read());
}

#[tokio::test]
async fn each_step_can_be_undone() {
    let probe = probe(usize::MAX);
    let app = app_with(&probe, std::path::Path::new("/nonexistent/lens.toml"));
    post(&app, CIRCLE).await;
    let second = post(&app, &CIRCLE.replace("230", "200")).await.json();
    assert_eq!(second["circle"]["radius"], 200.0);
    let undo = |part: &str| format!(r#"{{"do": "undo", "part": "{part}"}}"#);
    assert_eq!(post(&app, &undo("circle")).await.json()["circle"]["radius"], 230.0);
    let state = post(&app, &undo("circle")).await.json();
    assert!(state["circle"].is_null() && state["lens"].is_null(), "{state}");
    for count in [1, 2] {
        let state = post(&app, r#"{"do": "direct", "lux": 500, "class": "led"}"#).await.json();
        assert_eq!(state["photometric"].as_array().expect("readings").len(), count, "{state}");
        assert_eq!(state["photometric"][0]["class"], "led");
    }
    assert_eq!(
        post(&app, &undo("photometric")).await.json()["photometric"].as_array().map(Vec::len),
        Some(1)
    );
    let state = post(&app, r#"{"do": "start", "board": "8x6"}"#).await.json();
    assert_eq!(state["guide"]["views"], 0);
    let state = post(&app, r#"{"do": "look"}"#).await.json();
    assert!(state["guide"]["advice"].as_str().is_some_and(|a| a.contains("no board in view")), "{state}");
    let state = post(&app, r#"{"do": "reset"}"#).await.json();
    assert_eq!((&state["unsaved"], &state["guide"]), (&false.into(), &Value::Null));
}

#[tokio::test]
async fn wrong_actions_are_refused_on_one_line() {
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for (body, status, word) in [
        ("", 400, "expected an action"),
        ("{}", 400, "expected an action"),
        (r#"{"do": "fly"}"#, 400, "expected an action"),
        (r#"{"do": "look"}"#, 400, "start first"),
        (r#"{"do": "compute"}"#, 400, "start first"),
        (r#"{"do": "start", "board": "2x2"}"#, 400, "3 to 60"),
        (r#"{"do": "start", "board": "8x6", "kind": "dots"}"#, 400, "charuco"),
        (r#"{"do": "start", "board": "60x60", "kind": "aprilgrid"}"#, 400, "587"),
        (
            r#"{"do": "circle", "centre": [1e300, 0], "radius": 9, "field_deg": 180}"#,
            400,
            "expected a centre",
        ),
        (r#"{"do": "circle", "centre": [9, 9], "radius": 90, "field_deg": 1}"#, 400, "60 to 280"),
        (r#"{"do": "fit-vignetting"}"#, 400, "expected"),
        (r#"{"do": "direct", "lux": -1}"#, 400, "positive"),
        (r#"{"do": "direct", "lux": 1, "class": "A b"}"#, 400, "daylight"),
        (r#"{"do": "patch", "outline": [[1, 1]], "reflectance": 0.5, "lux": 9}"#, 400, "texels"),
        (r#"{"do": "patch", "outline": [], "reflectance": 7, "lux": 9}"#, 400, "a share"),
        (r#"{"do": "save"}"#, 409, "--calibration FILE"),
    ] {
        let got = post(&app, body).await;
        let errors = got.json()["errors"].as_object().expect("errors").clone();
        let line = errors.values().next().and_then(Value::as_str).expect("a line").to_owned();
        assert_eq!(got.status, status, "{body}: {line}");
        assert!(line.contains(word) && !line.contains('\n'), "{body}: {line}");
    }
}
