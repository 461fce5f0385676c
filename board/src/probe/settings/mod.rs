//! The settings: name, type, range, unit and description of each. The configuration file, the command line, `/change`, `/v1/config`, the JSON
//! schema and the OpenAPI document are derived from the [table](SETTINGS).

mod change;
mod openapi;
mod table;

pub use change::{Change, wish_of};
pub use openapi::{parameters, properties};

pub use table::SETTINGS;

use super::config::Config;
use hemilux_core::healpix::Domain;
use serde_json::{Value, json};

/// Type and range of the value of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// One of the words in the field.
    Choice(&'static [&'static str]),
    /// A whole number from the first field to the second, both included.
    Whole(u64, u64),
    /// A whole number from the first field to the second, or null for no value.
    OptionalWhole(u64, u64),
    /// A number from the first field to the second, both included.
    Real(f32, f32),
    /// A number from the first field to the second, or null for no value.
    Optional(f32, f32),
    /// A list of ascending numbers from the first field to the second, with at most as many elements as the third field, or null for no list.
    List(f32, f32, usize),
    /// A switch, which is true or false.
    Switch,
}

/// Groups of settings, in the order in which the page shows them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Settings of the sampler and of its lights.
    Lights,
    /// Settings of the exposures and of the map.
    Map,
    /// Budgets of the durations of the stages.
    Budgets,
    /// Settings that do not affect the lights of the probe's own set.
    Other,
}

impl Group {
    /// Returns the name of the group in the JSON schema.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lights => "lights",
            Self::Map => "map",
            Self::Budgets => "budgets",
            Self::Other => "other",
        }
    }

    /// Returns the heading of the group on the page.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Lights => "From the map to the lights",
            Self::Map => "From the lens to the map",
            Self::Budgets => "Budgets",
            Self::Other => "Other",
        }
    }
}

/// A setting: name, type, range, description and access to its value.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Name of the setting in `/v1/config` and in the configuration file.
    pub name: &'static str,
    /// Name of the parameter of `/change`, as the thesis defines it.
    pub parameter: &'static str,
    /// Label of the setting on the probe's page and in the form of `/change`.
    pub title: &'static str,
    /// Group in which the page shows the setting.
    pub group: Group,
    /// Type and range of the values of the setting.
    pub kind: Kind,
    /// Unit of the values of the setting; `None` for values that are no number or have no unit.
    pub unit: Option<&'static str>,
    /// Description of the setting's effect: full sentences.
    pub what: &'static str,
    value: fn(&Config) -> Value,
    /// Writes a value within the setting's range to a configuration.
    set: fn(&mut Config, &Value),
    /// Returns true if the setting has an effect, given the values of the other settings of a configuration.
    in_use: fn(&Config) -> bool,
}

impl Setting {
    /// Returns the value of this setting in `config` as JSON.
    #[must_use]
    pub fn value(&self, config: &Config) -> Value {
        (self.value)(config)
    }

