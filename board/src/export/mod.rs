//! Light sets as files of other programs: CSV, glTF, USD, Radiance and Mitsuba scenes and Blender scripts, in addition to the forms of
//! [`hemilux_core::wire`].
//!
//! Each file begins with comments that state the set's origin, its axes and unit, and the values that the form cannot contain. In glTF, whose
//! JSON has no comments, the statements are in `asset.extras.notes`.

mod blender;
mod csv;
mod glb;
mod mitsuba;
mod radiance;
mod usda;

use hemilux_core::light::Light;
use hemilux_core::wire::{self, Coordinates, LightSet, Unit};
use std::fmt::{self, Display, Write};

/// A file form in which a light set can be exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Form {
    /// JSON with all values of a set.
    Json,
    /// Plain text with one light per line.
    Text,
    /// XML with one element per light.
    Xml,
    /// Comma-separated values, one light per line.
    Csv,
    /// Binary glTF 2.0 with directional lights of the extension KHR_lights_punctual.
    Glb,
    /// USD in its text form: DistantLights, and a DomeLight with the map.
    Usda,
    /// A Radiance scene description with one source per light.
    Radiance,
    /// A Mitsuba 3 scene with one directional emitter per light.
    Mitsuba,
    /// A Python script for Blender that makes one sun per light.
    Blender,
}

/// Reasons why a light set cannot be written in a form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// The form cannot state the requested coordinate axes.
    #[error("coordinates {found} with format {form}: expected {expected}")]
    Axes {
        /// Name of the export form that does not support the axes.
        form: &'static str,
        /// Name of the axes that were requested.
        found: &'static str,
        /// Names of the axes that the form can state.
        expected: &'static str,
    },
    /// The file would be longer than the form allows.
    #[error("a set of {0} lights: expected fewer for this format")]
    TooLarge(usize),
}

impl Form {
    /// All export forms with their names.
    pub const NAMED: [(&'static str, Self); 9] = [
        ("json", Self::Json),
        ("text", Self::Text),
        ("xml", Self::Xml),
        ("csv", Self::Csv),
        ("glb", Self::Glb),
        ("usda", Self::Usda),
        ("rad", Self::Radiance),
        ("mitsuba", Self::Mitsuba),
        ("blender", Self::Blender),
    ];

    /// Returns the export form called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(n, _)| *n == name).map(|(_, form)| *form)
    }

    /// Returns the name of the export form.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(_, form)| *form == self).map_or("", |(name, _)| *name)
    }

    /// Returns the media type of files in this form.
    #[must_use]
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::Text => "text/plain; charset=utf-8",
            Self::Xml | Self::Mitsuba => "application/xml",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Glb => "model/gltf-binary",
            Self::Usda => "model/vnd.usda",
            Self::Radiance => "text/plain; charset=us-ascii",
            Self::Blender => "text/x-python; charset=utf-8",
        }
    }

    /// Returns true if a file in this form contains exactly one light set, so that sets cannot be concatenated.
    #[must_use]
    pub const fn is_scene(self) -> bool {
        matches!(self, Self::Glb | Self::Usda | Self::Radiance | Self::Mitsuba | Self::Blender)
    }

    /// Returns the default axes of the form: those of the program that reads it.
    #[must_use]
    pub const fn native_axes(self) -> Coordinates {
        match self {
            Self::Glb | Self::Usda | Self::Mitsuba => Coordinates::YUp,
            Self::Json | Self::Text | Self::Xml | Self::Csv | Self::Radiance | Self::Blender => {
                Coordinates::Probe
            }
        }
    }

    /// Returns `axes`, or the default axes of the form for `None`.
    ///
    /// # Errors
    /// [`ExportError::Axes`]: scenes are right-handed, and glTF is always +Y up.
    pub fn axes(self, axes: Option<Coordinates>) -> Result<Coordinates, ExportError> {
        let axes = axes.unwrap_or(self.native_axes());
        let expected = match (self, axes) {
            (Self::Glb, Coordinates::YUp) => return Ok(axes),
            (Self::Glb, _) => "y-up, the axes of every glTF file",
            (Self::Blender, Coordinates::Probe) => return Ok(axes),
            (Self::Blender, _) => "probe, +Z up as Blender has it",
            (_, Coordinates::Probe | Coordinates::YUp) => return Ok(axes),
            (form, _) if !form.is_scene() => return Ok(axes),
            _ => "probe or y-up, which are right-handed",
        };
        Err(ExportError::Axes { form: self.name(), found: axes.name(), expected })
    }
}

/// Notes about the values of a light set that plain text and XML do not contain.
const PLAIN: [&str; 1] =
    ["left out: radius, age and parent of each light, the set's sums and estimated error; JSON has them"];

