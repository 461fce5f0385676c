//! A script for Blender's text editor: one sun for each light, identified by the light's id.

use super::{Emission, Numbers, Text, emission, facing, head_in_watts};
use hemilux_core::wire::LightSet;

const LOSSES: [&str; 2] = [
    "a sun's angle is twice the light's radius r, its strength what a surface facing that disc receives: irradiance times (1 + cos r) / 2",
    "run it again with another set: suns are matched by id, those that are gone are removed",
];

/// The constant part of the script, which creates suns from the script's table of lights.
const PROGRAM: &str = r#"
import math
import bpy
from mathutils import Vector

collection = bpy.data.collections.get("hemilux") or bpy.data.collections.new("hemilux")
if collection.name not in bpy.context.scene.collection.children:
    bpy.context.scene.collection.children.link(collection)
suns = {sun["hemilux_id"]: sun for sun in collection.objects if "hemilux_id" in sun}
for id in set(suns) - {light[0] for light in LIGHTS}:
    bpy.data.lights.remove(suns.pop(id).data)
for id, towards, strength, colour, radius_deg in LIGHTS:
    sun = suns.get(id)
    if sun is None:
        sun = bpy.data.objects.new(f"hemilux {id}", bpy.data.lights.new(f"hemilux {id}", "SUN"))
        sun["hemilux_id"] = id
        collection.objects.link(sun)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector(towards).to_track_quat("Z", "Y")
    sun.data.energy = strength
    sun.data.color = colour
    sun.data.angle = math.radians(2 * radius_deg)
"#;

pub(super) fn text(set: &LightSet<'_>) -> String {
    let mut text = Text::default();
    let factor = head_in_watts(&mut text, set, &LOSSES, "strength in W/m2 = lux");
    text.line("\n# id, direction towards the light (+Z up), strength, colour, radius in degrees");
    text.line("LIGHTS = [");
    for light in set.lights {
        let towards = Numbers(set.coordinates.direction(light.direction).to_array(), ", ");
        let received = factor * facing(light.radius_deg);
        let Emission { intensity: strength, colour } = emission(light.irradiance.map(|e| e * received));
        let radius = Numbers([light.radius_deg.clamp(0.0, 90.0)], "");
        let colour = Numbers(colour, ", ");
        let strength = Numbers([strength], "");
        // Blender stores integers in 32 bits with a sign; as text, every id fits.
        text.line(format_args!("    (\"{}\", ({towards}), {strength}, ({colour}), {radius}),", light.id));
    }
    text.line("]");
    text.0 + PROGRAM
}
