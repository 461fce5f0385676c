//! Media devices of the scripted kernel, described as `media-ctl` prints them.
//!
//! A bridge copies the format of a sink pad to the source pads that belong to it, and pads keep the format that is set. A stream starts
//! only if both ends of each link agree, and delivers frames only if no other linked node waits for a buffer, as in the drivers of the Pi.

use super::World;
use crate::v4l2::abi::{PadFormat, PadRoute, PadSelection, ROUTE_ACTIVE};
use crate::v4l2::media::abi::{self, LinkSetup};
use crate::v4l2::media::{Device, Topology};
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Major number of all device nodes of the scripted kernel.
pub const MAJOR: u32 = 81;

/// A sensor's mode: picture size, and the part of the sensor that it shows.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    pub size: (u32, u32),
    pub crop: [u32; 4],
}

/// Reaction of a pad of a scripted media device that does not accept formats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PadFault {
    /// The pad keeps a size of 640 x 480.
    Size,
    /// The pad keeps its media bus code.
    Code,
    /// The request to set the format fails with EINVAL.
    Refused,
}

/// A scripted media device.
#[derive(Clone, Debug)]
pub struct Described {
    /// Lines `NAME:PAD -> NAME:PAD [FLAGS]`, flags `on` and `fixed`.
    pub links: &'static str,
    /// Source pads of a bridge that a sink pad feeds, as (sink, source).
    pub inner: Vec<(u32, u32)>,
    /// Media bus codes that the sensors offer.
    pub codes: Vec<u32>,
    pub modes: Vec<Mode>,
    /// Rectangle of all pixels of the sensor; none if the driver reports no selections.
    pub native: Option<[u32; 4]>,
    /// A pad, as `NAME:PAD`, that does not accept formats, and its reaction.
    pub fault: Option<(&'static str, PadFault)>,
    /// Active routes of the bridge, as (sink, source); none if its driver has no streams.
    pub routes: Option<Vec<(u32, u32)>>,
    /// True if the driver refuses other routes.
    pub fixed_routes: bool,
    /// Minor number of the first device node of the media device.
    pub first_node: u32,
}

#[derive(Clone, Debug)]
struct FakeLink {
    source: (usize, u32),
    sink: (usize, u32),
    flags: u32,
}

/// A scripted media device with its present links, formats and routes.
#[derive(Clone, Debug)]
pub struct Board {
    pub described: Described,
    names: Vec<String>,
    links: Vec<FakeLink>,
    pads: BTreeMap<(usize, u32), PadFormat>,
}

fn is_sensor(name: &str) -> bool {
    name.starts_with("imx") || name.starts_with("ov")
}

/// Returns whether an entity is a node: nodes are named after their driver.
fn is_node(name: &str) -> bool {
    name.starts_with("rp1-cfe") || name.starts_with("unicam")
}

/// Returns the format of a line of embedded data for pictures of `format`.
fn embedded(format: &PadFormat) -> PadFormat {
    PadFormat { height: 1, code: 0x7002, pad: 1, ..*format }
}

impl Board {
    pub fn new(described: Described) -> Self {
        let (mut names, mut links): (Vec<String>, _) = (Vec::new(), Vec::new());
        for line in described.links.lines().map(str::trim).filter(|l| !l.is_empty()) {
            let (ends, flags) = line.split_once('[').expect("flags");
            let (from, to) = ends.split_once("->").expect("a link");
            let mut pad = |text: &str| {
                let (name, index) = text.trim().rsplit_once(':').expect("a pad");
                let at = names.iter().position(|n| n == name).unwrap_or_else(|| {
                    names.push(name.into());
                    names.len() - 1
                });
                (at, index.parse().expect("a number"))
            };
            let (source, sink) = (pad(from), pad(to));
            let flag = |name, bit| if flags.contains(name) { bit } else { 0 };
            let flags = flag("on", abi::LINK_ENABLED) | flag("fixed", abi::LINK_IMMUTABLE);
            links.push(FakeLink { source, sink, flags });
        }
        let start = PadFormat { width: 640, height: 480, code: 0x3014, ..Default::default() };
        let ends = links.iter().flat_map(|l| [l.source, l.sink]);
        let mut pads: BTreeMap<_, _> = ends.map(|pad| (pad, PadFormat { pad: pad.1, ..start })).collect();
        for (_, format) in pads.iter_mut().filter(|(pad, _)| is_sensor(&names[pad.0]) && pad.1 > 0) {
            *format = embedded(format);
        }
        Self { described, names, links, pads }
    }