/// Appends `set` in the axes of `set.coordinates` to `bytes`.
///
/// `map` is the path of a latitude-longitude map of the same scene, relative to the file; USD alone refers to it.
///
/// # Errors
/// [`ExportError`] for axes or sizes that the form cannot contain; nothing is appended.
pub fn encode(
    form: Form,
    set: &LightSet<'_>,
    map: Option<&str>,
    bytes: &mut Vec<u8>,
) -> Result<(), ExportError> {
    form.axes(Some(set.coordinates))?;
    let text = match form {
        Form::Glb => return glb::write(set, bytes),
        Form::Json => {
            let Ok(()) = wire::json(set, bytes);
            return Ok(());
        }
        Form::Text => {
            let comments: String = notes(set, &PLAIN).iter().map(|note| format!("# {note}\n")).collect();
            bytes.extend_from_slice(comments.as_bytes());
            let Ok(()) = wire::text(set, bytes);
            return Ok(());
        }
        Form::Xml => {
            let comments: String = notes(set, &PLAIN).iter().map(|note| xml_comment(note) + "\n").collect();
            bytes.extend_from_slice(comments.as_bytes());
            let Ok(()) = wire::xml(set, bytes);
            return Ok(());
        }
        Form::Csv => csv::text(set),
        Form::Usda => usda::text(set, map),
        Form::Radiance => radiance::text(set),
        Form::Mitsuba => mitsuba::text(set),
        Form::Blender => blender::text(set),
    };
    bytes.extend_from_slice(text.as_bytes());
    Ok(())
}

/// The text of an exported file, built line by line.
#[derive(Default)]
struct Text(String);

impl Text {
    /// Appends `line` to the text. Writing to a string cannot fail.
    fn line(&mut self, line: impl Display) {
        let _ = writeln!(self.0, "{line}");
    }
}

/// Luminous efficacy between lux and the W/m2 of Radiance and Blender, lm/W.
const EFFICACY: f32 = 179.0;

/// Writes the comments at the start of a form in watts; if the set is in lux, the sentence `conversion` is added. Returns the factor from
/// the set's unit to watts.
fn head_in_watts(text: &mut Text, set: &LightSet<'_>, losses: &[&str], conversion: &str) -> f32 {
    for note in notes(set, losses) {
        text.line(format_args!("# {note}"));
    }
    match set.unit {
        Unit::Lux => {
            text.line(format_args!("# {conversion} / {EFFICACY} lm/W"));
            EFFICACY.recip()
        }
        Unit::Relative => 1.0,
    }
}

/// Formats an array of numbers with a separator between them. A number that is not finite is written as 0.
struct Numbers<'a, const N: usize>([f32; N], &'a str);

impl<const N: usize> Display for Numbers<'_, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, v) in self.0.iter().enumerate() {
            write!(f, "{}{}", if i == 0 { "" } else { self.1 }, if v.is_finite() { *v } else { 0.0 })?;
        }
        Ok(())
    }
}

/// An irradiance as the product of a colour and an intensity.
struct Emission {
    intensity: f32,
    /// Linear red, green and blue of the emission, of which the largest is 1.
    colour: [f32; 3],
}

/// Returns the colour and the intensity whose product is `irradiance`.
fn emission(irradiance: [f32; 3]) -> Emission {
    let [r, g, b] = irradiance.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
    let intensity = r.max(g).max(b);
    let colour = if intensity > 0.0 { [r, g, b].map(|v| v / intensity) } else { [1.0; 3] };
    Emission { intensity, colour }
}

/// Returns the rotation (x, y, z, w) of a lamp that emits along its -Z axis, such that its light comes from the direction of `light`.
fn orientation(set: &LightSet<'_>, light: &Light) -> [f32; 4] {
    let towards = set.coordinates.direction(light.direction).as_dvec3();
    let towards = towards.try_normalize().unwrap_or(glam::DVec3::Z);
    glam::DQuat::from_rotation_arc(glam::DVec3::NEG_Z, -towards).normalize().as_quat().to_array()
}

/// Returns the ratio of the irradiance that a surface facing a uniform disc of angular radius `radius_deg` receives to the disc's scalar
/// flux.
fn facing(radius_deg: f32) -> f32 {
    (1.0 + radius_deg.clamp(0.0, 90.0).to_radians().cos()) / 2.0
}

/// Returns the comments at the start of a file: the set, its axes and unit, the energy that is left out, and the notes `losses`.
fn notes(set: &LightSet<'_>, losses: &[&str]) -> Vec<String> {
    let LightSet { run, frame, sampler, .. } = set;
    let count = set.lights.len();
    let mut notes =
        vec![format!("hemilux light set: run {run}, frame {frame}, sampler {sampler}, {count} lights")];
    notes.push(format!("axes: {}", set.coordinates.name()));
    notes.push(match set.unit {
        Unit::Lux => "unit: lux".into(),
        Unit::Relative => "unit: relative, lux times an unknown factor".to_string(),
    });
    if let Some(stale) = set.stale {
        notes.push(format!("stale: {} ms: {}", stale.age_ms, stale.reason));
    }
    if let Some(sh) = set.ambient_sh {
        // Over the sphere, constant radiance with the harmonic coefficient c has the flux 2 sqrt(pi) c.
        let flux = sh[0].map(|c| 2.0 * std::f32::consts::PI.sqrt() * c);
        notes.push(format!("left out: the ambient light, scalar flux {}; JSON has it", Numbers(flux, " ")));
    }
    notes.extend(losses.iter().map(|loss| (*loss).to_string()));
    notes.into_iter().map(|note| on_one_line(&note)).collect()
}

/// Returns `text` with spaces in place of control characters, which could end a comment line, and of characters that XML forbids.
fn on_one_line(text: &str) -> String {
    let is_kept = |c: char| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}');
    text.chars().map(|c| if is_kept(c) { c } else { ' ' }).collect()
}

/// Returns `note` as a comment of XML, in which two successive hyphens are forbidden.
fn xml_comment(note: &str) -> String {
    format!("<!-- {} -->", note.replace("--", "- ").trim_end_matches('-'))
}
