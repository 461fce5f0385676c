//! The table of settings: what each is called, may be, and means. The requests, the configuration file and the schema read it.

use super::config::{Change, Config, EXTRAPOLATIONS, extrapolation_name};
use crate::samplers::{MAX_LIGHTS, NAMES, SamplerError, TOLERANCES, least_lights};
use hemilux_core::healpix::Domain;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// What a setting's value may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A whole number from the first to the second.
    Whole(u64, u64),
    /// A number from the first to the second, or null for none.
    Real(f32, f32),
    /// On or off.
    Switch,
}

/// One setting.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Its name in `/v1/config` and in the configuration file.
    pub name: &'static str,
    /// Its name in `change`, by the thesis.
    pub parameter: &'static str,
    /// What it may be.
    pub kind: Kind,
    /// Unit of a number.
    pub unit: Option<&'static str>,
    /// What it does, one sentence.
    pub what: &'static str,
    value: fn(&Config) -> Value,
    /// Puts an admitted value into a wish.
    wish: fn(&mut Change, &Value),
}

const EXTRAPOLATION_NAMES: [&str; EXTRAPOLATIONS.len()] = [EXTRAPOLATIONS[0].0, EXTRAPOLATIONS[1].0];

/// All settings.
pub const SETTINGS: [Setting; 6] = [
    Setting {
        name: "sampler",
        parameter: "algorithm",
        kind: Kind::Choice(&NAMES),
        unit: None,
        what: "How the map becomes lights.",
        value: |c| json!(c.pipeline.sampler),
        wish: |c, v| c.sampler = v.as_str().map(Into::into),
    },
    Setting {
        name: "lights",
        parameter: "samples",
        kind: Kind::Whole(0, MAX_LIGHTS as u64),
        unit: Some("lights"),
        what: "Most lights of a set; each sampler has a least number, and adaptive with ambient light may do without any.",
        value: |c| json!(c.pipeline.lights),
        wish: |c, v| c.lights = v.as_u64().and_then(|n| usize::try_from(n).ok()),
    },
    Setting {
        name: "tolerance",
        parameter: "tolerance",
        kind: Kind::Real(*TOLERANCES.start(), *TOLERANCES.end()),
        unit: Some("ratio"),
        what: "The fewest lights are given whose shadowed error is at most this; adaptive alone. Without it, as many as lights says.",
        value: |c| c.pipeline.tolerance.map_or(Value::Null, |t| json!(shortest(t))),
        wish: |c, v| c.tolerance = Some(v.as_f64().map(|t| t as f32)),
    },
    Setting {
        name: "ambient",
        parameter: "ambient",
        kind: Kind::Switch,
        unit: None,
        what: "Whether what has no direction becomes spherical harmonics in the place of lights; adaptive alone.",
        value: |c| json!(c.pipeline.ambient),
        wish: |c, v| c.ambient = v.as_bool(),
    },
    Setting {
        name: "extrapolation",
        parameter: "extrapolation",
        kind: Kind::Choice(&EXTRAPOLATION_NAMES),
        unit: None,
        what: "What stands for the part of the hemisphere that the lens does not see: darkness, or the average of what it sees.",
        value: |c| json!(extrapolation_name(c.pipeline.extrapolation)),
        wish: |c, v| {
            c.extrapolation =
                EXTRAPOLATIONS.iter().find(|(name, _)| v.as_str() == Some(*name)).map(|(_, e)| *e);
        },
    },
    Setting {
        name: "gui",
        parameter: "gui",
        kind: Kind::Switch,
        unit: None,
        what: "Whether screenshot may draw its debug picture, which costs a copy of the map each time.",
        value: |c| json!(c.gui),
        wish: |c, v| c.gui = v.as_bool(),
    },
];

impl Setting {
    /// Its value in `config`.
    #[must_use]
    pub fn value(&self, config: &Config) -> Value {
        (self.value)(config)
    }

    /// Reads a word of a query.
    #[must_use]
    pub fn parse(&self, word: &str) -> Option<Value> {
        let value = match self.kind {
            Kind::Choice(_) => json!(word),
            Kind::Whole(..) => json!(word.parse::<u64>().ok()?),
            Kind::Real(..) if word == "off" => Value::Null,
            Kind::Real(..) => json!(word.parse::<f64>().ok()?),
            Kind::Switch => json!(match word {
                "on" => true,
                "off" => false,
                _ => return None,
            }),
        };
        self.admits(&value).then_some(value)
    }

    /// Puts `value` into a wish.
    ///
    /// # Errors
    /// What was expected.
    pub fn wish(&self, change: &mut Change, value: &Value) -> Result<(), String> {
        if !self.admits(value) {
            return Err(self.expected());
        }
        (self.wish)(change, value);
        Ok(())
    }

