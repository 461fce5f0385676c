//! The parameters of a request for a light set: form, coordinates, number of lights, ambient light, discs.

use super::format::Format;
use crate::probe::settings::short;
use crate::probe::tiers::Selection;
use crate::samplers::MAX_LIGHTS;
use axum::extract::Query;
use axum::http::header::ACCEPT;
use axum::http::{HeaderMap, Uri};
use hemilux_core::wire::Coordinates;

/// The form, the coordinates and the contents of a requested light set. Requests with equal variants share the
/// encoded bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Variant {
    pub(super) format: Format,
    pub(super) coordinates: Coordinates,
    /// Number of lights, ambient light or not, discs or points.
    pub(super) selection: Selection,
}

impl Variant {
    pub(super) fn of(format: Format) -> Self {
        let selection = Selection { ambient: Some(false), ..Selection::OWN };
        Self { format, coordinates: Coordinates::Probe, selection }
    }
}

/// The query parameters of a request for a light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SetQuery {
    pub(super) variant: Variant,
    /// Frame number of the last light set that the client has received.
    pub(super) after: Option<u64>,
}

/// Parses the query of a request for a light set. `fixed` is the form of paths that have only one; otherwise the parameter `format` or
/// the Accept header selects it.
///
/// # Errors
/// The parameter that was found and the accepted ones; `None` if no form of a light set suits the Accept
/// header.
pub(super) fn wanted(
    uri: &Uri,
    headers: &HeaderMap,
    fixed: Option<Format>,
) -> Result<SetQuery, Option<String>> {
    let refused = |found: String| Some(format!("found {found}. Accepted:\n{}", accepted(fixed.is_none())));
    let Ok(Query(pairs)) = Query::<Vec<(String, String)>>::try_from_uri(uri) else {
        return Err(refused("a query that cannot be parsed".into()));
    };
    let mut wanted = SetQuery { variant: Variant::of(fixed.unwrap_or(Format::Json)), after: None };
    // A light estimate always contains spherical harmonics.
    wanted.variant.selection.ambient = Some(fixed == Some(Format::Estimate));
    let mut named = fixed.is_some();
    let mut axes = None;
    for (i, (name, value)) in pairs.iter().enumerate() {
        if pairs[..i].iter().any(|(n, _)| n == name) {
            return Err(refused(format!("parameter '{}' twice", short(name))));
        }
        let variant = &mut wanted.variant;
        let known = match name.as_str() {
            "format" if fixed.is_none() => {
                named = true;
                Format::from_name(value).map(|f| variant.format = f)
            }
            "coordinates" => Coordinates::from_name(value).map(|c| axes = Some(c)),
            "ambient" => switch(value).map(|a| variant.selection.ambient = a),
            "soft" => switch(value).map(|s| variant.selection.soft = s),
            "lights" => number(value).map(|n| variant.selection.lights = Some(n)),
            "after" => value.parse().ok().map(|n| wanted.after = Some(n)),
            _ => return Err(refused(format!("unknown parameter '{}'", short(name)))),
        };
        known.ok_or_else(|| refused(format!("{name} '{}'", short(value))))?;
    }
    if !named {
        wanted.variant.format = negotiated(headers).ok_or(None)?;
    }
    if !wanted.variant.format.has_ambient() {
        // The other forms have no ambient light: their lights contain all energy.
        wanted.variant.selection.ambient = Some(false);
    }
    wanted.variant.coordinates = match wanted.variant.format {
        Format::File(form) => form.axes(axes).map_err(|e| refused(e.to_string()))?,
        _ => axes.unwrap_or_default(),
    };
    Ok(wanted)
}

/// Parses the value of a switch: 1 (on), 0 (off), or `own` for the probe's own setting.
fn switch(value: &str) -> Option<Option<bool>> {
    match value {
        "1" => Some(Some(true)),
        "0" => Some(Some(false)),
        "own" => Some(None),
        _ => None,
    }
}

fn number(value: &str) -> Option<usize> {
    value.parse().ok().filter(|n| (1..=MAX_LIGHTS).contains(n))
}

