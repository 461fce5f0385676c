//! The encoded forms of a light set.

use super::memory::LONGEST;
use super::packed;
use super::xr;
use crate::export::{Form, encode};
use axum::http::HeaderValue;
use hemilux_core::wire;

/// Usual number of bytes of an answer in addition to its lights.
const HEAD_BYTES: usize = 4096;

/// File name by which an exported USD scene refers to the map: that of `/v1/map.exr`, when both files are saved
/// in one folder.
const MAP: &str = "./map.exr";

/// An encoded form of a light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Format {
    Json,
    Text,
    Xml,
    Binary,
    /// A light set as JSON in a server-sent event.
    Event,
    /// A server-sent event as a part of a gzip stream.
    PackedEvent,
    /// The values of a WebXR light estimate as JSON.
    Estimate,
    /// A file for another program: a table or a scene.
    File(Form),
}

impl Format {
    /// The values of the query parameter `format`, each with its form.
    pub(super) const NAMED: [(&str, Self); 10] = [
        ("json", Self::Json),
        ("text", Self::Text),
        ("xml", Self::Xml),
        ("binary", Self::Binary),
        ("csv", Self::File(Form::Csv)),
        ("glb", Self::File(Form::Glb)),
        ("usda", Self::File(Form::Usda)),
        ("rad", Self::File(Form::Radiance)),
        ("mitsuba", Self::File(Form::Mitsuba)),
        ("blender", Self::File(Form::Blender)),
    ];

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(n, _)| *n == name).map(|(_, format)| *format)
    }

    /// Returns true if sets in this form contain ambient light in addition to lights.
    pub(super) fn has_ambient(self) -> bool {
        matches!(self, Self::Json | Self::Binary | Self::Event | Self::PackedEvent | Self::Estimate)
    }

    /// Returns the number of bytes that one light in this form usually does not exceed.
    const fn bytes_per_light(self) -> usize {
        match self {
            Self::Binary => 40,
            Self::Text | Self::File(Form::Csv) => 110,
            Self::Xml => 130,
            Self::Json | Self::Event | Self::PackedEvent | Self::File(Form::Radiance) => 180,
            Self::File(Form::Mitsuba) => 310,
            Self::Estimate => 0,
            Self::File(_) => 450,
        }
    }

    /// Returns the number of bytes that a set of `lights` lights in this form usually does not exceed.
    pub(super) const fn expected_length(self, lights: usize) -> usize {
        HEAD_BYTES + self.bytes_per_light() * lights
    }

    /// Returns the largest number of lights of an answer in this form.
    pub(super) fn most_lights(self) -> usize {
        (LONGEST - HEAD_BYTES).checked_div(self.bytes_per_light()).unwrap_or(usize::MAX)
    }

    pub(super) fn content_type(self) -> HeaderValue {
        HeaderValue::from_static(match self {
            Self::Json | Self::Estimate => "application/json",
            Self::Text => "text/plain; charset=utf-8",
            Self::Xml => "application/xml",
            Self::Binary => "application/vnd.hemilux.lights",
            Self::Event | Self::PackedEvent => "text/event-stream",
            Self::File(form) => form.media_type(),
        })
    }

    /// Encodes `set` in this form into a buffer with a capacity of `room` bytes; `None` only for a programming error, since writing to
    /// memory does not fail.
    pub(super) fn encode(self, set: &wire::LightSet<'_>, room: usize) -> Option<Vec<u8>> {
        let mut bytes = Vec::with_capacity(room);
        let written = match self {
            Self::PackedEvent => return Self::Event.encode(set, room).map(|bytes| packed::part(&bytes)),
            Self::Json => wire::json(set, &mut bytes),
            Self::Text => wire::text(set, &mut bytes),
            Self::Xml => wire::xml(set, &mut bytes),
            Self::Binary => wire::binary(set, &mut bytes),
            Self::Event => {
                bytes.extend_from_slice(format!("id: {}\ndata: ", event_id(set.run, set.frame)).as_bytes());
                let written = wire::json(set, &mut bytes);
                bytes.extend_from_slice(b"\n\n");
                written
            }
            Self::File(form) => return encode(form, set, Some(MAP), &mut bytes).ok().map(|()| bytes),
            Self::Estimate => {
                bytes.extend_from_slice(xr::document(set).as_bytes());
                Ok(())
            }
        };
        written.ok().map(|()| bytes)
    }
}

/// Returns the id of the server-sent event of `frame`, which a client sends as Last-Event-ID when it connects
/// again.
pub(super) fn event_id(run: &str, frame: u64) -> String {
    format!("{run}-{frame}")
}
