//! Sets and restores the links and pad formats of a route.

mod routing;

use super::abi;
use super::bus;
use super::graph::{Graph, Link, Pad};
use super::locate::Located;
use super::route::Route;
use crate::v4l2::Size;
use crate::v4l2::abi::{Format, FormatDescription, PadFormat, PadSize, PixelFormat};
use crate::v4l2::access;
use crate::v4l2::{Call, CameraError, Kernel, Node, persist};
use routing::RoutesBefore;
use std::path::PathBuf;

/// Largest number of pixel formats that are read from a node.
const MOST_FORMATS: u32 = 64;

/// A link and whether it was enabled before the change.
#[derive(Clone, Copy, Debug)]
struct Before {
    setup: abi::LinkSetup,
}

/// A pad and its format before the change.
struct PadBefore {
    pad: Pad,
    format: PadFormat,
}

/// The open sub-device of an entity on the route.
struct Open {
    entity: usize,
    node: Box<dyn Node>,
}

/// The changed links and formats of a route; dropping it restores their former state.
pub(in crate::v4l2) struct Wiring {
    path: PathBuf,
    media: Box<dyn Node>,
    graph: Graph,
    sensor: usize,
    route: Route,
    subdevices: Vec<Open>,
    links: Vec<Before>,
    pads: Vec<PadBefore>,
    routes: Vec<RoutesBefore>,
    /// Links that branch off the route and cannot be disabled.
    branches: Vec<Link>,
    /// The capture nodes at the end of the route and of its branches, with their formats.
    videos: Vec<Video>,
}

/// A capture node that is opened in addition to the one of the stream, with its former format.
struct Video {
    entity: Option<usize>,
    node: Box<dyn Node>,
    before: Format,
}

impl Wiring {
    /// Sets the links for a route: disables the links that compete with the route and enables its own links.
    ///
    /// # Errors
    /// [`CameraError`] that names the link that could not be set; the changes so far are restored.
    pub fn new(kernel: &mut dyn Kernel, located: &Located, route: &Route) -> Result<Self, CameraError> {
        let Located { path, graph, sensor, .. } = located;
        let media = access::open(kernel, path)?;
        let subdevices = open_subdevices(kernel, graph, route)?;
        let (links, pads) = (Vec::new(), Vec::new());
        let mut wiring = Self {
            path: path.clone(),
            media,
            graph: graph.clone(),
            sensor: *sensor,
            route: route.clone(),
            subdevices,
            links,
            pads,
            routes: Vec::new(),
            branches: Vec::new(),
            videos: Vec::new(),
        };
        for at in route.rivals(graph, *sensor) {
            wiring.switch(at, false)?;
        }
        for at in route.missing(graph) {
            wiring.switch(at, true)?;
        }
        wiring.open_branches(kernel);
        wiring.note_pads();
        wiring.set_routes()?;
        Ok(wiring)
    }

    /// Opens the entities at the ends of the route's branches; entities that cannot be opened are left unchanged.
    fn open_branches(&mut self, kernel: &mut dyn Kernel) {
        self.branches = self.route.branches(&self.graph).iter().map(|at| self.graph.links[*at]).collect();
        for link in self.branches.clone() {
            let entity = link.sink.entity;
            let Some(found) = self.graph.entities.get(entity) else { continue };
            let is_video = found.is_video();
            let node = found
                .device
                .and_then(|device| kernel.node_of(device))
                .map(|path| access::open(kernel, &path));
            match node {
                Some(Ok(node)) if is_video => self.keep_of(Some(entity), node),
                Some(Ok(node)) => self.subdevices.push(Open { entity, node }),
                _ => {}
            }
        }
    }

    /// Stores the node `video` and its present format, which is restored on drop.
    pub fn keep(&mut self, video: Box<dyn Node>) {
        self.keep_of(None, video);
    }

    fn keep_of(&mut self, entity: Option<usize>, mut node: Box<dyn Node>) {
        let mut before = Format::default();
        if persist(|| node.call(Call::GetFormat(&mut before))).is_ok() {
            self.videos.push(Video { entity, node, before });
        }
    }

    /// Sets the entities at the ends of the branches to the formats of the branching links, if the entities
    /// accept them.
    fn set_branches(&mut self) {
        for link in self.branches.clone() {
            let Some(format) = self.get(link.source) else { continue };
            if self.node(link.sink).is_some() {
                let _ = self.set(link.sink, format);
            } else if let Some(video) = self.videos.iter_mut().find(|v| v.entity == Some(link.sink.entity)) {
                set_video(video.node.as_mut(), &format);
            }
        }
    }

    /// Returns the readable media bus codes that the sensor offers, the most preferred first.
    pub fn codes(&mut self) -> Vec<u32> {
        let Some(link) = self.first() else { return Vec::new() };
        bus::ranked(&self.offered(link))
    }