    /// Returns the flags of all links and the formats of all pads of the media device, for comparison.
    pub fn state(&self) -> (Vec<u32>, Vec<(u32, u32, u32)>) {
        let pads = self.pads.values().map(|p| (p.code, p.width, p.height));
        (self.links.iter().map(|l| l.flags).collect(), pads.collect())
    }

    pub fn device(&self, entity: usize) -> Device {
        Device { major: MAJOR, minor: self.described.first_node + entity as u32 }
    }

    /// Returns the entity of the media device whose node is `device`.
    pub fn entity(&self, device: Device) -> Option<usize> {
        (0..self.names.len()).find(|at| self.device(*at) == device)
    }

    /// Returns the path of the node of `entity`. Video nodes and sub-devices share one sequence of numbers.
    pub fn path(&self, entity: usize) -> PathBuf {
        let number = self.device(entity).minor;
        let kind = if is_node(&self.names[entity]) { "video" } else { "v4l-subdev" };
        format!("/dev/{kind}{number}").into()
    }

    pub fn entities(&self) -> usize {
        self.names.len()
    }

    pub fn is_node(&self, entity: usize) -> bool {
        is_node(&self.names[entity])
    }

    pub fn is_sensor(&self, entity: usize) -> bool {
        is_sensor(&self.names[entity])
    }

    /// Returns whether the node of `entity` delivers pictures; nodes of embedded data and statistics do not.
    pub fn gives_pictures(&self, entity: usize) -> bool {
        self.is_node(entity) && !self.names[entity].contains("embedded")
    }

    pub fn topology(&self, topology: &mut Topology) {
        for (at, name) in self.names.iter().enumerate() {
            let mut entity = abi::Entity { id: at as u32 + 1, ..Default::default() };
            entity.name[..name.len()].copy_from_slice(name.as_bytes());
            entity.function = match () {
                () if is_sensor(name) => abi::SENSOR,
                () if is_node(name) => abi::VIDEO,
                () => 0x5002,
            };
            topology.entities.push(entity);
            let Device { major, minor } = self.device(at);
            let interface = 500 + at as u32;
            topology.interfaces.push(abi::Interface {
                id: interface,
                device: [major, minor],
                ..Default::default()
            });
            topology.links.push(abi::Link {
                id: 900 + at as u32,
                source: interface,
                sink: at as u32 + 1,
                flags: abi::LINK_INTERFACE | abi::LINK_ENABLED,
                ..Default::default()
            });
        }
        let id = |(entity, pad): (usize, u32)| 100 + 16 * entity as u32 + pad;
        for (entity, pad) in self.pads.keys() {
            let is_source = self.links.iter().any(|l| l.source == (*entity, *pad));
            let flags = if is_source { abi::PAD_SOURCE } else { abi::PAD_SINK };
            let pad = abi::Pad {
                id: id((*entity, *pad)),
                entity: *entity as u32 + 1,
                flags,
                index: *pad,
                ..Default::default()
            };
            topology.pads.push(pad);
        }
        for (at, link) in self.links.iter().enumerate() {
            topology.links.push(abi::Link {
                id: 700 + at as u32,
                source: id(link.source),
                sink: id(link.sink),
                flags: link.flags,
                ..Default::default()
            });
        }
    }

