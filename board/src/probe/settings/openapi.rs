//! The settings of the probe in the OpenAPI document.

use super::{Kind, SETTINGS, Setting, shortest};
use serde_json::{Map, Value, json};

impl Setting {
    /// Returns the schema of the setting's value in a query, where every value is text.
    fn query_schema(&self) -> Value {
        let real =
            |least, most| json!({"type": "number", "minimum": shortest(least), "maximum": shortest(most)});
        let whole = |least, most| json!({"type": "integer", "minimum": least, "maximum": most});
        let or_off = |schema| json!({"oneOf": [schema, {"type": "string", "enum": ["off"]}]});
        match self.kind {
            Kind::Choice(words) => json!({"type": "string", "enum": words}),
            Kind::Whole(least, most) => whole(least, most),
            Kind::OptionalWhole(least, most) => or_off(whole(least, most)),
            Kind::Real(least, most) => real(least, most),
            Kind::Optional(least, most) => or_off(real(least, most)),
            Kind::List(..) => json!({"type": "string"}),
            Kind::Switch => json!({"type": "string", "enum": ["on", "off"]}),
        }
    }

    fn described(&self) -> String {
        let list = if matches!(self.kind, Kind::List(..)) { " Joined by commas, or off." } else { "" };
        self.unit.map_or(self.what.into(), |unit| format!("{} Unit: {unit}.", self.what)) + list
    }
}

/// Returns the query parameters of `/change`, one per setting, for the OpenAPI document.
#[must_use]
pub fn parameters() -> Value {
    let parameter = |s: &Setting| {
        let (schema, description) = (s.query_schema(), s.described());
        json!({"name": s.parameter, "in": "query", "required": false, "schema": schema, "description": description})
    };
    SETTINGS.iter().map(parameter).collect()
}

/// Returns the properties of the JSON object that `PATCH /v1/config` accepts.
#[must_use]
pub fn properties() -> Value {
    let property = |s: &Setting| {
        let mut schema = s.value_schema();
        schema["description"] = json!(s.described());
        (s.name.to_owned(), schema)
    };
    Value::Object(SETTINGS.iter().map(property).collect::<Map<_, _>>())
}
