//! The graph of a media device: entities, their device nodes, and the links between their pads.
//!
//! Answers of drivers are checked: entries with unknown numbers and pads in the wrong direction are left out.

use super::abi;
use crate::v4l2::text;
use std::collections::HashMap;

/// Largest number of entities, interfaces, pads or links that are read: several times those of the largest known graphs.
pub const MOST: u32 = 1024;

/// The entries of a media device as its driver returns them.
#[derive(Clone, Debug, Default)]
pub struct Topology {
    /// Entities of the device.
    pub entities: Vec<abi::Entity>,
    /// Device nodes of the entities.
    pub interfaces: Vec<abi::Interface>,
    /// Pads of the entities.
    pub pads: Vec<abi::Pad>,
    /// Links from pad to pad, and from interface to entity.
    pub links: Vec<abi::Link>,
}

/// Major and minor number of a character device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Device {
    /// Major number of the device.
    pub major: u32,
    /// Minor number of the device.
    pub minor: u32,
}

/// An entity of a media graph: a sensor, a bridge or a capture node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entity {
    /// Number of the entity in the driver.
    pub id: u32,
    /// Name of the entity.
    pub name: String,
    /// Function of the entity, a constant `MEDIA_ENT_F_...` of the kernel.
    pub function: u32,
    /// Device node of the entity, if it has one.
    pub device: Option<Device>,
}

impl Entity {
    /// Returns whether the entity is a camera's sensor.
    #[must_use]
    pub const fn is_sensor(&self) -> bool {
        self.function == abi::SENSOR
    }

    /// Returns whether the entity is a node for video input or output.
    #[must_use]
    pub const fn is_video(&self) -> bool {
        self.function == abi::VIDEO
    }
}

/// A pad of an entity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pad {
    /// Index of the entity of the pad among the entities of the graph.
    pub entity: usize,
    /// Number of the pad in its entity.
    pub index: u32,
}

/// A link between two pads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// Source pad of the link.
    pub source: Pad,
    /// Sink pad of the link.
    pub sink: Pad,
    /// Whether the link is enabled.
    pub enabled: bool,
    /// Whether the link cannot be changed.
    pub immutable: bool,
}

/// The graph of a media device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Graph {
    /// Entities of the graph.
    pub entities: Vec<Entity>,
    /// Links of the graph.
    pub links: Vec<Link>,
}

impl Graph {
    /// Builds the graph from the entries that a driver returned.
    #[must_use]
    pub fn of(topology: &Topology) -> Self {
        let mut graph = Self::default();
        let mut numbers = HashMap::new();
        for entity in &topology.entities {
            if numbers.contains_key(&entity.id) {
                continue;
            }
            numbers.insert(entity.id, graph.entities.len());
            let (id, name, function) = (entity.id, text(&entity.name), entity.function);
            graph.entities.push(Entity { id, name, function, device: None });
        }
        let pads: HashMap<u32, (Pad, u32)> = topology
            .pads
            .iter()
            .filter_map(|pad| {
                let entity = *numbers.get(&pad.entity)?;
                Some((pad.id, (Pad { entity, index: pad.index }, pad.flags)))
            })
            .collect();
        for link in &topology.links {
            match link.flags & abi::LINK_TYPE {
                abi::LINK_DATA => graph.links.extend(data_link(link, &pads)),
                abi::LINK_INTERFACE => graph.note_device(topology, link, &numbers),
                _ => {}
            }
        }
        graph
    }

    fn note_device(&mut self, topology: &Topology, link: &abi::Link, numbers: &HashMap<u32, usize>) {
        let interface = topology.interfaces.iter().find(|i| i.id == link.source);
        let entity = numbers.get(&link.sink).and_then(|at| self.entities.get_mut(*at));
        if let (Some(interface), Some(entity)) = (interface, entity) {
            let [major, minor] = interface.device;
            entity.device = Some(Device { major, minor });
        }
    }

    /// Returns the indices of the sensors among the graph's entities.
    pub fn sensors(&self) -> impl Iterator<Item = usize> {
        let is_sensor = |at: &usize| self.entities.get(*at).is_some_and(Entity::is_sensor);
        (0..self.entities.len()).filter(is_sensor)
    }

    /// Returns the name of a pad: the name of its entity and its number.
    #[must_use]
    pub fn name(&self, pad: Pad) -> String {
        format!("{}:{}", self.entities.get(pad.entity).map_or("?", |e| &e.name), pad.index)
    }
}

fn data_link(link: &abi::Link, pads: &HashMap<u32, (Pad, u32)>) -> Option<Link> {
    let (source, from) = *pads.get(&link.source)?;
    let (sink, to) = *pads.get(&link.sink)?;
    let directed = from & abi::PAD_SOURCE != 0 && to & abi::PAD_SINK != 0 && source.entity != sink.entity;
    let (enabled, immutable) = (link.flags & abi::LINK_ENABLED != 0, link.flags & abi::LINK_IMMUTABLE != 0);
    directed.then_some(Link { source, sink, enabled, immutable })
}
