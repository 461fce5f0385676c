//! Tests of the server's routes without sockets.

mod calibration;
mod compare;
mod openapi;
mod pictures;
mod security;
mod sources;
mod thesis;
mod transport;
mod v1;
mod whole;

use super::*;
use crate::calibration::Burst;
use crate::camera_status::{CameraStatus, ExposureStatus, FrameCounts, KnownCounts, ViewStatus};
use crate::probe::{Config, Probe};
use crate::scene;
use crate::source::{Adapter, Pace, SceneSource, Source, SourceError};
use axum::body::Body;
use axum::http::Request;
use serde_json::Value;
use std::time::Duration;
use tower::ServiceExt;

/// Returns the routes of a server for this machine alone, without a token.
fn routes(probe: &Probe) -> Router {
    app(probe.link(), Options::default()).router()
}

/// A source that delivers `left` bursts of a scene and then fails.
struct Mortal {
    scene: SceneSource,
    left: usize,
}

impl Adapter for Mortal {
    fn inner(&self) -> &dyn Source {
        &self.scene
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        &mut self.scene
    }

    fn camera(&self, status: &mut CameraStatus) -> bool {
        let exposure = |seconds, known| ExposureStatus { asked_s: 0.001, seconds, known };
        *status = CameraStatus {
            exposures: vec![exposure(0.001, "verified"), exposure(0.0039, "measured")],
            view: Some(ViewStatus { share: 0.25, crop: [8, 6, 16, 12], binning: [1, 1] }),
            known: KnownCounts { verified: 7, measured: 5, ..KnownCounts::default() },
            frames: FrameCounts { complete: 12, lost: 3, short: 2, ..FrameCounts::default() },
            failed_writes: 4,
            ..CameraStatus::default()
        };
        true
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.left = self.left.checked_sub(1).ok_or_else(|| SourceError::Gone("<unplugged>".into()))?;
        self.scene.next(burst)
    }
}

fn probe(bursts: usize) -> Probe {
    let scene = scene::by_name("lamps").expect("a scene");
    let scene = SceneSource::new(scene, Pace::Every(Duration::from_millis(20)));
    Probe::start(Box::new(Mortal { scene, left: bursts }), "test:mortal".into(), Config::steady())
        .expect("a probe")
}

/// The answer to a request, with its whole body.
struct Got {
    status: u16,
    headers: axum::http::HeaderMap,
    body: Vec<u8>,
}

impl Got {
    fn text(&self) -> &str {
        std::str::from_utf8(&self.body).expect("UTF-8")
    }

    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |v| v.to_str().expect("text"))
    }
}

/// Sends a request with these headers and returns the answer.
async fn fetch(app: &Router, method: &str, uri: &str, headers: &[(&str, &str)], body: &str) -> Got {
    let mut request = Request::builder().method(method).uri(uri);
    if !headers.iter().any(|(name, _)| *name == "host") {
        request = request.header("host", "localhost:8080");
    }
    let request = headers.iter().fold(request, |r, (name, value)| r.header(*name, *value));
    let request = request.body(Body::from(body.to_owned())).expect("a request");
    let response = app.clone().oneshot(request).await.expect("an answer");
    let (parts, body) = response.into_parts();
    let bytes = axum::body::to_bytes(body, 1 << 24).await.expect("a body");
    Got { status: parts.status.as_u16(), headers: parts.headers, body: bytes.to_vec() }
}

/// Repeats a request that changes settings until a frame has applied it (status 202 before), which may take long on a busy machine.
async fn patch(app: &Router, uri: &str, wish: &str) -> Got {
    loop {
        let got = fetch(app, "PATCH", uri, &[], wish).await;
        if got.status != 202 {
            return got;
        }
    }
}

/// Sends a request with these headers and returns status, content type and body of the answer.
async fn ask(app: &Router, method: &str, uri: &str, headers: &[(&str, &str)]) -> (u16, String, String) {
    let got = fetch(app, method, uri, headers, "").await;
    (got.status, got.header("content-type").to_owned(), String::from_utf8_lossy(&got.body).into_owned())
}

async fn get(app: &Router, uri: &str) -> (u16, String, String) {
    ask(app, "GET", uri, &[]).await
}
