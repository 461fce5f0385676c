//! Finds the sensor and the capture node of a camera.

use super::graph::{Device, Graph, Topology};
use super::route::{Route, routes};
use crate::v4l2::access::{self, failed};
use crate::v4l2::options::Options;
use crate::v4l2::{Call, CameraError, Kernel, Node, persist};
use std::path::{Path, PathBuf};

/// A sensor of a media device, and its routes to nodes.
pub(in crate::v4l2) struct Located {
    /// Path of the media device.
    pub path: PathBuf,
    pub graph: Graph,
    /// Index of the sensor among the entities of the media device's graph.
    pub sensor: usize,
    /// Routes from the sensor to capture nodes, at least one, the best first.
    pub routes: Vec<Route>,
}

impl Located {
    /// Returns the name of the sensor's entity.
    pub fn sensor_name(&self) -> &str {
        self.graph.entities.get(self.sensor).map_or("", |e| &e.name)
    }

    /// Returns the device number of the node at the end of the best route.
    pub fn device(&self) -> Option<Device> {
        let end = self.routes.first()?.end(&self.graph)?;
        self.graph.entities.get(end)?.device
    }

    /// Returns whether all links of the best route are enabled.
    fn is_linked(&self) -> bool {
        self.routes.iter().any(|route| route.missing(&self.graph).is_empty())
    }
}

/// The way in which the options name a camera.
enum Named<'a> {
    /// By the device number of its capture node.
    Node(Device),
    /// By the path of its media device.
    Media(&'a Path),
    /// By a prefix of its sensor's name.
    Sensor(&'a str),
}

/// Finds the camera of `options`, if it belongs to a media graph with a sensor.
///
/// # Errors
/// [`CameraError`] if several sensors match, or if none matches and no capture node outside of media graphs has
/// the name.
pub(in crate::v4l2) fn locate(
    kernel: &mut dyn Kernel,
    options: &Options,
) -> Result<Option<Located>, CameraError> {
    let path = &options.path;
    let text = path.to_str().unwrap_or_default();
    let named = match kernel.device_of(path) {
        _ if text.starts_with("/dev/media") => Named::Media(path),
        _ if !text.contains('/') => Named::Sensor(text),
        Some(device) => Named::Node(device),
        None => return Ok(None),
    };
    let mut found = Vec::new();
    for media in kernel.media_nodes() {
        if matches!(named, Named::Media(path) if path != media) {
            continue;
        }
        found.extend(sensors(kernel, &media, &named).unwrap_or_default());
    }
    if let Some(wished) = &options.subdevice {
        let device = kernel.device_of(wished);
        let name = wished.to_str().unwrap_or_default();
        found.retain(|l| {
            let entity = &l.graph.entities[l.sensor];
            (device.is_some() && entity.device == device) || entity.name.starts_with(name)
        });
    }
    if found.len() > 1
        && found.iter().filter(|l| l.is_linked()).count() == 1
        && matches!(named, Named::Node(_))
    {
        found.retain(Located::is_linked);
    }
    let expected = "sensor=NAME or v4l2:NAME with the beginning of one name";
    match (found.len(), named) {
        (0 | 1, Named::Node(_)) | (1, _) => Ok(found.pop()),
        (0, _) => {
            let (found, expected) = ("no such sensor".into(), "a sensor that a media device has".into());
            Err(CameraError::Unfit { path: path.clone(), found, expected })
        }
        _ => {
            let names: Vec<_> = found.iter().map(Located::sensor_name).collect();
            let found = format!("the sensors {}", names.join(" and "));
            Err(CameraError::Unfit { path: path.clone(), found, expected: expected.into() })
        }
    }
}

/// Returns all sensors of all media devices that have a route to a node.
pub(in crate::v4l2) fn all(kernel: &mut dyn Kernel) -> Vec<Located> {
    let devices = kernel.media_nodes();
    devices.iter().flat_map(|path| sensors(kernel, path, &Named::Sensor("")).unwrap_or_default()).collect()
}

/// Returns the sensors of the media device `path` that match `named`.
fn sensors(kernel: &mut dyn Kernel, path: &Path, named: &Named<'_>) -> Result<Vec<Located>, CameraError> {
    let graph = read(access::open(kernel, path)?.as_mut(), path)?;
    let nodes: Vec<usize> = match named {
        _ if graph.sensors().next().is_none() => return Ok(Vec::new()),
        Named::Node(device) => {
            (0..graph.entities.len()).filter(|at| graph.entities[*at].device == Some(*device)).collect()
        }
        _ => capturing(kernel, &graph),
    };
    let mut found = Vec::new();
    for sensor in graph.sensors() {
        let is_named = match named {
            Named::Sensor(name) => graph.entities[sensor].name.starts_with(name),
            _ => true,
        };
        let routes = routes(&graph, sensor, &|entity| nodes.contains(&entity));
        if is_named && !routes.is_empty() {
            found.push(Located { path: path.into(), graph: graph.clone(), sensor, routes });
        }
    }
    Ok(found)
}

fn read(node: &mut dyn Node, path: &Path) -> Result<Graph, CameraError> {
    let mut topology = Topology::default();
    persist(|| node.call(Call::Topology(&mut topology)))
        .map_err(|e| failed(path, "G_TOPOLOGY", e, "a media device"))?;
    Ok(Graph::of(&topology))
}

/// Returns the indices of the entities of a graph whose nodes capture streams.
fn capturing(kernel: &mut dyn Kernel, graph: &Graph) -> Vec<usize> {
    let mut found = Vec::new();
    for (at, entity) in graph.entities.iter().enumerate().filter(|(_, e)| e.is_video()) {
        let path = entity.device.and_then(|device| kernel.node_of(device));
        let Some(path) = path else { continue };
        let Ok(mut node) = access::open(kernel, &path) else { continue };
        if access::capability(node.as_mut(), &path).is_ok_and(|caps| access::captures(&caps)) {
            found.push(at);
        }
    }
    found
}
