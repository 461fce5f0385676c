//! Light sets as Mitsuba 3 scenes: one `directional` emitter for each light, for `<include>` or as a scene of its own.

use super::{Numbers, Text, notes, xml_comment};
use hemilux_core::color::luminance;
use hemilux_core::wire::LightSet;

/// Least weight of an emitter: Mitsuba refuses scenes whose weights are all zero.
const LEAST_WEIGHT: f32 = 1e-9;

const LOSSES: [&str; 2] = [
    "left out: angular radii, since directional emitters are points",
    "irradiance is perpendicular to the light; direction is that in which the light travels; values are linear Rec. 709",
];

pub(super) fn text(set: &LightSet<'_>) -> String {
    let mut text = Text::default();
    text.line("<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
    for note in notes(set, &LOSSES) {
        text.line(xml_comment(&note));
    }
    text.line("<scene version=\"3.0.0\">");
    for light in set.lights {
        let travel = set.coordinates.direction(-light.direction).to_array();
        let [x, y, z] = travel.map(|v| Numbers([v], "").to_string());
        let irradiance = Numbers(light.irradiance, ", ");
        text.line(format_args!("    <emitter type=\"directional\" id=\"light_{}\">", light.id));
        text.line(format_args!("        <vector name=\"direction\" x=\"{x}\" y=\"{y}\" z=\"{z}\"/>"));
        text.line(format_args!("        <rgb name=\"irradiance\" value=\"{irradiance}\"/>"));
        let weight = Numbers([luminance(light.irradiance).max(LEAST_WEIGHT)], "");
        text.line(format_args!(
            "        <float name=\"sampling_weight\" value=\"{weight}\"/>\n    </emitter>"
        ));
    }
    text.line("</scene>");
    text.0
}
