//! Light sets as binary glTF 2.0: one node and one directional light of KHR_lights_punctual for each light.

use super::{Emission, ExportError, emission, notes, orientation};
use hemilux_core::light::Light;
use hemilux_core::wire::LightSet;
use serde_json::{Value, json};

const LOSSES: [&str; 2] = [
    "left out: angular radii, since lights of KHR_lights_punctual are points; extras.radius_deg has them",
    "intensity times color is the perpendicular irradiance, in lux where the unit is lux",
];

const MAGIC: u32 = 0x4654_6c67;
const JSON_CHUNK: u32 = 0x4e4f_534a;

pub(super) fn write(set: &LightSet<'_>, bytes: &mut Vec<u8>) -> Result<(), ExportError> {
    let mut json = document(set).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let too_large = |_| ExportError::TooLarge(set.lights.len());
    let length = u32::try_from(json.len()).map_err(too_large)?;
    let whole = u32::try_from(json.len() + 20).map_err(too_large)?;
    for word in [MAGIC, 2, whole, length, JSON_CHUNK] {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes.extend_from_slice(&json);
    Ok(())
}

/// Returns the JSON of the scene. glTF forbids empty lists: a set without lights is a scene without nodes.
fn document(set: &LightSet<'_>) -> Value {
    let asset = json!({"version": "2.0", "generator": "hemilux", "extras": {"notes": notes(set, &LOSSES)}});
    if set.lights.is_empty() {
        return json!({"asset": asset, "scene": 0, "scenes": [{"name": "lights"}]});
    }
    let nodes: Vec<_> = set.lights.iter().enumerate().map(|(i, light)| node(set, light, i)).collect();
    let lights: Vec<_> = set.lights.iter().map(directional).collect();
    json!({
        "asset": asset,
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "scene": 0,
        "scenes": [{"name": "lights", "nodes": (0..nodes.len()).collect::<Vec<_>>()}],
        "nodes": nodes,
    })
}

fn node(set: &LightSet<'_>, light: &Light, index: usize) -> Value {
    json!({
        "name": format!("light-{}", light.id),
        "rotation": orientation(set, light),
        "extensions": {"KHR_lights_punctual": {"light": index}},
        "extras": {"id": light.id, "age": light.age, "radius_deg": light.radius_deg},
    })
}

fn directional(light: &Light) -> Value {
    let Emission { intensity, colour: color } = emission(light.irradiance);
    json!({"type": "directional", "name": format!("light-{}", light.id), "color": color, "intensity": intensity})
}
