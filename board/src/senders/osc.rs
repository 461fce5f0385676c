//! Light sets as bundles of Open Sound Control 1.0 over UDP. `board/MESSAGES.md` lists the addresses.

use super::newest::{Newest, SetUpdate};
use super::slots::Slots;
use super::{Changes, Sender};
use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::Selection;
use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{Coordinates, Stale};
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};
use std::fmt;
use std::io;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::UdpSocket;
use tokio::sync::watch;

/// Largest number of lights that are sent to a target.
pub const MOST_LIGHTS: usize = 256;

/// Number of lights that are sent to a target without `lights=`.
const USUAL_LIGHTS: usize = 16;

/// Largest bundle, bytes, so that a bundle fits one Ethernet frame.
const BUNDLE_BYTES: usize = 1400;

/// Pause after a failed lookup of a target's host name, and after a failure to send.
const PAUSE: Duration = Duration::from_secs(2);

/// Seconds from the epoch of OSC time tags, 1900, to the Unix epoch.
const UNIX_EPOCH_S: u64 = 2_208_988_800;

/// A receiver of OSC bundles: `HOST:PORT[,lights=N][,coordinates=NAME]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Host and port of the receiver.
    pub peer: String,
    /// Largest number of lights that are sent.
    pub lights: usize,
    /// Axes of the directions and harmonics in the messages.
    pub coordinates: Coordinates,
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let peer = parts.next().unwrap_or_default();
        let port = peer.rsplit_once(':').filter(|(host, _)| !host.is_empty()).map(|(_, port)| port);
        if port.and_then(|p| p.parse::<u16>().ok()).is_none_or(|p| p == 0) {
            return Err("expected HOST:PORT[,lights=N][,coordinates=NAME]".into());
        }
        let mut target =
            Self { peer: peer.into(), lights: USUAL_LIGHTS, coordinates: Coordinates::default() };
        for part in parts {
            match part.split_once('=') {
                Some(("lights", number)) => target.lights = count(number)?,
                Some(("coordinates", name)) => {
                    target.coordinates = Coordinates::from_name(name)
                        .ok_or_else(|| format!("found coordinates '{name}', expected one of {}", names()))?;
                }
                _ => return Err(format!("found '{part}', expected lights=N or coordinates=NAME")),
            }
        }
        Ok(target)
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},lights={},coordinates={}", self.peer, self.lights, self.coordinates.name())
    }
}

fn count(number: &str) -> Result<usize, String> {
    let count = number.parse().ok().filter(|n| (1..=MOST_LIGHTS).contains(n));
    count.ok_or_else(|| format!("found lights '{number}', expected 1 to {MOST_LIGHTS}"))
}

fn names() -> String {
    Coordinates::names().collect::<Vec<_>>().join(", ")
}

/// Sends each set of the probe behind `link` to `target` until the sender is dropped.
///
/// # Errors
/// The error of the operating system where the thread cannot be started.
pub fn start(target: Target, link: Arc<Link>) -> io::Result<Sender> {
    Sender::spawn("hemilux-osc", move |stop| run(target, link, stop))
}

async fn run(target: Target, link: Arc<Link>, mut stop: watch::Receiver<bool>) {
    tokio::select! {
        _ = stop.wait_for(|stop| *stop) => {}
        () = send(target, link) => {}
    }
}

