//! Light set as plain text: one light a line.

use super::{EncodeError, Fmt, LightSet, numbers};
use embedded_io::Write;

/// Writes `set` as comment lines that start with `#`, then `id x y z r g b` for each light.
///
/// # Errors
/// [`EncodeError`] when the writer refuses.
pub fn text<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), EncodeError<W::Error>> {
    Ok(lines(set, w)?)
}

fn lines<W: Write>(set: &LightSet<'_>, w: &mut W) -> Fmt<W::Error> {
    write!(w, "# run ")?;
    words(w, set.run)?;
    write!(w, "\n# frame {}\n# sampler ", set.frame)?;
    words(w, set.sampler)?;
    write!(w, "\n# unit {}\n# coordinates {}\n", set.unit.name(), set.coordinates.name())?;
    match set.stale {
        None => writeln!(w, "# stale no")?,
        Some(stale) => {
            write!(w, "# stale {} ms ", stale.age_ms)?;
            words(w, stale.reason)?;
            writeln!(w)?;
        }
    }
    for light in set.lights {
        write!(w, "{} ", light.id)?;
        numbers(w, &set.coordinates.direction(light.direction).to_array(), " ")?;
        write!(w, " ")?;
        numbers(w, &light.irradiance, " ")?;
        writeln!(w)?;
    }
    Ok(())
}

/// Words of a comment; control characters, which could end its line, become spaces.
fn words<W: Write>(w: &mut W, s: &str) -> Fmt<W::Error> {
    for c in s.chars() {
        write!(w, "{}", if c.is_control() { ' ' } else { c })?;
    }
    Ok(())
}
