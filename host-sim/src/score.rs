//! `hemilux-sim score`: reads a light set from a JSON file and scores it against an environment map.
//!
//! The file is untrusted: every error is one line that contains the path, the found and the expected value. Unknown fields are ignored, since
//! later versions of the format may add fields.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::env::EnvMap;
use crate::metrics::vector::{norm, unit};
use crate::metrics::{Domain, Lit, LitSet, Reference, Score, sh};

/// Largest accepted size of a light set's file, bytes; a set of 4096 lights has about one megabyte.
const MAX_BYTES: u64 = 64 << 20;
/// Largest deviation from 1 of the length of a light's direction. Text with six decimals has an error of 2e-6; 1 % accepts files with two
/// decimals and refuses vectors that are not directions.
const LENGTH_TOLERANCE: f64 = 0.01;
/// Version of the light set's format.
const VERSION: u32 = 1;

/// Reasons for which a light set cannot be scored.
#[derive(Debug, thiserror::Error)]
pub enum ScoreError {
    /// The light set's file cannot be opened or read.
    #[error("{path}: found {source}, expected a light set that can be read")]
    Io {
        /// Path of the light set's file.
        path: PathBuf,
        /// Error that the operating system returned.
        source: std::io::Error,
    },
    /// The file does not contain a valid light set.
    #[error("{path}: found {found}, expected {expected}")]
    Set {
        /// Path of the light set's file.
        path: PathBuf,
        /// The value that was found in the file, in words.
        found: String,
        /// The value that was expected, in words.
        expected: &'static str,
    },
}

/// The found and the expected value of a refused light set, in words.
type SetRefusal = (String, &'static str);

/// Scores the light set of the file `set` against `map` and returns the score as one line of JSON (see [`to_json`]).
///
/// # Errors
/// [`ScoreError`] if the set cannot be read or is invalid.
pub fn score_command(map: &EnvMap, set: &Path, domain: Domain) -> Result<String, ScoreError> {
    let lights = read_set(set)?;
    Ok(to_json(&Reference::new(map, domain).score(&lights)))
}

/// Reads a light set and converts it to probe axes.
///
/// # Errors
/// [`ScoreError`] if the file cannot be read or does not contain a valid light set.
pub fn read_set(path: &Path) -> Result<LitSet, ScoreError> {
    let io = |source| ScoreError::Io { path: path.into(), source };
    let bytes = std::fs::metadata(path).map_err(io)?.len();
    let refuse = |(found, expected)| ScoreError::Set { path: path.into(), found, expected };
    if bytes > MAX_BYTES {
        return Err(refuse((format!("{bytes} bytes"), "a light set of at most 64 MiB")));
    }
    parse_set(&std::fs::read(path).map_err(io)?).map_err(refuse)
}

/// Returns a score as one line of JSON, `{"open":…,"shadowed":…,"energy":…,"soft_open":…,"soft_shadowed":…}`; infinite ratios are null.
#[must_use]
pub fn to_json(score: &Score) -> String {
    let number = |v: f64| if v.is_finite() { serde_json::Value::from(v) } else { serde_json::Value::Null };
    let [open, shadowed, energy] = [score.open, score.shadowed, score.energy].map(number);
    let [soft_open, soft_shadowed] = [score.soft_open, score.soft_shadowed].map(number);
    format!(
        r#"{{"open":{open},"shadowed":{shadowed},"energy":{energy},"soft_open":{soft_open},"soft_shadowed":{soft_shadowed}}}"#
    )
}

/// Coordinate axes of the directions in a light set's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axes {
    Probe,
    YUp,
    Unity,
    Unreal,
}

impl Axes {
    /// Returns the axes with the name `name`, which may be the name of a program.
    fn named(name: &str) -> Result<Self, SetRefusal> {
        match name {
            "probe" | "blender" | "ros" => Ok(Self::Probe),
            "y-up" | "gltf" | "three" | "webxr" => Ok(Self::YUp),
            "unity" => Ok(Self::Unity),
            "unreal" => Ok(Self::Unreal),
            other => Err((
                format!("coordinates {}", shortened(&format!("{other:?}"))),
                "probe, y-up, gltf, three, webxr, unity, unreal, blender or ros",
            )),
        }
    }

    /// Converts a vector from probe axes to the axes `self`.
    fn turned(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Probe => [x, y, z],
            Self::YUp => [x, z, -y],
            Self::Unity => [x, z, y],
            Self::Unreal => [x, -y, z],
        }
    }

    /// Converts a vector from the axes `self` to probe axes.
    fn turned_back(self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Probe => [a, b, c],
            Self::YUp => [a, -c, b],
            Self::Unity => [a, c, b],
            Self::Unreal => [a, -b, c],
        }
    }
}

