//! Replacement of the source while the probe runs.

use super::security::locked;
use super::*;
use crate::source::{Library, Spec};

const JSON: (&str, &str) = ("content-type", "application/json");

fn with_library(probe: &Probe, folder: &std::path::Path) -> Router {
    let library = Library::new(Spec::Scene("lamps"), vec![folder.into()]);
    app(probe.link(), Options { library, ..Options::default() }).router()
}

/// Waits until the probe has published a set of a later frame and returns it.
async fn next(app: &Router) -> Value {
    let (status, _, text) = get(app, "/v1/lights").await;
    assert_eq!(status, 200, "{text}");
    serde_json::from_str(&text).expect("a set")
}

#[tokio::test]
async fn the_lights_of_a_new_source_follow_within_the_next_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let map =
        crate::maps::write::openexr(64, 32, crate::maps::Covers::Sphere, |_, _| [2.0; 3]).expect("a map");
    std::fs::write(folder.path().join("grey.exr"), map).expect("a file");
    let probe = probe(usize::MAX);
    let app = with_library(&probe, folder.path());
    let choices = fetch(&app, "GET", "/v1/source", &[], "").await.json()["choices"].clone();
    let choices: Vec<_> = choices.as_array().expect("names").iter().filter_map(Value::as_str).collect();
    assert!(choices.contains(&"scene:sky") && choices.contains(&"env:grey.exr,view=whole"), "{choices:?}");
    let body = "{\"source\": \"env:grey.exr,view=whole\"}";
    let got = fetch(&app, "PATCH", "/v1/source", &[JSON], body).await;
    assert_eq!(got.status, 200, "{}", got.text());
    let mut ground = 0.0;
    for _ in 0..40 {
        ground = next(&app).await["horizontal_irradiance"][1].as_f64().expect("a number");
        if (ground / (2.0 * std::f64::consts::PI) - 1.0).abs() < 0.01 {
            break;
        }
    }
    assert!((ground / (2.0 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{ground}");
    let status = fetch(&app, "GET", "/v1/status", &[], "").await.json();
    assert_eq!(
        (status["source"].as_str(), &status["fault"]),
        (Some("env:grey.exr,view=whole"), &Value::Null)
    );
    let exposures = fetch(&app, "GET", "/v1/config", &[], "").await.json();
    assert_eq!(
        exposures["settings"]["exposures_s"]["current"].as_array().map(Vec::len),
        Some(2),
        "its own exposures"
    );
    let back = fetch(&app, "PATCH", "/v1/source", &[JSON], "{\"source\": \"scene:room\"}").await;
    assert_eq!(back.status, 200, "{}", back.text());
}

#[tokio::test]
async fn unlisted_sources_are_refused_and_the_source_stays() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("broken.exr"), "not a map").expect("a file");
    let probe = probe(usize::MAX);
    let app = with_library(&probe, folder.path());
    for (body, status, named) in [
        ("{\"source\": \"env:/etc/passwd\"}", 400, "/etc/passwd"),
        ("{\"source\": \"replay:../x\"}", 400, "GET /v1/source"),
        ("{\"source\": 3}", 400, "JSON object"),
        ("scene:sky", 400, "JSON object"),
        ("{\"source\": \"env:broken.exr\"}", 409, "could not be opened"),
    ] {
        let got = fetch(&app, "PATCH", "/v1/source", &[JSON], body).await;
        assert_eq!(got.status, status, "{body}: {}", got.text());
        assert!(
            got.text().contains(named) && !got.text().contains(&folder.path().display().to_string()),
            "{}",
            got.text()
        );
    }
    assert_eq!(fetch(&app, "GET", "/v1/source", &[], "").await.json()["source"], "test:mortal");
}

#[tokio::test]
async fn a_change_of_the_source_requires_the_token() {
    let probe = probe(usize::MAX);
    let got = fetch(&locked(&probe), "PATCH", "/v1/source", &[JSON], "{\"source\": \"scene:sky\"}").await;
    assert_eq!(got.status, 401, "{}", got.text());
}
