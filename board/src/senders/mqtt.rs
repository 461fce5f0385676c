//! Publishes illuminance, colour temperature and the state of the source to an MQTT broker. `board/MESSAGES.md` lists the topics.

mod address;

pub use address::Broker;

use super::discovery::{self, Topics};
use super::newest::{Newest, SetUpdate};
use super::{Changes, Sender, colour};
use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::Selection;
use hemilux_core::color::luminance;
use hemilux_core::wire::Unit;
use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, Event, EventLoop, LastWill, MqttOptions, Packet, QoS,
};
use serde_json::{Value, json};
use std::io;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::Instant;

/// Largest number of messages that wait for transmission to the broker; further ones are dropped.
const QUEUE: usize = 16;

/// MQTT keep-alive interval: longest time without a packet to the broker.
const KEEP_ALIVE: Duration = Duration::from_secs(20);

/// First and longest pause between two attempts to connect to the broker.
const PAUSES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(30)];

/// Longest time for sending the message "offline" when the sender stops.
const FAREWELL: Duration = Duration::from_millis(300);

/// Largest packet received and largest packet sent, bytes.
const PACKET_BYTES: [usize; 2] = [4 << 10, 16 << 10];

/// Publishes the state of the probe behind `link` to `broker` until the sender is dropped.
///
/// # Errors
/// The error of the operating system where the thread cannot be started.
pub fn start(broker: Broker, link: Arc<Link>) -> io::Result<Sender> {
    Sender::spawn("hemilux-mqtt", move |stop| run(broker, link, stop))
}

async fn run(broker: Broker, link: Arc<Link>, mut stop: watch::Receiver<bool>) {
    let topics = Topics::of(&broker.id);
    let (client, events) = AsyncClient::new(options(&broker, &topics), QUEUE);
    let (connected, is_connected) = watch::channel(false);
    let name = format!("--mqtt {}:{}", broker.host, broker.port);
    let connection = tokio::spawn(connect(events, connected, name));
    let units = Units { lux: broker.lux };
    tokio::select! {
        _ = stop.wait_for(|stop| *stop) => {}
        () = publish(&client, link, is_connected.clone(), &topics, units, broker.every) => {}
    }
    if *is_connected.borrow() {
        let _ = client.try_publish(&topics.availability, QoS::AtLeastOnce, true, "offline");
        let _ = client.try_disconnect();
        let _ = tokio::time::timeout(FAREWELL, connection).await;
    }
}

fn options(broker: &Broker, topics: &Topics) -> MqttOptions {
    let mut options = MqttOptions::new(format!("hemilux-{}", broker.id), &broker.host, broker.port);
    options.set_keep_alive(KEEP_ALIVE).set_max_packet_size(PACKET_BYTES[0], PACKET_BYTES[1]);
    options.set_last_will(LastWill::new(&topics.availability, "offline", QoS::AtLeastOnce, true));
    if let Some((user, password)) = &broker.credentials {
        options.set_credentials(user, password);
    }
    options
}

/// Keeps the connection to the broker; `connected` contains whether there is one. Ends after a requested disconnection.
async fn connect(mut events: EventLoop, connected: watch::Sender<bool>, name: String) {
    let mut changes = Changes::default();
    let mut pause = PAUSES[0];
    loop {
        match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                changes.well(&name);
                pause = PAUSES[0];
                connected.send_replace(true);
            }
            Ok(Event::Outgoing(rumqttc::Outgoing::Disconnect)) => return,
            Ok(_) => {}
            Err(error) => {
                connected.send_replace(false);
                changes.fault(&name, &reason(&error));
                tokio::time::sleep(pause).await;
                pause = (2 * pause).min(PAUSES[1]);
            }
        }
    }
}

fn reason(error: &ConnectionError) -> String {
    match error {
        ConnectionError::ConnectionRefused(
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
        ) => "a broker that refuses the user and the password, expected mqtt://USER:PASSWORD@HOST".into(),
        ConnectionError::Io(error) => error.to_string(),
        ConnectionError::NetworkTimeout | ConnectionError::FlushTimeout => "no answer in time".into(),
        error => error.to_string(),
    }
}

