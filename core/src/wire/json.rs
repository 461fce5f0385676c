//! Light set as JSON.

use super::{EncodeError, Fmt, LightSet, number, numbers};
use crate::light::{Light, Sh9};
use embedded_io::Write;

/// Writes `set` as one JSON object without a line break.
///
/// # Errors
/// [`EncodeError`] when the writer refuses.
pub fn json<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), EncodeError<W::Error>> {
    Ok(object(set, w)?)
}

fn object<W: Write>(set: &LightSet<'_>, w: &mut W) -> Fmt<W::Error> {
    write!(w, "{{\"version\":1,\"run\":")?;
    string(w, set.run)?;
    write!(w, ",\"frame\":{},\"timestamp_ns\":{},\"wall_ms\":{}", set.frame, set.timestamp_ns, set.wall_ms)?;
    write!(w, ",\"valid\":{},\"stale\":", set.valid)?;
    match set.stale {
        None => write!(w, "null")?,
        Some(stale) => {
            write!(w, "{{\"age_ms\":{},\"reason\":", stale.age_ms)?;
            string(w, stale.reason)?;
            write!(w, "}}")?;
        }
    }
    write!(w, ",\"sampler\":")?;
    string(w, set.sampler)?;
    write!(w, ",\"requested\":{},\"unit\":\"{}\"", set.requested, set.unit.name())?;
    write!(w, ",\"coordinates\":\"{}\",\"lights\":[", set.coordinates.name())?;
    for (i, one) in set.lights.iter().enumerate() {
        light(w, set, one, i == 0)?;
    }
    write!(w, "]")?;
    if let Some(sh) = set.ambient_sh {
        harmonics(w, &set.coordinates.harmonics(sh))?;
    }
    triple(w, ",\"scalar_flux\":", &set.scalar_flux)?;
    triple(w, ",\"horizontal_irradiance\":", &set.horizontal_irradiance)?;
    write!(w, ",\"clipped\":{},\"unseen\":{}", number(set.clipped), number(set.unseen))?;
    match set.estimated_error {
        None => write!(w, ",\"estimated_error\":null")?,
        Some(e) => write!(w, ",\"estimated_error\":{}", number(e))?,
    }
    let l = &set.latency;
    write!(w, ",\"latency_us\":{{\"capture\":{},\"front\":{},\"pyramid\":{}", l.capture, l.front, l.pyramid)?;
    write!(
        w,
        ",\"sample\":{},\"filter\":{},\"encode\":{},\"total\":{}}}}}",
        l.sample, l.filter, l.encode, l.total
    )
}

fn light<W: Write>(w: &mut W, set: &LightSet<'_>, light: &Light, first: bool) -> Fmt<W::Error> {
    let comma = if first { "" } else { "," };
    write!(w, "{comma}{{\"id\":{}", light.id)?;
    triple(w, ",\"direction\":", &set.coordinates.direction(light.direction).to_array())?;
    triple(w, ",\"irradiance\":", &light.irradiance)?;
    write!(w, ",\"radius_deg\":{},\"age\":{},\"parent\":", number(light.radius_deg), light.age)?;
    match light.parent {
        None => write!(w, "null}}"),
        Some(id) => write!(w, "{id}}}"),
    }
}

fn harmonics<W: Write>(w: &mut W, sh: &Sh9) -> Fmt<W::Error> {
    for (i, row) in sh.iter().enumerate() {
        triple(w, if i == 0 { ",\"ambient_sh\":[" } else { "," }, row)?;
    }
    write!(w, "]")
}

fn triple<W: Write>(w: &mut W, key: &str, values: &[f32; 3]) -> Fmt<W::Error> {
    write!(w, "{key}[")?;
    numbers(w, values, ",")?;
    write!(w, "]")
}

/// A quoted string with what JSON forbids in one escaped.
fn string<W: Write>(w: &mut W, s: &str) -> Fmt<W::Error> {
    write!(w, "\"")?;
    for c in s.chars() {
        match c {
            '"' | '\\' => write!(w, "\\{c}")?,
            c if u32::from(c) < 0x20 => write!(w, "\\u{:04x}", u32::from(c))?,
            c => write!(w, "{c}")?,
        }
    }
    write!(w, "\"")
}
