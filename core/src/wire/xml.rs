//! Light set as XML.

use super::{EncodeError, Fmt, LightSet, number};
use embedded_io::Write;

/// Writes `set` as one `<lights>` element.
///
/// # Errors
/// [`EncodeError`] when the writer refuses.
pub fn xml<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), EncodeError<W::Error>> {
    Ok(element(set, w)?)
}

fn element<W: Write>(set: &LightSet<'_>, w: &mut W) -> Fmt<W::Error> {
    write!(w, "<lights version=\"1\" run=\"")?;
    escaped(w, set.run)?;
    write!(w, "\" frame=\"{}\" sampler=\"", set.frame)?;
    escaped(w, set.sampler)?;
    write!(w, "\" unit=\"{}\" coordinates=\"{}\" stale=\"", set.unit.name(), set.coordinates.name())?;
    if let Some(stale) = set.stale {
        write!(w, "{} ms ", stale.age_ms)?;
        escaped(w, stale.reason)?;
    }
    write!(w, "\">")?;
    for light in set.lights {
        let d = set.coordinates.direction(light.direction);
        let [r, g, b] = light.irradiance;
        write!(
            w,
            "<light id=\"{}\" x=\"{}\" y=\"{}\" z=\"{}\"",
            light.id,
            number(d.x),
            number(d.y),
            number(d.z)
        )?;
        write!(w, " r=\"{}\" g=\"{}\" b=\"{}\"/>", number(r), number(g), number(b))?;
    }
    write!(w, "</lights>")
}

/// Text of an attribute; control characters and the two non-characters, which XML 1.0 forbids, become spaces.
fn escaped<W: Write>(w: &mut W, s: &str) -> Fmt<W::Error> {
    for c in s.chars() {
        match c {
            '&' => write!(w, "&amp;")?,
            '<' => write!(w, "&lt;")?,
            '>' => write!(w, "&gt;")?,
            '"' => write!(w, "&quot;")?,
            '\u{fffe}' | '\u{ffff}' => write!(w, " ")?,
            c if c.is_control() => write!(w, " ")?,
            c => write!(w, "{c}")?,
        }
    }
    Ok(())
}