#[derive(Deserialize)]
struct SetJson {
    version: u32,
    #[serde(default = "probe_axes")]
    coordinates: String,
    lights: Vec<LightJson>,
    #[serde(default)]
    ambient_sh: Option<[[f64; 3]; 9]>,
}

#[derive(Deserialize)]
struct LightJson {
    id: u32,
    direction: [f64; 3],
    irradiance: [f64; 3],
    #[serde(default)]
    radius_deg: f64,
}

fn probe_axes() -> String {
    "probe".into()
}

fn parse_set(bytes: &[u8]) -> Result<LitSet, SetRefusal> {
    let set: SetJson = serde_json::from_slice(bytes)
        .map_err(|e| (shortened(&e.to_string()), "one light set in JSON, version 1"))?;
    if set.version != VERSION {
        return Err((format!("version {}", set.version), "version 1"));
    }
    let axes = Axes::named(&set.coordinates)?;
    let lights = set.lights.iter().map(|light| to_lit(light, axes)).collect::<Result<_, _>>()?;
    let ambient_sh = set.ambient_sh.map(|rows| sh::change_axes(&rows, |d| axes.turned(d)));
    Ok(LitSet { lights, ambient_sh })
}

fn to_lit(light: &LightJson, axes: Axes) -> Result<Lit, SetRefusal> {
    let length = norm(light.direction);
    let direction =
        unit(light.direction).filter(|_| (length - 1.0).abs() <= LENGTH_TOLERANCE).ok_or_else(|| {
            (format!("light {} with a direction of length {length}", light.id), "a unit vector")
        })?;
    if let Some(negative) = light.irradiance.iter().find(|&&v| v < 0.0) {
        return Err((format!("light {} with irradiance {negative}", light.id), "values of at least 0"));
    }
    if !(0.0..=180.0).contains(&light.radius_deg) {
        let found = format!("light {} with radius_deg {}", light.id, light.radius_deg);
        return Err((found, "0 to 180 degrees"));
    }
    Ok(Lit {
        direction: axes.turned_back(direction),
        irradiance: light.irradiance,
        radius_deg: light.radius_deg.min(90.0),
        id: light.id,
    })
}

