//! Parsers of YAML, JSON and XML to one tree of names, lists and scalars.

use super::{EXPECTED, Refusal, refuse};
use yaml_rust2::{Yaml, YamlLoader};

/// Largest accepted depth of nesting; lens files need five levels.
const MAX_DEPTH: usize = 24;

/// Largest accepted number of references to YAML anchors.
const MAX_ALIASES: usize = 16;

/// A value in the tree of a YAML, JSON or XML document.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Node {
    Map(Vec<(String, Node)>),
    List(Vec<Node>),
    Text(String),
}

impl Node {
    /// Returns the value of the first of `names` that this map has, without regard to case.
    pub fn get(&self, names: &[&str]) -> Option<&Self> {
        let Self::Map(entries) = self else { return None };
        let find = |name: &&str| entries.iter().find(|(key, _)| key.eq_ignore_ascii_case(name));
        names.iter().find_map(find).map(|(_, value)| value)
    }

    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text.trim()),
            _ => None,
        }
    }

    pub fn number(&self) -> Option<f64> {
        self.text()?.parse::<f64>().ok().filter(|v| v.is_finite())
    }

    /// Returns all numbers of a matrix, which may be a map with `data`, a list, a list of lists, or a text.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Self::Map(_) => self.get(&["data"])?.numbers(),
            Self::List(items) => {
                items.iter().map(Self::numbers).collect::<Option<Vec<_>>>().map(|v| v.concat())
            }
            Self::Text(text) => text
                .split([' ', ',', '\n', '\t', '\r'])
                .filter(|w| !w.is_empty())
                .map(|w| w.parse().ok())
                .collect(),
        }
    }
}

/// Parses YAML, of which JSON is a part, with OpenCV's directives and tags.
pub(super) fn from_yaml(text: &str) -> Result<Node, Refusal> {
    check_nesting(text)?;
    let lines = text.lines().filter(|line| !line.starts_with('%'));
    let plain: Vec<String> = lines.map(without_tags).collect();
    let documents = YamlLoader::load_from_str(&plain.join("\n"));
    let documents =
        documents.map_err(|e| (format!("neither TOML, YAML, JSON nor XML ({e})"), EXPECTED.into()))?;
    let node = documents.first().and_then(|document| node(document, 0));
    node.map_or_else(|| refuse("an empty file", EXPECTED), Ok)
}

/// Refuses texts whose nesting would overflow the stack of a recursive parser.
fn check_nesting(text: &str) -> Result<(), Refusal> {
    let (mut depth, mut deepest, mut aliases) = (0usize, 0usize, 0usize);
    for line in text.lines() {
        let indent = line.len() - line.trim_start().len();
        let words = line.split_whitespace();
        let indicators = words.clone().take_while(|w| matches!(*w, "-" | "?" | ":")).count();
        deepest = deepest.max(indent / 2 + indicators);
        aliases += words.filter(|w| w.trim_start_matches(['[', '{', ',', '-']).starts_with('*')).count();
        for byte in line.bytes() {
            match byte {
                b'[' | b'{' => depth += 1,
                b']' | b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            deepest = deepest.max(depth);
        }
    }
    if deepest <= MAX_DEPTH && aliases <= MAX_ALIASES {
        return Ok(());
    }
    refuse(
        format!("nesting of {deepest} and {aliases} references"),
        format!("at most {MAX_DEPTH} and {MAX_ALIASES}"),
    )
}

/// Removes YAML tags such as `!!opencv-matrix` from a line.
fn without_tags(line: &str) -> String {
    let Some((before, after)) = line.split_once("!!") else { return line.into() };
    let rest = after.trim_start_matches(|c: char| !c.is_whitespace());
    format!("{before}{}", without_tags(rest))
}

fn node(yaml: &Yaml, depth: usize) -> Option<Node> {
    if depth > MAX_DEPTH {
        return None;
    }
    let text = |v: &dyn ToString| Some(Node::Text(v.to_string()));
    match yaml {
        Yaml::Hash(hash) => {
            let entry = |(key, value): (&Yaml, &Yaml)| {
                Some((node(key, depth + 1)?.text()?.to_string(), node(value, depth + 1)?))
            };
            hash.iter().map(entry).collect::<Option<Vec<_>>>().map(Node::Map)
        }
        Yaml::Array(items) => {
            items.iter().map(|v| node(v, depth + 1)).collect::<Option<Vec<_>>>().map(Node::List)
        }
        Yaml::Integer(v) => text(v),
        Yaml::Real(v) | Yaml::String(v) => text(v),
        Yaml::Boolean(v) => text(v),
        Yaml::Null => text(&""),
        Yaml::Alias(_) | Yaml::BadValue => None,
    }
}

/// Parses XML: elements with children become maps, other elements texts.
pub(super) fn from_xml(text: &str) -> Result<Node, Refusal> {
    let options = roxmltree::ParsingOptions { allow_dtd: false, nodes_limit: 10_000, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(text, options);
    let document = document.map_err(|e| (format!("XML that does not parse ({e})"), EXPECTED.into()))?;
    element(document.root_element(), 0).map_or_else(|| refuse("XML nested too deeply", EXPECTED), Ok)
}

fn element(from: roxmltree::Node<'_, '_>, depth: usize) -> Option<Node> {
    if depth > MAX_DEPTH {
        return None;
    }
    let mut children = from.children().filter(roxmltree::Node::is_element).peekable();
    if children.peek().is_none() {
        return Some(Node::Text(from.text().unwrap_or_default().into()));
    }
    let entries =
        children.map(|child| Some((child.tag_name().name().to_string(), element(child, depth + 1)?)));
    entries.collect::<Option<Vec<_>>>().map(Node::Map)
}
