//! Changes of the probe's settings that clients request.

use super::{Setting, short};
use crate::probe::config::Config;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// A request to change settings: the new value of each setting, within its range.
#[derive(Clone, Debug, Default)]
pub struct Change {
    values: Vec<(&'static Setting, Value)>,
}

impl Change {
    /// Adds a new value of `setting` to the change.
    ///
    /// # Errors
    /// The type and range of values that the setting accepts, if `value` is not one of them.
    pub fn add(&mut self, setting: &'static Setting, value: Value) -> Result<(), String> {
        if !setting.admits(&value) {
            return Err(setting.expected());
        }
        self.values.push((setting, value));
        Ok(())
    }

    /// Writes the new values to `config`; of two new values of one setting, the later one is used.
    pub fn apply(&self, config: &mut Config) {
        for (setting, value) in &self.values {
            (setting.set)(config, value);
        }
    }
}

/// Converts a JSON object of settings to a change.
///
/// # Errors
/// For each rejected name of a setting, the value that was found and the type and range that were expected.
pub fn wish_of(object: &Map<String, Value>) -> Result<Change, BTreeMap<String, String>> {
    let mut change = Change::default();
    let mut errors = BTreeMap::new();
    for (name, value) in object {
        let known = Setting::named(name);
        let outcome = match known {
            Some(setting) => change.add(setting, value.clone()),
            None => Err(format!("one of {}", Setting::names())),
        };
        if let Err(expected) = outcome {
            let found = if known.is_some() { value.to_string() } else { format!("'{name}'") };
            errors.insert(name.clone(), format!("found {}, expected {expected}", short(&found)));
        }
    }
    if errors.is_empty() { Ok(change) } else { Err(errors) }
}
