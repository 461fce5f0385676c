//! The XML form of a light set.

use super::{LightSet, decimal, numbers, put, whole};
use embedded_io::Write;

/// Writes `set` as one `<lights>` element with one `<light>` element per light.
///
/// ```
/// use hemilux_core::Light;
/// use hemilux_core::wire::{LightSet, xml};
///
/// let light = Light { id: 7, direction: glam::Vec3::Z, irradiance: [3.0, 2.0, 1.0], ..Light::default() };
/// let mut bytes = [0; 512];
/// let mut rest = &mut bytes[..];
/// xml(&LightSet { lights: &[light], ..LightSet::EMPTY }, &mut rest)?;
/// let used = 512 - rest.len();
/// let element = br#"<light id="7" x="0" y="0" z="1" r="3" g="2" b="1"/></lights>"#;
/// assert!(bytes[..used].ends_with(element));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Errors of the writer `w`, such as a full buffer.
pub fn xml<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), W::Error> {
    put(w, "<lights version=\"1\" run=\"")?;
    escaped(w, set.run)?;
    put(w, "\" frame=\"")?;
    whole(w, set.frame)?;
    put(w, "\" sampler=\"")?;
    escaped(w, set.sampler)?;
    for part in ["\" unit=\"", set.unit.name()] {
        put(w, part)?;
    }
    if let Some(uncertainty) = set.unit_uncertainty {
        put(w, "\" unit_uncertainty=\"")?;
        decimal(w, uncertainty)?;
    }
    for part in ["\" coordinates=\"", set.coordinates.name(), "\" stale=\""] {
        put(w, part)?;
    }
    if let Some(stale) = set.stale {
        whole(w, stale.age_ms)?;
        put(w, " ms ")?;
        escaped(w, stale.reason)?;
    }
    if let Some(left_out) = &set.left_out {
        put(w, "\" left_out=\"")?;
        numbers(w, left_out, " ")?;
    }
    put(w, "\">")?;
    for light in set.lights {
        put(w, "<light id=\"")?;
        whole(w, light.id.into())?;
        let d = set.coordinates.direction(light.direction);
        let [r, g, b] = light.irradiance;
        for (name, v) in [("x", d.x), ("y", d.y), ("z", d.z), ("r", r), ("g", g), ("b", b)] {
            for part in ["\" ", name, "=\""] {
                put(w, part)?;
            }
            decimal(w, v)?;
        }
        put(w, "\"/>")?;
    }
    put(w, "</lights>")
}

/// Writes `s` as the text of an attribute; control characters and the two non-characters, which XML 1.0 forbids, become spaces.
fn escaped<W: Write>(w: &mut W, s: &str) -> Result<(), W::Error> {
    s.chars().try_for_each(|c| match c {
        '&' => put(w, "&amp;"),
        '<' => put(w, "&lt;"),
        '>' => put(w, "&gt;"),
        '"' => put(w, "&quot;"),
        '\u{fffe}' | '\u{ffff}' => put(w, " "),
        c if c.is_control() => put(w, " "),
        c => put(w, c.encode_utf8(&mut [0; 4])),
    })
}