async fn send(target: Target, link: Arc<Link>) {
    let name = format!("--osc {}", target.peer);
    let mut changes = Changes::default();
    let mut newest =
        Newest::new(link, Selection { lights: Some(target.lights), ambient: Some(true), soft: None });
    let mut bundles = Bundles::new(&target);
    loop {
        let socket = match connected(&target.peer).await {
            Ok(socket) => socket,
            Err(error) => {
                changes.fault(&name, &error.to_string());
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let error = send_sets(&socket, &mut newest, &mut bundles, || changes.well(&name)).await;
        changes.fault(&name, &error.to_string());
        tokio::time::sleep(PAUSE).await;
    }
}

/// Opens a UDP socket whose datagrams go to `peer`.
async fn connected(peer: &str) -> io::Result<UdpSocket> {
    let address = tokio::net::lookup_host(peer).await?.next();
    let address = address.ok_or_else(|| io::Error::other("no address of that name"))?;
    let any = if address.is_ipv6() { "[::]:0" } else { "0.0.0.0:0" };
    let socket = UdpSocket::bind(any).await?;
    socket.connect(address).await?;
    Ok(socket)
}

/// Sends light sets until sending fails; `works` is called for each set if the peer has refused no datagram for [`PAUSE`]. A datagram for which
/// the system's buffer has no space is dropped: the next set replaces it.
async fn send_sets(
    socket: &UdpSocket,
    newest: &mut Newest,
    bundles: &mut Bundles,
    mut works: impl FnMut(),
) -> io::Error {
    let began = Instant::now();
    loop {
        let (set, stale) = match newest.next().await {
            SetUpdate::Fresh(set) => (set, None),
            SetUpdate::Stale(set, staleness) => (set, Some(staleness)),
            SetUpdate::None(reason) => {
                tracing::debug!("OSC: no set to send: {reason}");
                continue;
            }
        };
        for bundle in bundles.of(&set, newest.link.run(), stale.as_ref()) {
            match socket.try_send(&bundle) {
                Err(e) if e.kind() != io::ErrorKind::WouldBlock => return e,
                _ => {}
            }
        }
        if began.elapsed() > PAUSE {
            works();
        }
    }
}

/// Encodes light sets as bundles; a light keeps the number in its OSC address from set to set.
struct Bundles {
    slots: Slots,
    coordinates: Coordinates,
}

impl Bundles {
    fn new(target: &Target) -> Self {
        Self { slots: Slots::new(target.lights), coordinates: target.coordinates }
    }

    /// Returns a light set as bundles with one time tag, each at most [`BUNDLE_BYTES`] long.
    fn of(&mut self, set: &OwnedSet, run: &str, stale: Option<&Stale<String>>) -> Vec<Vec<u8>> {
        let mut messages = summary(set, run, stale);
        if let Some(rows) = &set.ambient_sh {
            messages.push(ambient(&self.coordinates.harmonics(rows)));
        }
        for (place, light) in self.slots.place(&set.lights).into_iter().enumerate() {
            messages.push(light_message(place + 1, light, self.coordinates));
        }
        packed(&messages, time_tag(set.wall_ms))
    }
}

/// Returns the messages with the sums and the identity of a light set.
fn summary(set: &OwnedSet, run: &str, stale: Option<&Stale<String>>) -> Vec<OscMessage> {
    let reason = stale.map_or("", |s| s.reason.as_str());
    let frame = i32::try_from(set.frame & 0x7fff_ffff).unwrap_or_default();
    let count = i32::try_from(set.lights.len()).unwrap_or(i32::MAX);
    let text = |text: &str| OscType::String(text.replace('\0', " "));
    vec![
        message("set", vec![OscType::Int(frame), text(run), OscType::Int(count), text(reason)]),
        message("flux", floats(set.scalar_flux)),
        message("horizontal", floats(set.horizontal_irradiance)),
        message("clipped", floats([set.clipped])),
        message("unseen", floats([set.unseen])),
    ]
}

fn message(name: &str, args: Vec<OscType>) -> OscMessage {
    OscMessage { addr: format!("/hemilux/{name}"), args }
}

fn floats<const N: usize>(values: [f32; N]) -> Vec<OscType> {
    values.map(OscType::Float).into()
}

/// Returns the message `/hemilux/light/PLACE id x y z r g b radius`, with zeros for a place without a light.
fn light_message(place: usize, light: Option<&Light>, coordinates: Coordinates) -> OscMessage {
    let dark = Light::default();
    let light = light.unwrap_or(&dark);
    let [r, g, b] = light.irradiance;
    let d = coordinates.direction(light.direction);
    let mut args = vec![OscType::Int(light.id.cast_signed())];
    args.extend(floats([d.x, d.y, d.z, r, g, b, light.radius_deg]));
    message(&format!("light/{place}"), args)
}

fn ambient(rows: &Sh9) -> OscMessage {
    message("ambient", rows.iter().flatten().map(|v| OscType::Float(*v)).collect())
}

/// Converts Unix milliseconds to a time tag: seconds since 1900 and their fraction in units of 2^-32 s.
fn time_tag(wall_ms: u64) -> OscTime {
    let seconds = wall_ms / 1000 + UNIX_EPOCH_S;
    let fraction = ((wall_ms % 1000) << 32) / 1000;
    // The seconds wrap in 2036, like those of NTP.
    OscTime { seconds: (seconds & 0xffff_ffff) as u32, fractional: fraction as u32 }
}

/// Packs `messages` into as few bundles as their length permits.
fn packed(messages: &[OscMessage], timetag: OscTime) -> Vec<Vec<u8>> {
    // A bundle begins with "#bundle" and the time tag; each message follows its length.
    const HEAD: usize = 16;
    let (mut bundles, mut content, mut length) = (Vec::new(), Vec::new(), HEAD);
    let mut close = |content: &mut Vec<OscPacket>| {
        let bundle = OscBundle { timetag, content: std::mem::take(content) };
        bundles.extend(encoder::encode(&OscPacket::Bundle(bundle)).ok());
    };
    for message in messages {
        let packet = OscPacket::Message(message.clone());
        let bytes = encoder::encode(&packet).map_or(0, |bytes| bytes.len()) + 4;
        if length + bytes > BUNDLE_BYTES && !content.is_empty() {
            close(&mut content);
            length = HEAD;
        }
        content.push(packet);
        length += bytes;
    }
    close(&mut content);
    bundles
}

#[cfg(test)]
mod tests {
    use super::*;
    use rosc::decoder;

    #[test]
    fn targets_are_parsed_and_wrong_ones_refused_with_the_expected_form() {
        let target: Target = "studio.local:8000,lights=4,coordinates=unreal".parse().expect("a target");
        let expected =
            Target { peer: "studio.local:8000".into(), lights: 4, coordinates: Coordinates::Unreal };
        assert_eq!(target, expected);
        assert_eq!("[::1]:9".parse::<Target>().map(|t| t.lights), Ok(16));
        for (text, named) in [
            ("studio", "HOST:PORT"),
            (":9000", "HOST:PORT"),
            ("studio:0", "HOST:PORT"),
            ("studio:70000", "HOST:PORT"),
            ("a:9,lights=0", "1 to 256"),
            ("a:9,coordinates=maya", "unreal"),
            ("a:9,colour=red", "lights=N"),
        ] {
            let error = text.parse::<Target>().expect_err(text);
            assert!(error.contains(named), "{text}: {error}");
        }
    }

    #[test]
    fn a_time_tag_counts_from_1900_in_fractions_of_two_to_the_32() {
        // RFC 5905: 1 January 1970 is 2,208,988,800 s.
        assert_eq!(time_tag(0), OscTime { seconds: 2_208_988_800, fractional: 0 });
        assert_eq!(time_tag(1500), OscTime { seconds: 2_208_988_801, fractional: 1 << 31 });
    }

    /// Returns the messages in all bundles; asserts that each bundle has the time tag `tag` and fits an Ethernet frame.
    fn messages(bundles: &[Vec<u8>], tag: OscTime) -> Vec<OscMessage> {
        let mut found = Vec::new();
        for bytes in bundles {
            assert!(bytes.len() <= BUNDLE_BYTES, "{} bytes", bytes.len());
            let Ok((_, OscPacket::Bundle(bundle))) = decoder::decode_udp(bytes) else { panic!("no bundle") };
            assert_eq!(bundle.timetag, tag);
            for packet in bundle.content {
                let OscPacket::Message(message) = packet else { panic!("a bundle in a bundle") };
                found.push(message);
            }
        }
        found
    }

    #[test]
    fn a_set_has_a_summary_and_a_message_for_each_place_in_the_targets_axes() {
        let target: Target = "a:9,lights=40,coordinates=unreal".parse().expect("a target");
        let lights = (1..=30u32).map(|id| Light {
            id,
            direction: glam::Vec3::new(0.6, 0.8, 0.0),
            irradiance: [id as f32, 2.0, 1.0],
            radius_deg: 3.0,
            ..Light::default()
        });
        let set = OwnedSet { frame: 5, wall_ms: 1500, lights: lights.collect(), ..OwnedSet::default() };
        let bundles = Bundles::new(&target).of(&set, "k3v9x", None);
        assert!(bundles.len() > 1, "more than one frame holds");
        let found = messages(&bundles, time_tag(1500));
        assert_eq!(found.len(), 5 + 40, "a summary of five, and forty places");
        let [frame, run, count, stale] = found[0].args.as_slice() else { panic!("{:?}", found[0]) };
        assert_eq!((frame, count), (&OscType::Int(5), &OscType::Int(30)));
        assert_eq!((run, stale), (&OscType::String("k3v9x".into()), &OscType::String(String::new())));
        let brightest = &found[5];
        assert_eq!(brightest.addr, "/hemilux/light/1");
        // In `board/FORMATS.md`, Unreal's axes are the probe's (x, -y, z).
        let expected = [0.6, -0.8, 0.0, 30.0, 2.0, 1.0, 3.0].map(OscType::Float);
        assert_eq!(brightest.args[1..], expected, "light 30 is the brightest");
        assert_eq!(brightest.args[0], OscType::Int(30));
        assert_eq!(found[44].args[0], OscType::Int(0), "a free place");
    }
}