/// Lists the query parameters of a light set and their values, one per line.
fn accepted(with_format: bool) -> String {
    let coordinates = Coordinates::names().collect::<Vec<_>>().join("|");
    let formats = Format::NAMED.map(|(name, _)| name).join("|");
    let format = if with_format { format!("format={formats}\n") } else { String::new() };
    format!(
        "{format}coordinates={coordinates}\nlights=1..{MAX_LIGHTS}\nambient=0|1|own\nsoft=0|1|own\nafter=FRAME"
    )
}

/// Returns the form of a light set that suits the Accept header best: JSON without the header, and for
/// browsers.
fn negotiated(headers: &HeaderMap) -> Option<Format> {
    let accept: Vec<_> = headers.get_all(ACCEPT).iter().filter_map(|v| v.to_str().ok()).collect();
    if accept.is_empty() {
        return Some(Format::Json);
    }
    let mut best = None;
    for range in accept.iter().flat_map(|v| v.split(',')) {
        let mut parts = range.split(';').map(str::trim);
        let kind = parts.next().unwrap_or_default().to_ascii_lowercase();
        let quality = parts.find_map(|p| p.strip_prefix("q=")).map_or(Some(1.0), |q| q.parse::<f32>().ok());
        let quality = quality.unwrap_or(0.0);
        let format = match kind.as_str() {
            "*/*" | "application/*" | "application/json" | "text/html" => Format::Json,
            "text/*" | "text/plain" => Format::Text,
            "application/xml" | "text/xml" => Format::Xml,
            "application/octet-stream" | "application/vnd.hemilux.lights" => Format::Binary,
            _ => continue,
        };
        if quality > best.map_or(0.0, |(q, _)| q) {
            best = Some((quality, format));
        }
    }
    best.map(|(_, format)| format)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn ask(query: &str) -> Result<SetQuery, Option<String>> {
        wanted(&format!("/v1/lights?{query}").parse().expect("a URI"), &HeaderMap::new(), None)
    }

    #[test]
    fn every_parameter_is_parsed() {
        let found =
            ask("format=binary&coordinates=unity&ambient=1&soft=1&lights=12&after=18446744073709551615");
        let variant = Variant {
            format: Format::Binary,
            coordinates: Coordinates::Unity,
            selection: Selection { lights: Some(12), ambient: Some(true), soft: Some(true) },
        };
        assert_eq!(found, Ok(SetQuery { variant, after: Some(u64::MAX) }), "all");
        assert_eq!(ask(""), Ok(SetQuery { variant: Variant::of(Format::Json), after: None }), "none");
        let axes = |query| ask(query).expect(query).variant.coordinates;
        assert_eq!(
            [axes("format=glb"), axes("format=rad")],
            [Coordinates::YUp, Coordinates::Probe],
            "native axes"
        );
        assert_eq!(axes("coordinates=probe&format=usda"), Coordinates::Probe, "in any order");
    }

    #[test]
    fn unknown_parameters_are_refused_with_the_accepted_ones() {
        for query in [
            "format=yaml",
            "coordinates=maya",
            "format=glb&coordinates=unity",
            "coordinates=unreal&format=usda",
            "ambient=yes",
            "soft=",
            "soft=2",
            "lights=0",
            "lights=50001",
            "lights=-1",
            "after=-1",
            "after=",
            "colour=red",
            "lights=3&lights=3",
            "after=%ff",
        ] {
            let text = ask(query).expect_err(query).expect("a reason");
            assert!(text.starts_with("found ") && text.contains("coordinates=probe|"), "{query}: {text}");
        }
    }

    #[test]
    fn the_accept_header_selects_the_form() {
        let chosen = |accept: &'static str| {
            let headers = [(ACCEPT, HeaderValue::from_static(accept))].into_iter().collect();
            negotiated(&headers)
        };
        for (accept, format) in [
            ("*/*", Some(Format::Json)),
            ("application/xml", Some(Format::Xml)),
            ("text/plain;q=0.5, application/xml;q=0.9", Some(Format::Xml)),
            ("text/plain, application/xml", Some(Format::Text)),
            ("application/octet-stream", Some(Format::Binary)),
            // Accept headers of browsers.
            ("text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8", Some(Format::Json)),
            ("image/png", None),
            ("application/json;q=0", None),
        ] {
            assert_eq!(chosen(accept), format, "{accept}");
        }
    }
}
