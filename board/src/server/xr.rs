//! `/v1/xr`: what a WebXR light estimate holds.

use super::lights::{Format, answer};
use super::{Context, line};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::Response;
use hemilux_core::wire::{LightSet, estimate};
use serde_json::json;

/// The next frame's main light and the spherical harmonics of the rest, named and ordered as `XRLightEstimate` does.
pub(super) async fn xr(state: State<Context>, uri: Uri) -> Response {
    if uri.query().is_some_and(|query| !query.is_empty()) {
        return line(StatusCode::BAD_REQUEST, "found parameters, expected none");
    }
    answer(state, uri, HeaderMap::new(), Some(Format::Estimate)).await
}

/// The document of `set`, a line of JSON.
pub(super) fn document(set: &LightSet<'_>) -> String {
    let estimate = estimate(set);
    let [x, y, z] = estimate.direction.to_array();
    let [r, g, b] = estimate.intensity;
    let stale = set.stale.as_ref().map(|stale| json!({"age_ms": stale.age_ms, "reason": stale.reason}));
    let document = json!({
        "run": set.run,
        "frame": set.frame,
        "stale": stale,
        "unit": set.unit.name(),
        "primaryLightDirection": {"x": x, "y": y, "z": z, "w": 0.0},
        "primaryLightIntensity": {"x": r, "y": g, "z": b, "w": 1.0},
        "sphericalHarmonicsCoefficients": estimate.harmonics.as_flattened(),
    });
    format!("{document}\n")
}
