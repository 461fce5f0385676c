//! The messages by which Home Assistant discovers the probe's sensors.

use hemilux_core::wire::Unit;
use serde_json::{Value, json};
use std::time::Duration;

/// Number of state intervals without a message after which Home Assistant shows a sensor as unavailable.
const MISSED_STATES: u64 = 10;

/// The MQTT topics to which one probe publishes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Topics {
    id: String,
    pub(super) state: String,
    pub(super) availability: String,
}

impl Topics {
    pub(super) fn of(id: &str) -> Self {
        let topic = |name| format!("hemilux/{id}/{name}");
        Self { id: id.into(), state: topic("state"), availability: topic("availability") }
    }
}

/// A sensor of Home Assistant: its member of the state message, its title, unit and class.
struct Sensor {
    member: &'static str,
    title: &'static str,
    unit: Option<&'static str>,
    class: Option<&'static str>,
}

/// Returns the topics and payloads of the discovery messages, one for each sensor.
pub(super) fn messages(topics: &Topics, unit: Unit, every: Duration) -> Vec<(String, Value)> {
    let is_lux = unit == Unit::Lux;
    let plain = |member, title, unit| Sensor { member, title, unit, class: None };
    let illuminance = Sensor {
        member: "illuminance",
        title: if is_lux { "Illuminance" } else { "Illuminance (relative)" },
        unit: is_lux.then_some("lx"),
        class: is_lux.then_some("illuminance"),
    };
    let sensors = [
        illuminance,
        plain("colour_temperature", "Colour temperature", Some("K")),
        plain("clipped", "Clipped", Some("%")),
        plain("unseen", "Unseen", Some("%")),
        plain("lights", "Lights", None),
        plain("rate", "Rate", Some("Hz")),
    ];
    let mut messages: Vec<_> = sensors.iter().map(|sensor| message(topics, sensor, every)).collect();
    messages.push(problem(topics, every));
    messages
}

fn message(topics: &Topics, sensor: &Sensor, every: Duration) -> (String, Value) {
    let mut payload = common(topics, sensor.member, sensor.title, every);
    payload["state_class"] = json!("measurement");
    if let Some(unit) = sensor.unit {
        payload["unit_of_measurement"] = json!(unit);
    }
    if let Some(class) = sensor.class {
        payload["device_class"] = json!(class);
    }
    (format!("homeassistant/sensor/hemilux_{}/{}/config", topics.id, sensor.member), payload)
}

fn problem(topics: &Topics, every: Duration) -> (String, Value) {
    let mut payload = common(topics, "problem", "Problem", every);
    payload["device_class"] = json!("problem");
    payload["json_attributes_topic"] = json!(topics.state);
    payload["json_attributes_template"] = json!("{{ {'reason': value_json.reason} | tojson }}");
    (format!("homeassistant/binary_sensor/hemilux_{}/problem/config", topics.id), payload)
}

fn common(topics: &Topics, member: &str, title: &str, every: Duration) -> Value {
    let Topics { id, state, availability } = topics;
    json!({
        "name": title,
        "unique_id": format!("hemilux_{id}_{member}"),
        "state_topic": state,
        "value_template": format!("{{{{ value_json.{member} }}}}"),
        "availability_topic": availability,
        "expire_after": (MISSED_STATES * every.as_secs().max(1)).max(30),
        "device": {
            "identifiers": [format!("hemilux_{id}")],
            "name": format!("hemilux {id}"),
            "manufacturer": "hemilux",
            "model": "light probe",
            "sw_version": env!("CARGO_PKG_VERSION"),
        },
        "origin": { "name": "hemilux", "sw_version": env!("CARGO_PKG_VERSION") },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_illuminance_has_the_class_and_unit_of_home_assistant_in_lux_alone() {
        let topics = Topics::of("attic");
        let payload = |unit| messages(&topics, unit, Duration::from_secs(1)).swap_remove(0);
        let (topic, lux) = payload(Unit::Lux);
        assert_eq!(topic, "homeassistant/sensor/hemilux_attic/illuminance/config");
        assert_eq!(
            (&lux["device_class"], &lux["unit_of_measurement"]),
            (&json!("illuminance"), &json!("lx"))
        );
        let (_, relative) = payload(Unit::Relative);
        assert!(relative.get("device_class").is_none() && relative.get("unit_of_measurement").is_none());
        assert_eq!(lux["value_template"], "{{ value_json.illuminance }}");
    }

    #[test]
    fn the_sensors_of_a_probe_have_different_ids_and_one_device() {
        let found = messages(&Topics::of("attic"), Unit::Relative, Duration::from_secs(1));
        let ids: std::collections::BTreeSet<_> =
            found.iter().map(|(_, p)| p["unique_id"].to_string()).collect();
        assert_eq!((found.len(), ids.len()), (7, 7));
        assert!(found.iter().all(|(_, p)| p["device"]["identifiers"] == json!(["hemilux_attic"])));
    }
}
