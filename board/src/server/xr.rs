//! `/v1/xr`: what a WebXR light estimate holds.

use super::Context;
use super::config::answer;
use super::lights::{next_set, no_frame_yet};
use crate::probe::Staleness;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use hemilux_core::wire::{LightSet, estimate};
use serde_json::json;

/// The next frame's main light and the spherical harmonics of the rest, named and ordered as `XRLightEstimate` does.
pub(super) async fn xr(State(context): State<Context>) -> Response {
    let link = &context.link;
    let Some(found) = next_set(link, None).await else { return no_frame_yet(link) };
    let set = &found.set;
    let on_wire = LightSet { ambient_sh: set.ambient.as_ref(), ..set.on_wire(link.run(), None) };
    let estimate = estimate(&on_wire);
    let [x, y, z] = estimate.direction.to_array();
    let [r, g, b] = estimate.intensity;
    let stale =
        found.stale.as_ref().map(|Staleness { age_ms, reason }| json!({"age_ms": age_ms, "reason": reason}));
    let document = json!({
        "run": link.run(),
        "frame": set.frame,
        "stale": stale,
        "unit": on_wire.unit.name(),
        "primaryLightDirection": {"x": x, "y": y, "z": z, "w": 0.0},
        "primaryLightIntensity": {"x": r, "y": g, "z": b, "w": 1.0},
        "sphericalHarmonicsCoefficients": estimate.harmonics.as_flattened(),
    });
    answer(StatusCode::OK, &document)
}
