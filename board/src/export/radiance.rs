//! Light sets as Radiance scenes: one `source` for each light.

use super::{Numbers, Text, head_in_watts};
use hemilux_core::light::Light;
use hemilux_core::wire::LightSet;

const LOSSES: [&str; 2] = [
    "a light is a disc of uniform radiance and the light's energy; its least diameter is the sun's, 0.533 degrees",
    "left out: identity over time, except in names",
];

/// Least angular radius of a source, degrees: a source of radius 0 would need infinite radiance.
const LEAST_RADIUS_DEG: f32 = 0.2665;

pub(super) fn text(set: &LightSet<'_>) -> String {
    let mut text = Text::default();
    let factor =
        head_in_watts(&mut text, set, &LOSSES, "radiance in W/(m2 sr) of rpict and rtrace = luminance");
    for light in set.lights {
        source(&mut text, set, light, factor);
    }
    text.0
}

fn source(text: &mut Text, set: &LightSet<'_>, light: &Light, factor: f32) {
    let radius = light.radius_deg.clamp(LEAST_RADIUS_DEG, 90.0);
    // The solid angle of the cap, 2 pi (1 - cos r), is computed in a form without cancellation at small radii.
    let half = f64::from(radius).to_radians() / 2.0;
    let solid_angle = (4.0 * std::f64::consts::PI * half.sin() * half.sin()) as f32;
    let radiance = light.irradiance.map(|e| e / solid_angle * factor);
    let name = light.id;
    text.line(format_args!("\nvoid light light_{name}_emission\n0\n0\n3 {}", Numbers(radiance, " ")));
    let [x, y, z] = set.coordinates.direction(light.direction).to_array();
    let place = Numbers([x, y, z, 2.0 * radius], " ");
    text.line(format_args!("light_{name}_emission source light_{name}\n0\n0\n4 {place}"));
}
