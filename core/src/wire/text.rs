//! Light set as plain text: one light a line.

use super::{LightSet, numbers, put, whole};
use embedded_io::Write;

/// Writes `set` as comment lines that start with `#`, then `id x y z r g b` for each light.
///
/// # Errors
/// The writer's.
pub fn text<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), W::Error> {
    put(w, "# run ")?;
    words(w, set.run)?;
    put(w, "\n# frame ")?;
    whole(w, set.frame)?;
    put(w, "\n# sampler ")?;
    words(w, set.sampler)?;
    for part in ["\n# unit ", set.unit.name(), "\n# coordinates ", set.coordinates.name(), "\n# stale "] {
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

/// Words of a comment; control characters, which could end its line, become spaces.
fn words<W: Write>(w: &mut W, s: &str) -> Result<(), W::Error> {
    s.chars().try_for_each(|c| match c {
        c if c.is_control() => put(w, " "),
        c => put(w, c.encode_utf8(&mut [0; 4])),
    })
}