    /// Sets the format of each pad of the route, from the sensor on, and returns the format at the capture
    /// node.
    ///
    /// # Errors
    /// [`CameraError`] that names the pad that did not accept the format.
    pub fn set_formats(&mut self, code: u32, size: Size) -> Result<PadFormat, CameraError> {
        let Some(first) = self.first() else { return Err(self.unfit("the graph", "no link", "a route")) };
        let wished = PadFormat { code, width: size.width, height: size.height, ..Default::default() };
        let mut carried = self.set(first, wished)?;
        let is_size = Size::new(carried.width, carried.height) == size;
        if carried.code != code
            || carried.width == 0
            || carried.height == 0
            || (!is_size && self.has_size(first, &wished))
        {
            return Err(self.mismatch(first, &carried, &wished));
        }
        self.set_embedded()?;
        let links: Vec<_> = self.route.links(&self.graph).copied().collect();
        for (at, link) in links.iter().enumerate() {
            if self.node(link.sink).is_some() {
                self.set_exactly(link.sink, carried)?;
            }
            let Some(next) = links.get(at + 1).filter(|next| self.node(next.source).is_some()) else {
                continue;
            };
            carried.code = self.passed_on(next.source, carried.code);
            carried = self.set_exactly(next.source, carried)?;
        }
        self.set_branches();
        Ok(carried)
    }

    /// Returns whether a pad lists the frame size of `format`.
    fn has_size(&mut self, pad: Pad, format: &PadFormat) -> bool {
        let Some(node) = self.node(pad) else { return false };
        let mut sizes = (0..MOST_FORMATS).map_while(|index| {
            let mut d = PadSize { index, pad: pad.index, code: format.code, ..Default::default() };
            persist(|| node.call(Call::EnumPadSizes(&mut d))).ok().map(|()| d.size)
        });
        let [width, height] = [format.width, format.height];
        sizes.any(|size| size == [width, width, height, height])
    }

    /// Returns the sensor's pad on the route.
    fn first(&self) -> Option<Pad> {
        self.route.links(&self.graph).next().map(|link| link.source)
    }

    /// Copies the formats of the sensor's pads of embedded data to the bridge: streams start only if both ends of a link agree.
    fn set_embedded(&mut self) -> Result<(), CameraError> {
        let first = self.first();
        let others =
            self.graph.links.iter().filter(|l| l.source.entity == self.sensor && Some(l.source) != first);
        let linked: Vec<_> = others.filter(|l| l.enabled).copied().collect();
        for link in linked {
            if self.node(link.sink).is_none() {
                continue;
            }
            if let Some(format) = self.get(link.source) {
                self.set_exactly(link.sink, format)?;
            }
        }
        Ok(())
    }

    /// Returns the media bus code in which a bridge's source pad forwards samples of `code`: `code` itself if the pad supports it, else
    /// the best readable one.
    fn passed_on(&mut self, pad: Pad, code: u32) -> u32 {
        let offered = self.offered(pad);
        if offered.is_empty() || offered.contains(&code) {
            return code;
        }
        let present = self.get(pad).map(|format| format.code).filter(|code| bus::is_read(*code));
        present.or_else(|| bus::ranked(&offered).first().copied()).unwrap_or(code)
    }

    fn offered(&mut self, pad: Pad) -> Vec<u32> {
        self.node(pad).map_or_else(Vec::new, |node| bus::offered(node, pad.index))
    }

    fn node(&mut self, pad: Pad) -> Option<&mut dyn Node> {
        let open = self.subdevices.iter_mut().find(|open| open.entity == pad.entity)?;
        Some(open.node.as_mut())
    }

    fn get(&mut self, pad: Pad) -> Option<PadFormat> {
        let mut format = PadFormat { pad: pad.index, ..Default::default() };
        let node = self.node(pad)?;
        persist(|| node.call(Call::GetPadFormat(&mut format))).ok()?;
        Some(format)
    }

    fn set(&mut self, pad: Pad, format: PadFormat) -> Result<PadFormat, CameraError> {
        let mut format = PadFormat { pad: pad.index, ..format };
        let wished = told(&format);
        let Some(node) = self.node(pad) else { return Ok(format) };
        let outcome = persist(|| node.call(Call::SetPadFormat(&mut format)));
        outcome.map_err(|e| self.unfit(&format!("pad {}", self.graph.name(pad)), &e.to_string(), &wished))?;
        Ok(format)
    }

    /// Sets the format of a pad; returns an error if the driver changes the format.
    fn set_exactly(&mut self, pad: Pad, format: PadFormat) -> Result<PadFormat, CameraError> {
        let got = self.set(pad, format)?;
        let same = (got.code, got.width, got.height) == (format.code, format.width, format.height);
        if same { Ok(got) } else { Err(self.mismatch(pad, &got, &format)) }
    }