/// Returns `text` as one line of at most 160 characters.
fn shortened(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(160).collect();
    if line.chars().count() < text.chars().count() { line + "…" } else { line }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::vector::angle_deg;

    fn set(coordinates: &str, direction: &str, ambient: &str) -> String {
        format!(
            r#"{{"version": 1, "run": "k3v9", "valid": true, "stale": null, "coordinates": "{coordinates}",
            "lights": [{{"id": 17, "direction": {direction}, "irradiance": [1, 2, 3], "age": 12}}],
            "ambient_sh": {ambient}, "scalar_flux": [1, 2, 3]}}"#
        )
    }

    fn parsed(text: &str) -> Result<LitSet, SetRefusal> {
        parse_set(text.as_bytes())
    }

    #[test]
    fn directions_in_all_axes_are_converted_to_probe_axes() {
        // The probe directions (0.6, 0, 0.8) and (0, 0.6, 0.8) were converted by hand to each coordinate system.
        for (names, first, second) in [
            (&["probe", "blender", "ros"][..], "[0.6, 0, 0.8]", "[0, 0.6, 0.8]"),
            (&["y-up", "gltf", "three", "webxr"], "[0.6, 0.8, 0]", "[0, 0.8, -0.6]"),
            (&["unity"], "[0.6, 0.8, 0]", "[0, 0.8, 0.6]"),
            (&["unreal"], "[0.6, 0, 0.8]", "[0, -0.6, 0.8]"),
        ] {
            for name in names {
                for (text, expected) in [(first, [0.6, 0.0, 0.8]), (second, [0.0, 0.6, 0.8])] {
                    let light = parsed(&set(name, text, "null")).unwrap().lights[0];
                    assert!(angle_deg(light.direction, expected) < 1e-9, "{name}: {light:?}");
                    assert_eq!((light.irradiance, light.id), ([1.0, 2.0, 3.0], 17));
                }
            }
        }
    }

    #[test]
    fn ambient_coefficients_are_converted_with_the_axes() {
        // Radiance 1 + z in probe axes: c00 = 2 sqrt(pi) and c10 = sqrt(4 pi / 3). Probe z is y in y-up axes, so there the second
        // coefficient is in row (1,-1).
        let row = |v: f64| format!("[{v}, {v}, {v}]");
        let (c0, c1) = (3.544907701811032, 2.046653415892977);
        let zero = row(0.0);
        let mut rows = vec![zero.clone(); 9];
        rows[0] = row(c0);
        rows[1] = row(c1);
        let y_up = parsed(&set("y-up", "[0, 1, 0]", &format!("[{}]", rows.join(",")))).unwrap();
        let sh = y_up.ambient_sh.unwrap();
        for (i, row) in sh.iter().enumerate() {
            let expected = [c0, 0.0, c1].get(i).copied().unwrap_or(0.0);
            assert!((row[0] - expected).abs() < 1e-12, "row {i}: {row:?}");
        }
    }

    #[test]
    fn hostile_files_are_refused_in_one_line() {
        let direction = |text| set("probe", text, "null");
        for (text, part) in [
            (String::new(), "EOF"),
            ("[]".into(), "line 1"),
            ("{}".into(), "missing field"),
            (r#"{"version": 2, "lights": []}"#.into(), "version 2"),
            (r#"{"version": 1}"#.into(), "lights"),
            (r#"{"version": 1, "lights": []} {}"#.into(), "trailing"),
            (direction("[0, 0, 0]"), "length 0"),
            (direction("[0, 0, 2]"), "length 2"),
            (direction("[0, 1]"), "invalid length"),
            (direction("[0, 0, 1e999]"), "number out of range"),
            (direction("[0, 0, \"up\"]"), "up"),
            (direction("[0, 0, 1e300]"), "length"),
            (set("maya\\u000a", "[0, 0, 1]", "null"), "maya"),
            (set(&"x".repeat(9999), "[0, 0, 1]", "null"), "xxx"),
            (set("probe", "[0, 0, 1]", "[[1, 1, 1]]"), "invalid length 1"),
            (direction("[0, 0, 1]").replace("17", "-1"), "-1"),
            (direction("[0, 0, 1]").replace("[1, 2, 3], \"age", "[1, -2, 3], \"age"), "irradiance -2"),
            (format!(r#"{{"later": {}"#, "[".repeat(100_000)), "EOF"),
        ] {
            let (found, expected) = parsed(&text).expect_err("a hostile set was read");
            assert!(found.contains(part), "{found} does not contain {part}");
            assert!(found.len() < 300 && !found.contains('\n') && !expected.is_empty(), "{found}");
        }
    }

    #[test]
    fn command_scores_a_perfect_set_and_names_unreadable_files() {
        let folder = tempfile::tempdir().unwrap();
        let (env, json) = (folder.path().join("env.exr"), folder.path().join("set.json"));
        // One bright texel of a 64 x 32 map; the light is its direction and radiance times solid angle.
        exr::prelude::write_rgb_file(&env, 64, 32, |x, y| {
            if (x, y) == (20, 7) { (100.0f32, 50.0, 25.0) } else { (0.0, 0.0, 0.0) }
        })
        .unwrap();
        let blank = EnvMap::new(64, 32, vec![[0.0; 3]; 64 * 32]);
        let (d, sr) = (blank.direction(7, 20), blank.solid_angle(7));
        let text = format!(
            r#"{{"version": 1, "lights": [{{"id": 1, "direction": {d:?}, "irradiance": [{}, {}, {}]}}]}}"#,
            100.0 * sr,
            50.0 * sr,
            25.0 * sr
        );
        std::fs::write(&json, text).unwrap();
        let map = EnvMap::read(&env).unwrap();
        for domain in [Domain::Sphere, Domain::Hemisphere] {
            let line = score_command(&map, &json, domain).unwrap();
            let score: serde_json::Value = serde_json::from_str(&line).unwrap();
            for key in ["open", "shadowed", "energy"] {
                assert!(score[key].as_f64().unwrap() < 1e-12, "{line}");
            }
        }
        let missing =
            score_command(&map, &folder.path().join("none.json"), Domain::Sphere).unwrap_err().to_string();
        assert!(missing.contains("none.json") && !missing.contains('\n'), "{missing}");
        let swapped = score_command(&map, &env, Domain::Sphere).unwrap_err().to_string();
        assert!(
            swapped.contains("env.exr: found ") && swapped.contains("expected one light set"),
            "{swapped}"
        );
        assert!(
            EnvMap::read(&json).unwrap_err().to_string().contains("set.json: found"),
            "a JSON file is refused as a map"
        );
    }

    #[test]
    fn infinite_scores_are_null() {
        let score = Score {
            open: f64::INFINITY,
            shadowed: 0.5,
            energy: 0.0,
            soft_open: 0.25,
            soft_shadowed: f64::INFINITY,
        };
        assert_eq!(
            to_json(&score),
            r#"{"open":null,"shadowed":0.5,"energy":0.0,"soft_open":0.25,"soft_shadowed":null}"#
        );
    }
}
