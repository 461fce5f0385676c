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
    write!(w, "# run {}\n# frame {}\n# sampler {}\n", set.run, set.frame, set.sampler)?;
    write!(w, "# unit {}\n# coordinates {}\n", set.unit.name(), set.coordinates.name())?;
    match set.stale {
        None => writeln!(w, "# stale no")?,
        Some(stale) => {
            write!(w, "# stale {} ms ", stale.age_ms)?;
            for c in stale.reason.chars() {
                write!(w, "{}", if c.is_control() { ' ' } else { c })?;
            }
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