    pub fn set_link(&mut self, setup: &LinkSetup) -> Result<(), Errno> {
        let end = |e: &abi::LinkEnd| (e.entity as usize - 1, u32::from(e.index));
        let (source, sink) = (end(&setup.source), end(&setup.sink));
        let on = |l: &FakeLink| l.flags & abi::LINK_ENABLED != 0;
        // A sink pad has one source.
        let taken = self.links.iter().any(|l| on(l) && l.sink == sink && l.source != source);
        let link =
            self.links.iter_mut().find(|l| l.source == source && l.sink == sink).ok_or(Errno::INVAL)?;
        let wanted = setup.flags & abi::LINK_ENABLED;
        match () {
            () if wanted == link.flags & abi::LINK_ENABLED => Ok(()),
            () if link.flags & abi::LINK_IMMUTABLE != 0 => Err(Errno::INVAL),
            () if wanted != 0 && taken => Err(Errno::BUSY),
            () => {
                link.flags = link.flags & !abi::LINK_ENABLED | wanted;
                Ok(())
            }
        }
    }

    fn name(&self, (entity, pad): (usize, u32)) -> String {
        format!("{}:{pad}", self.names[entity])
    }

    /// Returns the scripted fault of a pad.
    pub fn fault_of(&self, pad: (usize, u32)) -> Option<PadFault> {
        self.described.fault.filter(|(name, _)| *name == self.name(pad)).map(|(_, fault)| fault)
    }

    /// Returns the pads of the bridge that are connected inside it, as (sink, source).
    fn inner(&self) -> Vec<(u32, u32)> {
        self.described.routes.clone().unwrap_or_else(|| self.described.inner.clone())
    }

    /// Returns whether a stream passes a pad: in drivers with streams, source pads have one if a route leads to
    /// them.
    fn is_routed(&self, (entity, pad): (usize, u32)) -> bool {
        let is_source = self.links.iter().any(|l| l.source == (entity, pad));
        let has_routes = self.described.routes.is_some() && self.names[entity] == "csi2";
        !is_source || !has_routes || self.inner().iter().any(|(_, source)| *source == pad)
    }

    pub fn get_routes(&self, entity: usize, routes: &mut Vec<PadRoute>) -> Result<(), Errno> {
        let active = self.described.routes.as_ref().filter(|_| self.names[entity] == "csi2");
        let route = |(sink_pad, source_pad): &(u32, u32)| PadRoute {
            sink_pad: *sink_pad,
            source_pad: *source_pad,
            flags: ROUTE_ACTIVE,
            ..Default::default()
        };
        *routes = active.ok_or(Errno::NOTTY)?.iter().map(route).collect();
        Ok(())
    }

    /// Sets the routes of an entity; all formats of the entity are reset, as in the kernel.
    pub fn set_routes(&mut self, entity: usize, routes: &mut [PadRoute]) -> Result<(), Errno> {
        let mut present = Vec::new();
        self.get_routes(entity, &mut present)?;
        let is_known = |r: &PadRoute| self.pads.contains_key(&(entity, r.source_pad));
        let pads = |all: &[PadRoute]| all.iter().map(|r| (r.sink_pad, r.source_pad)).collect::<Vec<_>>();
        if self.described.fixed_routes && pads(routes) != pads(&present) || !routes.iter().all(is_known) {
            return Err(Errno::INVAL);
        }
        self.described.routes = Some(pads(routes));
        for (_, pad) in self.pads.iter_mut().filter(|((at, _), _)| *at == entity) {
            (pad.width, pad.height, pad.code) = (640, 480, 0x3014);
        }
        Ok(())
    }

    pub fn get_pad(&self, entity: usize, format: &mut PadFormat) -> Result<(), Errno> {
        if !self.is_routed((entity, format.pad)) {
            return Err(Errno::INVAL);
        }
        *format = *self.pads.get(&(entity, format.pad)).ok_or(Errno::INVAL)?;
        Ok(())
    }

