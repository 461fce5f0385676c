//! Light sets as comma-separated values: comments that start with `#`, a line of column names, then a line for each light.

use super::{Numbers, Text, notes};
use hemilux_core::wire::LightSet;

const LOSSES: [&str; 1] = ["left out: sums, clipped and unseen fractions, latencies; JSON has them"];

pub(super) fn text(set: &LightSet<'_>) -> String {
    let mut text = Text::default();
    for note in notes(set, &LOSSES) {
        text.line(format_args!("# {note}"));
    }
    text.line("id,x,y,z,r,g,b,radius_deg,age,parent");
    for light in set.lights {
        let direction = Numbers(set.coordinates.direction(light.direction).to_array(), ",");
        let irradiance = Numbers(light.irradiance, ",");
        let radius = Numbers([light.radius_deg], ",");
        let parent = light.parent.map_or_else(String::new, |id| id.to_string());
        text.line(format_args!("{},{direction},{irradiance},{radius},{},{parent}", light.id, light.age));
    }
    text.0
}
