//! The JSON form of a light set.

use super::{Degraded, FramesLeftOut, Latency, LightSet, decimal, numbers, put, whole};
use crate::light::{Light, Sh9};
use crate::mains::Flicker;
use embedded_io::Write;

/// Writes `set` as one JSON object without line breaks.
///
/// ```
/// use hemilux_core::wire::{LightSet, json};
///
/// let mut bytes = [0; 1024];
/// let mut rest = &mut bytes[..];
/// json(&LightSet { run: "8c1f", frame: 5, ..LightSet::EMPTY }, &mut rest)?;
/// let used = 1024 - rest.len();
/// let text = std::str::from_utf8(&bytes[..used])?;
/// assert!(text.starts_with(r#"{"version":1,"run":"8c1f","frame":5,"#));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Errors of the writer `w`, such as a full buffer.
pub fn json<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), W::Error> {
    put(w, "{\"version\":1,\"run\":")?;
    string(w, set.run)?;
    count(w, ",\"frame\":", set.frame)?;
    count(w, ",\"timestamp_ns\":", set.timestamp_ns)?;
    count(w, ",\"wall_ms\":", set.wall_ms)?;
    put(w, if set.valid { ",\"valid\":true,\"stale\":" } else { ",\"valid\":false,\"stale\":" })?;
    match set.stale {
        None => put(w, "null")?,
        Some(stale) => {
            count(w, "{\"age_ms\":", stale.age_ms)?;
            put(w, ",\"reason\":")?;
            string(w, stale.reason)?;
            put(w, "}")?;
        }
    }
    put(w, ",\"sampler\":")?;
    string(w, set.sampler)?;
    count(w, ",\"requested\":", set.requested.into())?;
    put(w, ",\"unit\":\"")?;
    put(w, set.unit.name())?;
    if let Some(uncertainty) = set.unit_uncertainty {
        put(w, "\",\"unit_uncertainty\":")?;
        decimal(w, uncertainty)?;
        put(w, ",\"coordinates\":\"")?;
    } else {
        put(w, "\",\"coordinates\":\"")?;
    }
    for part in [set.coordinates.name(), "\",\"lights\":["] {
        put(w, part)?;
    }
    for (i, one) in set.lights.iter().enumerate() {
        light(w, set, one, i == 0)?;
    }
    put(w, "]")?;
    if let Some(sh) = set.ambient_sh {
        harmonics(w, &set.coordinates.harmonics(sh))?;
    }
    if let Some(left_out) = &set.left_out {
        triple(w, ",\"left_out\":", left_out)?;
    }
    triple(w, ",\"scalar_flux\":", &set.scalar_flux)?;
    triple(w, ",\"horizontal_irradiance\":", &set.horizontal_irradiance)?;
    put(w, ",\"clipped\":")?;
    decimal(w, set.clipped)?;
    if set.clipped > 0.0 {
        triple(w, ",\"clipped_irradiance_at_least\":", &set.clipped_irradiance_at_least)?;
    }
    put(w, ",\"unseen\":")?;
    decimal(w, set.unseen)?;
    put(w, ",\"estimated_error\":")?;
    match set.estimated_error {
        None => put(w, "null")?,
        Some(e) => decimal(w, e)?,
    }
    for (i, (name, us)) in Latency::NAMES.iter().zip(set.latency.all()).enumerate() {
        put(w, if i == 0 { ",\"latency_us\":{\"" } else { ",\"" })?;
        put(w, name)?;
        count(w, "\":", us.into())?;
    }
    put(w, "},\"overrun\":[")?;
    for (i, name) in set.overrun.names().enumerate() {
        put(w, if i == 0 { "\"" } else { ",\"" })?;
        put(w, name)?;
        put(w, "\"")?;
    }
    put(w, "]")?;
    frames_left_out(w, &set.frames_left_out)?;
    degraded(w, &set.degraded)?;
    flicker(w, &set.flicker)?;
    put(w, "}")
}