    pub fn set_pad(&mut self, entity: usize, format: &mut PadFormat) -> Result<(), Errno> {
        let pad = (entity, format.pad);
        if !self.pads.contains_key(&pad) {
            return Err(Errno::INVAL);
        }
        let fault = self.fault_of(pad);
        if fault == Some(PadFault::Refused) || !self.is_routed(pad) {
            return Err(Errno::INVAL);
        }
        let is_source = self.links.iter().any(|l| l.source == pad);
        if self.is_sensor(entity) {
            // The format of the pad of embedded data follows that of the picture's pad.
            if format.pad > 0 {
                return self.get_pad(entity, format);
            }
            let area = |m: &Mode| {
                (i64::from(m.size.0) * i64::from(m.size.1))
                    .abs_diff(i64::from(format.width) * i64::from(format.height))
            };
            let mode = self.described.modes.iter().min_by_key(|m| area(m)).expect("a mode");
            (format.width, format.height) = mode.size;
            if !self.described.codes.contains(&format.code) {
                format.code = self.described.codes[0];
            }
            let lines = embedded(format);
            self.pads.entry((entity, 1)).and_modify(|pad| *pad = lines);
        } else if is_source {
            // The output of a bridge has the format of its input.
            let fed = self.inner().into_iter().find(|(_, source)| *source == format.pad);
            let from = fed.and_then(|(sink, _)| self.pads.get(&(entity, sink)));
            (format.width, format.height) = from.map_or((640, 480), |f| (f.width, f.height));
        }
        match fault {
            Some(PadFault::Size) => (format.width, format.height) = (640, 480),
            Some(PadFault::Code) => format.code = 0x1234,
            _ => {}
        }
        self.pads.insert(pad, *format);
        if !is_source {
            let inner = self.inner().into_iter();
            let fed: Vec<u32> = inner.filter(|(sink, _)| *sink == format.pad).map(|(_, s)| s).collect();
            for source in fed {
                self.pads.entry((entity, source)).and_modify(|p| *p = PadFormat { pad: source, ..*format });
            }
        }
        Ok(())
    }

    pub fn select(&self, entity: usize, selection: &mut PadSelection) -> Result<(), Errno> {
        let native = self.described.native.filter(|_| self.is_sensor(entity)).ok_or(Errno::NOTTY)?;
        let format = self.pads[&(entity, 0)];
        let mode = self.described.modes.iter().find(|m| m.size == (format.width, format.height));
        selection.area = match selection.target {
            crate::v4l2::abi::SELECT_CROP => mode.ok_or(Errno::INVAL)?.crop,
            _ => native,
        };
        Ok(())
    }

    /// Returns the sensor's format if a stream of `node` may start.
    pub fn validate(&self, node: usize, size: (u32, u32)) -> Result<PadFormat, Errno> {
        let mut at = node;
        let mut first = true;
        loop {
            let into = |l: &&FakeLink| l.sink.0 == at && l.flags & abi::LINK_ENABLED != 0;
            if self.links.iter().filter(into).any(|l| !self.is_routed(l.source)) {
                return Err(Errno::NOLINK);
            }
            for link in self.links.iter().filter(into) {
                let source = self.pads[&link.source];
                let sink = if self.is_node(at) {
                    PadFormat { width: size.0, height: size.1, ..source }
                } else {
                    self.pads[&link.sink]
                };
                if (source.width, source.height, source.code) != (sink.width, sink.height, sink.code) {
                    return Err(Errno::PIPE);
                }
            }
            // A bridge forwards the input of its lowest pad.
            let Some(link) = self.links.iter().find(|l| into(l)) else {
                return if first { Err(Errno::PIPE) } else { Ok(self.pads[&(at, 0)]) };
            };
            (at, first) = (link.source.0, false);
        }
    }

    /// Returns whether a node that shares a link with `node` waits for a buffer.
    pub fn is_starved(&self, node: usize) -> bool {
        let on = |l: &&FakeLink| l.flags & abi::LINK_ENABLED != 0;
        let bridge = self.links.iter().filter(on).find(|l| l.sink.0 == node).map(|l| l.source.0);
        let is_other = |l: &FakeLink| Some(l.source.0) == bridge && l.sink.0 != node;
        self.links.iter().filter(on).any(|l| l.flags & abi::LINK_IMMUTABLE == 0 && is_other(l))
    }
}

impl World {
    /// Returns the board and the entity of a node.
    pub fn place(&self, device: Device) -> Option<(usize, usize)> {
        self.boards.iter().enumerate().find_map(|(at, board)| Some((at, board.entity(device)?)))
    }
}
