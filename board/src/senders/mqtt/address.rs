//! The address of an MQTT broker: `mqtt://[USER[:PASSWORD]@]HOST[:PORT][/ID][?every=S&lux=FACTOR]`.

use crate::machine;
use axum::http::Uri;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

const EXPECTED: &str = "expected mqtt://[USER:PASSWORD@]HOST[:PORT][/ID][?every=SECONDS&lux=FACTOR]";

/// Default TCP port of a broker, for MQTT without TLS.
const PORT: u16 = 1883;

/// Longest id of a probe in topics, characters.
const MOST_ID: usize = 63;

/// An MQTT broker, and the options of the messages for it.
#[derive(Clone, PartialEq)]
pub struct Broker {
    /// Host name or IP address of the broker.
    pub host: String,
    /// TCP port at which the broker listens.
    pub port: u16,
    /// User name and password for the broker.
    pub credentials: Option<(String, String)>,
    /// The id of the probe in topics: the machine's name unless the address has a path.
    pub id: String,
    /// Shortest time between two state messages to the broker.
    pub every: Duration,
    /// Lux per relative unit of irradiance, where the user states it.
    pub lux: Option<f32>,
}

/// Formats the address of the broker without the password.
impl fmt::Debug for Broker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

/// Formats the address of the broker without user name and password.
impl fmt::Display for Broker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mqtt://{}:{}/{}", self.host, self.port, self.id)
    }
}

impl FromStr for Broker {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let uri: Uri = text.parse().map_err(|_| EXPECTED.to_owned())?;
        match uri.scheme_str() {
            Some("mqtt") => {}
            Some("mqtts") => {
                return Err(
                    "this program has no TLS, expected mqtt:// to a broker or a bridge on this machine"
                        .into(),
                );
            }
            _ => return Err(EXPECTED.into()),
        }
        let authority = uri.authority().ok_or(EXPECTED)?;
        let mut broker = Self {
            host: authority.host().trim_matches(['[', ']']).into(),
            port: port(authority.as_str(), authority.host())?,
            credentials: credentials(authority.as_str())?,
            id: id(uri.path().trim_matches('/'))?,
            every: Duration::from_secs(1),
            lux: None,
        };
        for part in uri.query().unwrap_or_default().split('&').filter(|part| !part.is_empty()) {
            match part.split_once('=') {
                Some(("every", seconds)) => {
                    broker.every = Duration::from_secs_f32(number("every", seconds, 0.1, 3600.0)?);
                }
                Some(("lux", factor)) => broker.lux = Some(number("lux", factor, 1e-9, 1e9)?),
                _ => return Err(format!("found '{part}', {EXPECTED}")),
            }
        }
        Ok(broker)
    }
}

/// Returns the port that follows `host` in `authority`, or the default port.
fn port(authority: &str, host: &str) -> Result<u16, String> {
    let tail = authority.rsplit('@').next().and_then(|rest| rest.strip_prefix(host)).unwrap_or_default();
    let Some(port) = tail.strip_prefix(':') else { return Ok(PORT) };
    port.parse().ok().filter(|p| *p != 0).ok_or_else(|| format!("found port '{port}', expected 1 to 65535"))
}

fn credentials(authority: &str) -> Result<Option<(String, String)>, String> {
    let Some((both, _)) = authority.rsplit_once('@') else { return Ok(None) };
    let (user, password) = both.split_once(':').unwrap_or((both, ""));
    let read = |text| {
        decoded(text).ok_or_else(|| "user or password: expected %XX with two hexadecimal digits".to_owned())
    };
    Ok(Some((read(user)?, read(password)?)))
}

/// Decodes the percent escapes of `text`; `None` for invalid ones.
fn decoded(text: &str) -> Option<String> {
    let mut parts = text.split('%');
    let mut bytes = parts.next().unwrap_or_default().as_bytes().to_vec();
    for part in parts {
        let (digits, rest) = part.split_at_checked(2)?;
        bytes.push(u8::from_str_radix(digits, 16).ok()?);
        bytes.extend_from_slice(rest.as_bytes());
    }
    String::from_utf8(bytes).ok()
}

/// Checks the id in the path of an address for topics and for Home Assistant; without an id, returns the machine's name.
fn id(path: &str) -> Result<String, String> {
    if path.is_empty() {
        return Ok(machine::name());
    }
    let is_id =
        path.len() <= MOST_ID && path.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    is_id
        .then(|| path.to_owned())
        .ok_or_else(|| format!("found the id '{path}', expected letters, digits, - and _"))
}

fn number(name: &str, text: &str, least: f32, most: f32) -> Result<f32, String> {
    let value = text.parse().ok().filter(|v| (least..=most).contains(v));
    value.ok_or_else(|| format!("found {name} '{text}', expected a number from {least} to {most}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_an_address_is_parsed() {
        let broker: Broker =
            "mqtt://lamp:a%40b%3A@[::1]:99/attic?every=0.5&lux=120".parse().expect("an address");
        assert_eq!((broker.host.as_str(), broker.port, broker.id.as_str()), ("::1", 99, "attic"));
        assert_eq!(broker.credentials, Some(("lamp".into(), "a@b:".into())));
        assert_eq!((broker.every, broker.lux), (Duration::from_millis(500), Some(120.0)));
        assert!(!format!("{broker:?} {broker}").contains("a@b"), "the password is not shown");
        let plain: Broker = "mqtt://broker.local".parse().expect("an address");
        assert_eq!((plain.port, plain.credentials, plain.lux), (1883, None, None));
        assert!(!plain.id.is_empty(), "the machine's name");
    }

    #[test]
    fn wrong_addresses_are_refused_with_the_expected_form() {
        for (text, named) in [
            ("broker", "mqtt://"),
            ("http://broker", "mqtt://"),
            ("mqtts://broker", "no TLS"),
            ("mqtt://broker:0", "1 to 65535"),
            ("mqtt://broker:99999", "1 to 65535"),
            ("mqtt://broker/a/b", "letters, digits"),
            ("mqtt://broker/%23", "letters, digits"),
            ("mqtt://broker?every=0", "0.1 to 3600"),
            ("mqtt://broker?lux=x", "'x'"),
            ("mqtt://broker?colour=red", "every=SECONDS"),
            ("mqtt://a%4:b@broker", "hexadecimal"),
        ] {
            let error = text.parse::<Broker>().expect_err(text);
            assert!(error.contains(named), "{text}: {error}");
        }
    }
}