/// Publishes the discovery messages after each connection, and the state of the probe at most once per `every`.
async fn publish(
    client: &AsyncClient,
    link: Arc<Link>,
    mut is_connected: watch::Receiver<bool>,
    topics: &Topics,
    units: Units,
    every: Duration,
) {
    let mut newest = Newest::new(link, Selection::OWN);
    let mut due = Instant::now();
    loop {
        let news = newest.next().await;
        let is_new = is_connected.has_changed().unwrap_or(false);
        if !*is_connected.borrow_and_update() {
            continue;
        }
        if is_new {
            announce(client, topics, units.of(&news), every);
            due = Instant::now();
        }
        // A light set that is not published is superseded by the next one.
        if Instant::now() >= due {
            due = Instant::now() + every;
            let state = state(&news, units, newest.link.durations().timings().rate_hz()).to_string();
            let _ = client.try_publish(&topics.state, QoS::AtMostOnce, true, state);
        }
    }
}

fn announce(client: &AsyncClient, topics: &Topics, unit: Unit, every: Duration) {
    for (topic, payload) in discovery::messages(topics, unit, every) {
        let _ = client.try_publish(topic, QoS::AtLeastOnce, true, payload.to_string());
    }
    let _ = client.try_publish(&topics.availability, QoS::AtLeastOnce, true, "online");
}

/// Conversion of irradiances of light sets to illuminances.
#[derive(Clone, Copy, Debug)]
struct Units {
    /// Lux per relative unit of irradiance, if the user states it.
    lux: Option<f32>,
}

impl Units {
    fn of(self, news: &SetUpdate) -> Unit {
        match (self.lux, news) {
            (None, SetUpdate::Fresh(set) | SetUpdate::Stale(set, _)) => set.unit,
            (None, SetUpdate::None(_)) => Unit::Relative,
            (Some(_), _) => Unit::Lux,
        }
    }

    fn illuminance(self, set: &OwnedSet) -> f32 {
        luminance(set.horizontal_irradiance) * self.lux.unwrap_or(1.0)
    }
}

/// Returns the state message for an update. If the source has failed, the message states the problem and the values of the last set.
fn state(news: &SetUpdate, units: Units, rate_hz: f32) -> Value {
    let (set, reason) = match news {
        SetUpdate::Fresh(set) => (Some(set), String::new()),
        SetUpdate::Stale(set, staleness) => (Some(set), staleness.reason.clone()),
        SetUpdate::None(reason) => (None, reason.clone()),
    };
    let rounded = |value: f32, digits: i32| {
        let scale = 10f64.powi(digits);
        Some((f64::from(value) * scale).round() / scale).filter(|v| v.is_finite())
    };
    json!({
        "illuminance": set.and_then(|s| rounded(units.illuminance(s), 3)),
        "colour_temperature": set.and_then(|s| colour::temperature(s.horizontal_irradiance)).and_then(|k| rounded(k, 0)),
        "clipped": set.and_then(|s| rounded(100.0 * s.clipped, 2)),
        "unseen": set.and_then(|s| rounded(100.0 * s.unseen, 2)),
        "lights": set.map(|s| s.lights.len()),
        "rate": rounded(rate_hz, 1),
        "frame": set.map(|s| s.frame),
        "problem": if reason.is_empty() { "OFF" } else { "ON" },
        "reason": reason,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::wire::Stale;

    fn set() -> Arc<OwnedSet> {
        let horizontal_irradiance = [2.0, 2.0, 2.0];
        Arc::new(OwnedSet { frame: 7, horizontal_irradiance, clipped: 0.0125, ..OwnedSet::default() })
    }

    #[test]
    fn the_state_has_the_values_of_the_set() {
        let found = state(&SetUpdate::Fresh(set()), Units { lux: Some(150.0) }, 10.0);
        assert_eq!(found["illuminance"], 300.0, "2 units of 150 lx");
        assert_eq!((&found["clipped"], &found["problem"]), (&json!(1.25), &json!("OFF")), "{found}");
        let kelvins = found["colour_temperature"].as_f64().expect("a temperature");
        assert!((kelvins - 6504.0).abs() < 20.0, "white of Rec. 709 is D65: {kelvins}");
    }

    #[test]
    fn a_failed_source_is_a_problem_with_its_reason() {
        let staleness = Stale { age_ms: 9, reason: "/dev/video0: unplugged".into() };
        let stale = state(&SetUpdate::Stale(set(), staleness), Units { lux: None }, 0.0);
        assert_eq!((&stale["problem"], &stale["frame"]), (&json!("ON"), &json!(7)), "{stale}");
        let none = state(&SetUpdate::None("no burst".into()), Units { lux: None }, 0.0);
        assert_eq!((&none["problem"], &none["illuminance"]), (&json!("ON"), &Value::Null), "{none}");
    }
}
