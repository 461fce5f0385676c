//! The values of a WebXR light estimate, with the names and the order of `XRLightEstimate`.

use hemilux_core::wire::{LightSet, estimate};
use serde_json::json;

/// Returns the main light of `set` and the spherical harmonics of all other light as a line of JSON.
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