    fn admits(&self, value: &Value) -> bool {
        match self.kind {
            Kind::Choice(words) => value.as_str().is_some_and(|v| words.contains(&v)),
            Kind::Whole(least, most) => value.as_u64().is_some_and(|v| (least..=most).contains(&v)),
            Kind::Real(least, most) => {
                value.is_null() || value.as_f64().is_some_and(|v| (least..=most).contains(&(v as f32)))
            }
            Kind::Switch => value.is_boolean(),
        }
    }

    /// What it may be, in words.
    #[must_use]
    pub fn expected(&self) -> String {
        match self.kind {
            Kind::Choice(words) => format!("one of {}", words.join(", ")),
            Kind::Whole(least, most) => format!("a whole number from {least} to {most}"),
            Kind::Real(least, most) => format!("a number from {least} to {most}, or null"),
            Kind::Switch => "true or false".into(),
        }
    }

    /// What it may be and means, for programs; `least` and `most` are those of the sampler in use where that matters.
    #[must_use]
    pub fn schema(&self, config: &Config) -> Value {
        let mut schema = match self.kind {
            Kind::Choice(words) => json!({"type": "string", "enum": words}),
            Kind::Whole(least, most) => {
                let own = || least_lights(&config.pipeline.sampler, Domain::Hemisphere).map(|n| n as u64);
                let is_own = self.name == "lights" && !config.pipeline.ambient;
                let least = is_own.then(own).flatten().unwrap_or(least);
                json!({"type": "integer", "minimum": least, "maximum": most})
            }
            Kind::Real(least, most) => {
                json!({"type": ["number", "null"], "minimum": shortest(least), "maximum": shortest(most)})
            }
            Kind::Switch => json!({"type": "boolean"}),
        };
        schema["unit"] = json!(self.unit);
        schema["description"] = json!(self.what);
        schema["value"] = self.value(config);
        schema
    }
}

/// The wish that a JSON object of settings makes.
///
/// # Errors
/// For each name that is wrong: what was found and what was expected.
pub fn wish_of(object: &Map<String, Value>) -> Result<Change, BTreeMap<String, String>> {
    let mut change = Change::default();
    let mut errors = BTreeMap::new();
    for (name, value) in object {
        let known = SETTINGS.iter().find(|s| s.name == name);
        let outcome = match known {
            Some(setting) => setting.wish(&mut change, value),
            None => Err(format!("one of {}", SETTINGS.map(|s| s.name).join(", "))),
        };
        if let Err(expected) = outcome {
            let found = if known.is_some() { value.to_string() } else { format!("'{name}'") };
            errors.insert(name.clone(), format!("found {}, expected {expected}", short(&found)));
        }
    }
    if errors.is_empty() { Ok(change) } else { Err(errors) }
}

/// The setting that is at fault when settings do not go together.
#[must_use]
pub fn at_fault(error: &SamplerError) -> &'static str {
    match error {
        SamplerError::BadLights { .. } => "lights",
        SamplerError::BadTolerance(_) => "tolerance",
        _ => "sampler",
    }
}

/// The number that a person would write for `v`: 0.03 and not 0.029999999329447746.
fn shortest(v: f32) -> f64 {
    v.to_string().parse().unwrap_or(v.into())
}

/// Longest part of somebody's text that is repeated, characters.
const ECHO: usize = 40;

/// Text of a client, short and on one line.
#[must_use]
pub fn short(text: &str) -> String {
    text.chars().take(ECHO).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_takes_its_own_value_back() {
        let config = Config::default();
        for setting in SETTINGS {
            let mut change = Change::default();
            let value = setting.value(&config);
            setting.wish(&mut change, &value).expect("its own value");
            assert_ne!(change, Change::default(), "{}: the wish holds it", setting.name);
            let mut again = config.clone();
            change.apply(&mut again);
            assert_eq!(again, config, "{}: nothing else changed", setting.name);
            assert_eq!(setting.schema(&config)["value"], value, "{}", setting.name);
        }
    }

    #[test]
    fn each_wrong_field_has_its_own_line() {
        let wish =
            json!({"lights": -1, "sampler": "guess", "gui": "on", "colour": 3, "extrapolation": "average"});
        let errors = wish_of(wish.as_object().expect("an object")).expect_err("four mistakes");
        assert_eq!(errors.len(), 4, "{errors:?}");
        assert_eq!(errors["lights"], "found -1, expected a whole number from 0 to 50000");
        assert!(errors["sampler"].contains("one of adaptive"), "{errors:?}");
        assert_eq!(errors["gui"], "found \"on\", expected true or false");
        assert!(errors["colour"].contains("found 'colour', expected one of sampler"), "{errors:?}");
    }
}
