//! The colour layers of an OpenEXR file, and the selection of one of them.

use super::super::Refusal;
use exr::meta::header::Header;

/// Largest number of layer names that an error message lists.
const MAX_NAMES: usize = 12;

/// A colour layer: three channels of one part with a common prefix, or one channel that is used for all three.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    /// Index of the part that contains the layer.
    pub part: usize,
    /// Name of the part, and of the layer within the part; empty for channels without a prefix in a part without a name.
    pub name: String,
    /// Indices of the channels for red, green and blue in the part.
    pub channels: [usize; 3],
    /// True for a layer with a luminance channel alone.
    is_grey: bool,
    /// True if the channels of the layer have no prefix.
    is_root: bool,
    /// True if the file has other colour layers.
    pub is_one_of_several: bool,
}

/// Returns the colour layer called `name`; without a name, the only layer or the one without a name.
pub(super) fn choose(headers: &[Header], name: Option<&str>) -> Result<Layer, Refusal> {
    let all: Vec<Layer> = headers.iter().enumerate().flat_map(|(part, h)| of_part(part, h)).collect();
    let has_colour = all.iter().any(|l| !l.is_grey);
    let usable = |l: &&Layer| name.is_some() || !has_colour || !l.is_grey;
    let mut candidates: Vec<&Layer> = all.iter().filter(usable).collect();
    let count = candidates.len();
    if let Some(name) = name {
        candidates.retain(|l| l.name == name || l.name.ends_with(&format!(".{name}")));
        if let Some(exact) = candidates.iter().position(|l| l.name == name) {
            candidates = vec![candidates[exact]];
        }
    } else if count > 1 && candidates.iter().filter(|l| l.is_root).count() == 1 {
        candidates.retain(|l| l.is_root);
    }
    match candidates[..] {
        [only] => Ok(Layer { is_one_of_several: count > 1, ..only.clone() }),
        [] if all.is_empty() => Err(no_colour(headers)),
        [] => {
            let found = format!("no layer {:?} among {}", name.unwrap_or_default(), names(&all));
            Err(Refusal::new(found, "--layer with the name of a colour layer"))
        }
        _ => Err(Refusal::new(
            format!("several colour layers: {}", names(candidates)),
            "--layer with one of these names",
        )),
    }
}

fn names<'a>(layers: impl IntoIterator<Item = &'a Layer>) -> String {
    let names =
        layers.into_iter().map(|l| if l.name.is_empty() { "(unnamed)".into() } else { l.name.clone() });
    listed(names)
}

fn listed(names: impl Iterator<Item = String>) -> String {
    let mut names: Vec<String> = names.collect();
    let more = names.len().saturating_sub(MAX_NAMES);
    names.truncate(MAX_NAMES);
    let list = names.join(", ");
    if more > 0 { format!("{list} and {more} more") } else { list }
}

/// Returns the refusal of a file without a colour layer.
fn no_colour(headers: &[Header]) -> Refusal {
    let channels = headers.iter().flat_map(|h| h.channels.list.iter().map(|c| c.name.to_string()));
    let deep = if headers.iter().any(|h| h.deep) { "deep data, " } else { "" };
    Refusal::new(
        format!("{deep}channels {}", listed(channels)),
        "a flat layer with channels R, G and B, or Y alone",
    )
}

/// Returns the colour layers of the part with the index `part`.
fn of_part(part: usize, header: &Header) -> Vec<Layer> {
    if header.deep {
        return Vec::new();
    }
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let mut prefixes: Vec<&str> = names.iter().map(|n| split(n).0).collect();
    prefixes.sort_unstable();
    prefixes.dedup();
    let part_name = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let layer = |prefix: &str| {
        let find =
            |wanted: &[&str]| names.iter().position(|n| split(n).0 == prefix && wanted.contains(&split(n).1));
        let colour = [&["R", "r", "red", "Red"], &["G", "g", "green", "Green"], &["B", "b", "blue", "Blue"]]
            .map(|w| find(w));
        // Y with X or Z is a position or a normal; Y with RY or BY is the luminance of chroma-subsampled colours.
        let is_luminance = find(&["X", "x", "Z", "z", "RY", "BY"]).is_none();
        let grey = find(&["Y", "y"]).filter(|_| is_luminance);
        let (channels, is_grey) = match (colour, grey) {
            ([Some(r), Some(g), Some(b)], _) => ([r, g, b], false),
            ([None, None, None], Some(y)) => ([y; 3], true),
            _ => return None,
        };
        let name = match (part_name.as_str(), prefix) {
            ("", prefix) => prefix.to_string(),
            (part, "") => part.to_string(),
            (part, prefix) if prefix.starts_with(part) => prefix.to_string(),
            (part, prefix) => format!("{part}.{prefix}"),
        };
        Some(Layer { part, name, channels, is_grey, is_root: prefix.is_empty(), is_one_of_several: false })
    };
    prefixes.into_iter().filter_map(layer).collect()
}

/// Splits the full name of a channel into the names of layer and channel.
fn split(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or(("", name))
}
