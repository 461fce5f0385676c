//! Tests that the OpenAPI document describes the routes of the server.

use super::security::locked;
use super::*;
use crate::server::client::OPENAPI;
use crate::server::paths::PATHS;
use std::collections::BTreeSet;

const METHODS: [&str; 5] = ["GET", "POST", "PATCH", "PUT", "DELETE"];

#[test]
fn the_document_has_short_lines() {
    let longest = include_str!("../openapi.json").lines().map(str::len).max();
    assert!(longest <= Some(160), "{longest:?}");
}

fn document() -> Value {
    serde_json::from_str(&OPENAPI).expect("JSON")
}

/// Returns `path` with its parameters filled in, so that it can be requested.
fn filled(path: &str) -> String {
    let query = match path {
        "/change" => "?samples=20",
        "/v1/compare" => "?algorithm=q2tree",
        _ => "",
    };
    path.replace("{name}", "x.png").replace("{index}", "0") + query
}

#[tokio::test]
async fn the_document_lists_every_route_and_method_and_no_other() {
    let document = document();
    let described: BTreeSet<_> =
        document["paths"].as_object().expect("paths").keys().map(String::as_str).collect();
    assert_eq!(described, PATHS.into_iter().collect(), "paths");
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for path in PATHS {
        for method in METHODS {
            let is_described = document["paths"][path].get(method.to_lowercase()).is_some();
            let request = Request::builder().method(method).uri(filled(path)).header("host", "localhost");
            let request = request.body(Body::empty()).expect("a request");
            // The test reads only the head of the answer: event streams have no end.
            let status = app.clone().oneshot(request).await.expect("an answer").status().as_u16();
            assert_eq!(status != 405, is_described, "{method} {path}: {status}");
            let known = is_described.then(|| &document["paths"][path][method.to_lowercase()]["responses"]);
            let is_known = known.is_none_or(|r| r.get(status.to_string()).is_some());
            assert!(
                is_known || (path == "/login" && status == 200),
                "{method} {path}: {status} is not described"
            );
        }
    }
}

#[tokio::test]
async fn requests_documented_as_protected_require_the_token() {
    let document = document();
    let probe = probe(usize::MAX);
    let app = locked(&probe);
    let mut protected = 0;
    for path in PATHS {
        for (method, operation) in document["paths"][path].as_object().expect("operations") {
            let request = Request::builder().method(method.to_uppercase().as_str()).uri(filled(path));
            let request = request.header("host", "localhost").body(Body::empty()).expect("a request");
            let status = app.clone().oneshot(request).await.expect("an answer").status().as_u16();
            let is_described = operation.get("security").is_some();
            assert_eq!(status == 401, is_described, "{method} {path}: {status}");
            protected += usize::from(is_described);
        }
    }
    assert_eq!(
        protected, 17,
        "two ways to change, the config, the source, the comparison, two of the calibration, and ten with pictures"
    );
}

/// Asserts that `value` has all that `schema` requires, with references resolved.
fn check(document: &Value, schema: &Value, value: &Value, place: &str) {
    let named = schema["$ref"].as_str().and_then(|r| document.pointer(r.trim_start_matches('#')));
    let schema = named.unwrap_or(schema);
    let may_be_null = schema["type"].as_array().is_some_and(|kinds| kinds.contains(&"null".into()));
    if value.is_null() && may_be_null {
        return;
    }
    for key in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        assert!(value.get(key).is_some(), "{place} has no {key}");
    }
    if let Some(object) = value.as_object().filter(|_| schema["properties"].is_object()) {
        for (key, inner) in object {
            let known = schema["properties"].get(key).or_else(|| schema.get("additionalProperties"));
            let known = known.unwrap_or_else(|| panic!("{place}.{key} is not described"));
            check(document, known, inner, &format!("{place}.{key}"));
        }
    }
    if let (Some(items), Some(values)) = (schema.get("items"), value.as_array()) {
        let least = schema["minItems"].as_u64().unwrap_or(0);
        assert!(values.len() as u64 >= least, "{place} is too short");
        values.iter().for_each(|v| check(document, items, v, place));
    }
}

/// Each refusal lists the accepted parameters of its path; the document must list the same.
#[tokio::test]
async fn the_document_lists_every_accepted_parameter() {
    let document = document();
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for path in ["/change", "/v1/compare", "/v1/lights", "/v1/map.png", "/v1/map.exr", "/v1/map.hdr"] {
        let (_, _, text) = get(&app, &format!("{path}?x=1")).await;
        let (_, accepted) = text.split_once("Accepted:\n").unwrap_or_else(|| panic!("{path}: {text}"));
        let names = accepted.lines().filter_map(|l| l.split_once('=')).map(|(name, _)| name);
        let taken: BTreeSet<_> = names.collect();
        let parameters = document["paths"][path]["get"]["parameters"].as_array().expect("parameters");
        let resolved = |p: &Value| {
            p["$ref"].as_str().and_then(|r| document.pointer(r.trim_start_matches('#'))).unwrap_or(p)["name"]
                .as_str()
                .map(str::to_owned)
        };
        let described: BTreeSet<_> = parameters.iter().filter_map(resolved).collect();
        let taken: BTreeSet<_> = taken.into_iter().map(str::to_owned).collect();
        assert_eq!(described, taken, "{path}");
    }
}

#[tokio::test]
async fn answers_have_the_properties_of_their_schemas() {
    let document = document();
    let probe = probe(usize::MAX);
    let app = routes(&probe);
    for (path, schema) in [
        ("/v1/lights?ambient=1", "LightSet"),
        ("/v1/config", "Config"),
        ("/v1/compare?algorithm=q2tree", "Comparison"),
        ("/v1/xr", "Estimate"),
        ("/v1/calibration", "CalibrationState"),
        ("/v1/source", "Sources"),
    ] {
        let got = fetch(&app, "GET", path, &[], "").await;
        check(&document, &document["components"]["schemas"][schema], &got.json(), schema);
    }
    let got = fetch(&app, "PATCH", "/v1/config", &[], "{\"x\": 1}").await;
    check(&document, &document["components"]["schemas"]["Errors"], &got.json(), "Errors");
}
