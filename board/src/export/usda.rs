//! Light sets as USD text: a DistantLight for each light, and an invisible DomeLight with the map, so that no light counts twice.

use super::{Emission, Numbers, Text, emission, facing, notes, orientation};
use hemilux_core::light::Light;
use hemilux_core::wire::{Coordinates, LightSet};

const LOSSES: [&str; 4] = [
    "intensity times color is the perpendicular irradiance of a light; exposure is log2 of the part of it that a surface facing a disc of",
    "that angle receives, so that with inputs:normalize the disc has the energy of the light",
    "left out: identity over time, except in hemilux:id",
    "either the DistantLights or the DomeLight: it is invisible, so that no light counts twice",
];

pub(super) fn text(set: &LightSet<'_>, map: Option<&str>) -> String {
    let mut text = Text::default();
    text.line("#usda 1.0");
    text.line("(");
    text.line("    defaultPrim = \"Lights\"");
    text.line("    metersPerUnit = 1");
    text.line(format_args!(
        "    upAxis = \"{}\"",
        if set.coordinates == Coordinates::YUp { "Y" } else { "Z" }
    ));
    text.line(")");
    for note in notes(set, &LOSSES) {
        text.line(format_args!("# {note}"));
    }
    text.line("\ndef Xform \"Lights\"\n{");
    if let Some(map) = map {
        dome(&mut text, set.coordinates, map);
    }
    for light in set.lights {
        distant(&mut text, set, light);
    }
    text.line("}");
    text.0
}

fn distant(text: &mut Text, set: &LightSet<'_>, light: &Light) {
    let Emission { intensity, colour } = emission(light.irradiance);
    let [x, y, z, w] = orientation(set, light);
    let radius = light.radius_deg.clamp(0.0, 90.0);
    text.line(format_args!("    def DistantLight \"Light_{}\"\n    {{", light.id));
    text.line(format_args!("        float inputs:angle = {}", Numbers([2.0 * radius], "")));
    text.line(format_args!("        color3f inputs:color = ({})", Numbers(colour, ", ")));
    text.line(format_args!("        float inputs:exposure = {}", Numbers([facing(radius).log2()], "")));
    text.line(format_args!("        float inputs:intensity = {}", Numbers([intensity], "")));
    text.line("        bool inputs:normalize = 1");
    text.line(format_args!("        custom int64 hemilux:id = {}", light.id));
    text.line(format_args!("        quatf xformOp:orient = ({})", Numbers([w, x, y, z], ", ")));
    text.line("        uniform token[] xformOpOrder = [\"xformOp:orient\"]\n    }");
}

/// Writes the DomeLight of `map`. A latlong texture of USD has longitude 0 along +Z of a +Y-up frame and 90 degrees along +X; maps of
/// hemilux have longitude 0 along the probe's x and 90 degrees along its y. The rows of the matrix are the axes of the texture in those of
/// the file.
fn dome(text: &mut Text, axes: Coordinates, map: &str) {
    let rows = match axes {
        Coordinates::YUp => "(0, 0, -1, 0), (0, 1, 0, 0), (1, 0, 0, 0)",
        _ => "(0, 1, 0, 0), (0, 0, 1, 0), (1, 0, 0, 0)",
    };
    // A path between @@@ delimiters may contain single @.
    let path: String = map.chars().filter(|c| !c.is_control()).collect::<String>().replace("@@@", "");
    text.line("    def DomeLight \"Map\"\n    {");
    text.line(format_args!("        asset inputs:texture:file = @@@{path}@@@"));
    text.line("        token inputs:texture:format = \"latlong\"");
    text.line("        token visibility = \"invisible\"");
    text.line(format_args!("        matrix4d xformOp:transform = ( {rows}, (0, 0, 0, 1) )"));
    text.line("        uniform token[] xformOpOrder = [\"xformOp:transform\"]\n    }");
}
