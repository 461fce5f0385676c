//! The plain text form of a light set: one light per line.

use super::{LightSet, decimal, numbers, put, whole};
use embedded_io::Write;

/// Writes `set` as comment lines that start with `#`, followed by one line `id x y z r g b` per light.
///
/// ```
/// use hemilux_core::Light;
/// use hemilux_core::wire::{LightSet, text};
///
/// let light = Light { id: 7, direction: glam::Vec3::Z, irradiance: [3.0, 2.0, 1.0], ..Light::default() };
/// let mut bytes = [0; 512];
/// let mut rest = &mut bytes[..];
/// text(&LightSet { lights: &[light], ..LightSet::EMPTY }, &mut rest)?;
/// let used = 512 - rest.len();
/// assert!(bytes[..used].ends_with(b"\n7 0 0 1 3 2 1\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Errors of the writer `w`, such as a full buffer.
pub fn text<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), W::Error> {
    put(w, "# run ")?;
    words(w, set.run)?;
    put(w, "\n# frame ")?;
    whole(w, set.frame)?;
    put(w, "\n# sampler ")?;
    words(w, set.sampler)?;
    for part in ["\n# unit ", set.unit.name()] {
        put(w, part)?;
    }
    if let Some(uncertainty) = set.unit_uncertainty {
        put(w, "\n# unit_uncertainty ")?;
        decimal(w, uncertainty)?;
    }
    for part in ["\n# coordinates ", set.coordinates.name(), "\n# stale "] {
        put(w, part)?;
    }
    match set.stale {
        None => put(w, "no")?,
        Some(stale) => {
            whole(w, stale.age_ms)?;
            put(w, " ms ")?;
            words(w, stale.reason)?;
        }
    }
    if let Some(left_out) = &set.left_out {
        put(w, "\n# left_out ")?;
        numbers(w, left_out, " ")?;
    }
    put(w, "\n")?;
    for light in set.lights {
        whole(w, light.id.into())?;
        put(w, " ")?;
        numbers(w, &set.coordinates.direction(light.direction).to_array(), " ")?;
        put(w, " ")?;
        numbers(w, &light.irradiance, " ")?;
        put(w, "\n")?;
    }
    Ok(())
}

/// Writes `s` to a comment line; control characters, which could end the line, become spaces.
fn words<W: Write>(w: &mut W, s: &str) -> Result<(), W::Error> {
    s.chars().try_for_each(|c| match c {
        c if c.is_control() => put(w, " "),
        c => put(w, c.encode_utf8(&mut [0; 4])),
    })
}