/// Writes the member `degraded` unless there are no reductions.
fn degraded<W: Write>(w: &mut W, steps: &Degraded) -> Result<(), W::Error> {
    if steps.is_none() {
        return Ok(());
    }
    for (i, name) in steps.names().enumerate() {
        put(w, if i == 0 { ",\"degraded\":[\"" } else { "\",\"" })?;
        put(w, name)?;
    }
    put(w, "\"]")
}

/// Writes the member `frames_left_out` unless all frames were merged.
fn frames_left_out<W: Write>(w: &mut W, frames: &FramesLeftOut) -> Result<(), W::Error> {
    if frames.is_empty() {
        return Ok(());
    }
    for (i, frame) in frames.iter().enumerate() {
        count(
            w,
            if i == 0 { ",\"frames_left_out\":[{\"index\":" } else { ",{\"index\":" },
            frame.index as u64,
        )?;
        put(w, ",\"why\":\"")?;
        put(w, frame.fault.name())?;
        put(w, "\"}")?;
    }
    put(w, "]")
}

/// Writes the member `mains` unless no modulation was removed.
fn flicker<W: Write>(w: &mut W, flicker: &Flicker) -> Result<(), W::Error> {
    if *flicker == Flicker::NONE {
        return Ok(());
    }
    put(w, ",\"mains\":{\"frequency_hz\":")?;
    match flicker.frequency_hz {
        None => put(w, "null")?,
        Some(hz) => decimal(w, hz)?,
    }
    put(w, ",\"depth\":")?;
    decimal(w, flicker.depth)?;
    put(w, ",\"share\":")?;
    decimal(w, flicker.share)?;
    put(w, "}")
}

fn light<W: Write>(w: &mut W, set: &LightSet<'_>, light: &Light, first: bool) -> Result<(), W::Error> {
    count(w, if first { "{\"id\":" } else { ",{\"id\":" }, light.id.into())?;
    triple(w, ",\"direction\":", &set.coordinates.direction(light.direction).to_array())?;
    triple(w, ",\"irradiance\":", &light.irradiance)?;
    put(w, ",\"radius_deg\":")?;
    decimal(w, light.radius_deg)?;
    count(w, ",\"age\":", light.age.into())?;
    put(w, ",\"parent\":")?;
    match light.parent {
        None => put(w, "null}"),
        Some(id) => {
            whole(w, id.into())?;
            put(w, "}")
        }
    }
}

fn harmonics<W: Write>(w: &mut W, sh: &Sh9) -> Result<(), W::Error> {
    for (i, row) in sh.iter().enumerate() {
        triple(w, if i == 0 { ",\"ambient_sh\":[" } else { "," }, row)?;
    }
    put(w, "]")
}

/// Writes `key` and an array of three numbers.
fn triple<W: Write>(w: &mut W, key: &str, values: &[f32; 3]) -> Result<(), W::Error> {
    put(w, key)?;
    put(w, "[")?;
    numbers(w, values, ",")?;
    put(w, "]")
}

/// Writes `key` and an integer.
fn count<W: Write>(w: &mut W, key: &str, n: u64) -> Result<(), W::Error> {
    put(w, key)?;
    whole(w, n)
}

/// Writes the quoted string `s` with escaped quotes, backslashes and control characters.
fn string<W: Write>(w: &mut W, s: &str) -> Result<(), W::Error> {
    put(w, "\"")?;
    for b in s.bytes() {
        match b {
            b'"' | b'\\' => w.write_all(&[b'\\', b])?,
            b if b < 0x20 => {
                let hex = |digit: u8| if digit < 10 { b'0' + digit } else { b'a' + digit - 10 };
                put(w, "\\u00")?;
                w.write_all(&[hex(b >> 4), hex(b & 15)])?;
            }
            b => w.write_all(&[b])?,
        }
    }
    put(w, "\"")
}
