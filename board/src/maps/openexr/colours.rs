//! The primaries of an OpenEXR file, from the attribute `chromaticities` or from the name of a colour space.

use super::super::primaries::{Primaries, REC_709};
use super::attribute;
use exr::meta::attribute::AttributeValue;
use exr::meta::header::Header;

/// Primaries, and the name of the attribute that states them.
pub(super) struct Space {
    pub primaries: Primaries,
    pub stated_by: String,
}

/// Primaries and white point of ACES2065-1 (SMPTE ST 2065-1).
const AP0: Primaries = Primaries([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]]);

/// Primaries and white point of ACEScg.
const AP1: Primaries = Primaries([[0.713, 0.293], [0.165, 0.83], [0.128, 0.044], [0.32168, 0.33767]]);

const REC_2020: Primaries = Primaries([[0.708, 0.292], [0.17, 0.797], [0.131, 0.046], [0.3127, 0.329]]);
const P3_D65: Primaries = Primaries([[0.68, 0.32], [0.265, 0.69], [0.15, 0.06], [0.3127, 0.329]]);

/// Names of scene-linear colour spaces: those of the Color Interop Forum and of OpenColorIO's configurations.
const NAMES: [(&str, Primaries); 21] = [
    ("lin_rec709_scene", REC_709),
    ("lin_rec709", REC_709),
    ("lin_srgb", REC_709),
    ("linear", REC_709),
    ("scene_linear", REC_709),
    ("linear rec.709 (srgb)", REC_709),
    ("linear rec.709", REC_709),
    ("linear srgb", REC_709),
    ("lin_ap0_scene", AP0),
    ("lin_ap0", AP0),
    ("aces2065-1", AP0),
    ("aces - aces2065-1", AP0),
    ("lin_ap1_scene", AP1),
    ("lin_ap1", AP1),
    ("acescg", AP1),
    ("aces - acescg", AP1),
    ("lin_rec2020_scene", REC_2020),
    ("lin_rec2020", REC_2020),
    ("linear rec.2020", REC_2020),
    ("lin_p3d65_scene", P3_D65),
    ("linear p3-d65", P3_D65),
];

/// Returns the colour space that the OpenEXR header states; for an unknown name, a note is added to `notes`.
pub(super) fn of(header: &Header, notes: &mut Vec<String>) -> Option<Space> {
    if let Some(c) = header.shared_attributes.chromaticities {
        let primaries = Primaries([c.red, c.green, c.blue, c.white].map(|v| [v.x().into(), v.y().into()]));
        return Some(Space { primaries, stated_by: "chromaticities".into() });
    }
    if let Some(AttributeValue::I32(1)) = attribute(header, "acesImageContainerFlag") {
        return Some(Space { primaries: AP0, stated_by: "acesImageContainerFlag".into() });
    }
    for key in ["colorInteropID", "oiio:ColorSpace"] {
        let Some(AttributeValue::Text(name)) = attribute(header, key) else { continue };
        let name = name.to_string();
        let stated_by = format!("{key} {name}");
        if let Some((_, primaries)) = NAMES.iter().find(|(known, _)| known.eq_ignore_ascii_case(&name)) {
            return Some(Space { primaries: *primaries, stated_by });
        }
        notes.push(format!("{stated_by} is not known and not applied: the map is read as linear Rec. 709"));
    }
    None
}