    fn mismatch(&self, pad: Pad, found: &PadFormat, expected: &PadFormat) -> CameraError {
        self.unfit(&format!("pad {}", self.graph.name(pad)), &told(found), &told(expected))
    }

    fn unfit(&self, place: &str, found: &str, expected: &str) -> CameraError {
        let path = PathBuf::from(format!("{}, {place}", self.path.display()));
        CameraError::Unfit { path, found: found.into(), expected: expected.into() }
    }

    /// Enables or disables the link whose index in the graph is `at`.
    fn switch(&mut self, at: usize, on: bool) -> Result<(), CameraError> {
        let Some(link) = self.graph.links.get(at).copied() else { return Ok(()) };
        let end = |pad: Pad, flags| abi::LinkEnd {
            entity: self.graph.entities.get(pad.entity).map_or(0, |e| e.id),
            index: u16::try_from(pad.index).unwrap_or(u16::MAX),
            flags,
            ..Default::default()
        };
        let (source, sink) = (end(link.source, abi::PAD_SOURCE), end(link.sink, abi::PAD_SINK));
        let flags = |on| if on { abi::LINK_ENABLED } else { 0 };
        let mut setup = abi::LinkSetup { source, sink, flags: flags(on), ..Default::default() };
        persist(|| self.media.call(Call::SetupLink(&mut setup))).map_err(|e| {
            let place = format!("link {} -> {}", self.graph.name(link.source), self.graph.name(link.sink));
            self.unfit(
                &place,
                &e.to_string(),
                if on { "a link that can be switched on" } else { "a link that can be switched off" },
            )
        })?;
        self.graph.links[at].enabled = on;
        self.links
            .push(Before { setup: abi::LinkSetup { source, sink, flags: flags(!on), ..Default::default() } });
        Ok(())
    }

    /// Stores the formats of all pads whose formats may be changed, from the sensor on.
    fn note_pads(&mut self) {
        let on_route: Vec<usize> = self.subdevices.iter().map(|open| open.entity).collect();
        let linked = self.graph.links.iter().filter(|l| on_route.contains(&l.source.entity));
        let ours = self.route.links(&self.graph).flat_map(|l| [l.source, l.sink]);
        let embedded = linked.filter(|l| l.source.entity == self.sensor).flat_map(|l| [l.source, l.sink]);
        let branches = self.branches.iter().flat_map(|l| [l.source, l.sink]);
        let mut pads: Vec<Pad> =
            ours.chain(embedded).chain(branches).filter(|pad| on_route.contains(&pad.entity)).collect();
        let mut seen = std::collections::HashSet::new();
        pads.retain(|pad| seen.insert(*pad));
        for pad in pads {
            if let Some(format) = self.get(pad) {
                self.pads.push(PadBefore { pad, format });
            }
        }
    }
}

impl Drop for Wiring {
    fn drop(&mut self) {
        for Video { node, before, .. } in &mut self.videos {
            let _ = persist(|| node.call(Call::SetFormat(before)));
        }
        self.restore_routes();
        for PadBefore { pad, format } in std::mem::take(&mut self.pads) {
            let _ = self.set(pad, format);
        }
        for Before { mut setup } in std::mem::take(&mut self.links).into_iter().rev() {
            let _ = persist(|| self.media.call(Call::SetupLink(&mut setup)));
        }
    }
}

/// Sets a capture node that does not stream to `format`, the format of the pad at its link.
fn set_video(node: &mut dyn Node, format: &PadFormat) {
    let mut fourccs = (0..MOST_FORMATS).map_while(|index| {
        let mut d = FormatDescription { index, mbus_code: format.code, ..Default::default() };
        persist(|| node.call(Call::EnumFormats(&mut d))).ok().map(|()| d.fourcc)
    });
    let Some(fourcc) = fourccs.find(|fourcc| bus::fits(format.code, *fourcc)) else { return };
    let pixel = PixelFormat { width: format.width, height: format.height, fourcc, ..Default::default() };
    let mut format = Format { pixel, ..Default::default() };
    let _ = persist(|| node.call(Call::SetFormat(&mut format)));
}

/// Describes a pad's format for an error message.
fn told(format: &PadFormat) -> String {
    format!("{} x {} of media bus code 0x{:04x}", format.width, format.height, format.code)
}

fn open_subdevices(kernel: &mut dyn Kernel, graph: &Graph, route: &Route) -> Result<Vec<Open>, CameraError> {
    let mut found: Vec<Open> = Vec::new();
    for link in route.links(graph) {
        let entity = link.source.entity;
        let Some(device) = graph.entities.get(entity).and_then(|e| e.device) else { continue };
        let Some(path) = kernel.node_of(device) else { continue };
        found.push(Open { entity, node: access::open(kernel, &path)? });
    }
    Ok(found)
}