    /// Returns the setting called `name`; `None` for an unknown name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        SETTINGS.iter().find(|s| s.name == name)
    }

    /// Returns the names of all settings, separated by commas.
    #[must_use]
    pub fn names() -> String {
        SETTINGS.iter().map(|s| s.name).collect::<Vec<_>>().join(", ")
    }

    /// Returns the value of this setting in `config` as text, in the form that [`Setting::parse`] accepts.
    #[must_use]
    pub fn word(&self, config: &Config) -> String {
        match self.value(config) {
            Value::Null => "off".into(),
            Value::Bool(on) => if on { "on" } else { "off" }.into(),
            Value::String(word) => word,
            Value::Array(list) => list.iter().map(ToString::to_string).collect::<Vec<_>>().join(","),
            number => number.to_string(),
        }
    }

    /// Parses a value of this setting from a query or the command line; `None` where type or range is wrong.
    #[must_use]
    pub fn parse(&self, word: &str) -> Option<Value> {
        let value = match self.kind {
            Kind::Choice(_) => json!(word),
            Kind::Whole(..) => json!(word.parse::<u64>().ok()?),
            Kind::Optional(..) | Kind::OptionalWhole(..) | Kind::List(..) if word == "off" => Value::Null,
            Kind::OptionalWhole(..) => json!(word.parse::<u64>().ok()?),
            Kind::Real(..) | Kind::Optional(..) => json!(word.parse::<f64>().ok()?),
            Kind::List(..) => {
                json!(word.split(',').map(str::parse::<f64>).collect::<Result<Vec<_>, _>>().ok()?)
            }
            Kind::Switch => json!(match word {
                "on" => true,
                "off" => false,
                _ => return None,
            }),
        };
        self.admits(&value).then_some(value)
    }

    fn admits(&self, value: &Value) -> bool {
        let real = |v: &Value, least, most| v.as_f64().is_some_and(|v| (least..=most).contains(&(v as f32)));
        let whole = |v: &Value, least, most| v.as_u64().is_some_and(|v| (least..=most).contains(&v));
        match self.kind {
            Kind::Choice(words) => value.as_str().is_some_and(|v| words.contains(&v)),
            Kind::Whole(least, most) => whole(value, least, most),
            Kind::OptionalWhole(least, most) => value.is_null() || whole(value, least, most),
            Kind::Real(least, most) => real(value, least, most),
            Kind::Optional(least, most) => value.is_null() || real(value, least, most),
            Kind::List(least, most, count) => {
                let rises = |list: &Vec<Value>| list.windows(2).all(|w| w[0].as_f64() < w[1].as_f64());
                value.is_null()
                    || value.as_array().is_some_and(|list| {
                        (1..=count).contains(&list.len())
                            && list.iter().all(|v| real(v, least, most))
                            && rises(list)
                    })
            }
            Kind::Switch => value.is_boolean(),
        }
    }

    /// Describes type and range of the JSON values that this setting accepts, for error messages.
    #[must_use]
    pub fn expected(&self) -> String {
        match self.kind {
            Kind::Switch => "true or false".into(),
            _ => self.words() + if self.is_optional() { ", or null" } else { "" },
        }
    }

    /// Describes type and range of the values that this setting accepts on the command line, for error
    /// messages.
    #[must_use]
    pub fn expected_word(&self) -> String {
        self.words() + if self.is_optional() { ", or off" } else { "" }
    }

    fn is_optional(&self) -> bool {
        matches!(self.kind, Kind::Optional(..) | Kind::OptionalWhole(..) | Kind::List(..))
    }

    fn words(&self) -> String {
        match self.kind {
            Kind::Choice(words) => format!("one of {}", words.join(", ")),
            Kind::Whole(least, most) | Kind::OptionalWhole(least, most) => {
                format!("a whole number from {least} to {most}")
            }
            Kind::Real(least, most) | Kind::Optional(least, most) => {
                format!("a number from {least} to {most}")
            }
            Kind::List(least, most, count) => format!("1 to {count} rising numbers from {least} to {most}"),
            Kind::Switch => "on or off".into(),
        }
    }

    /// Returns type and range of the setting's values as JSON Schema.
    fn value_schema(&self) -> Value {
        let real = |least, most| json!({"minimum": shortest(least), "maximum": shortest(most)});
        let whole = |least, most| json!({"minimum": least, "maximum": most});
        let (kinds, mut schema) = match self.kind {
            Kind::Choice(words) => (json!("string"), json!({"enum": words})),
            Kind::Whole(least, most) => (json!("integer"), whole(least, most)),
            Kind::OptionalWhole(least, most) => (json!(["integer", "null"]), whole(least, most)),
            Kind::Real(least, most) => (json!("number"), real(least, most)),
            Kind::Optional(least, most) => (json!(["number", "null"]), real(least, most)),
            Kind::List(least, most, count) => (
                json!(["array", "null"]),
                json!({"items": {"type": "number", "minimum": shortest(least), "maximum": shortest(most)},
                    "minItems": 1, "maxItems": count}),
            ),
            Kind::Switch => (json!("boolean"), json!({})),
        };
        schema["type"] = kinds;
        schema
    }

    /// Returns type, range, unit, description and value in `config` of the setting as JSON Schema; `minimum` of `lights` is that of the
    /// sampler in use.
    #[must_use]
    pub fn schema(&self, config: &Config) -> Value {
        let mut schema = self.value_schema();
        if self.name == "lights" && !config.pipeline.ambient {
            schema["minimum"] = json!(config.pipeline.sampler.least_lights(Domain::Hemisphere));
        }
        schema["unit"] = json!(self.unit);
        schema["title"] = json!(self.title);
        schema["position"] = json!(SETTINGS.iter().position(|s| s.name == self.name));
        schema["group"] = json!(self.group.name());
        schema["group_title"] = json!(self.group.title());
        schema["description"] = json!(self.what);
        schema["in_use"] = json!((self.in_use)(config));
        schema["value"] = self.value(config);
        schema
    }
}

/// Returns the shortest decimal number that rounds to the f32 `v`: 0.03 and not 0.029999999329447746.
fn shortest(v: f32) -> f64 {
    v.to_string().parse().unwrap_or(v.into())
}

/// Largest number of characters of a client's text that an error message repeats.
const ECHO: usize = 40;

/// Returns at most 40 characters from the start of a client's `text`; control characters become spaces.
#[must_use]
pub fn short(text: &str) -> String {
    text.chars().take(ECHO).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_accepts_its_own_value() {
        let config = Config::default();
        for setting in SETTINGS {
            let mut change = Change::default();
            let value = setting.value(&config);
            change.add(setting, value.clone()).expect("its own value");
            let mut again = config.clone();
            change.apply(&mut again);
            assert_eq!(again, config, "{}: nothing else changed", setting.name);
            assert_eq!(setting.schema(&config)["value"], value, "{}", setting.name);
            assert_eq!(setting.parse(&setting.word(&config)), Some(value), "{}: as a word", setting.name);
        }
    }

    #[test]
    fn each_wrong_field_has_its_own_error() {
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
