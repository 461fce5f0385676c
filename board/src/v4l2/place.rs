//! Opens a camera's capture node and its sensor, through a media graph or as separate nodes of a driver without one.

use super::exposure::{self, Knob, Sensor};
use super::media::wiring::Wiring;
use super::media::{self, Located};
use super::negotiate::{self, Carried};
use super::options::Options;
use super::{CameraError, Kernel, Node, Size, abi};
use super::{access, device};
use std::path::{Path, PathBuf};

/// A camera's open nodes with their formats set.
pub(super) struct CameraNodes {
    pub video: Box<dyn Node>,
    /// Node of the exposure control; `None` if the capture node has it.
    pub sensor: Option<Box<dyn Node>>,
    /// Properties of the sensor model, if the table has it.
    pub known: Option<&'static Sensor>,
    /// Size of the pictures that the options request.
    pub asked: Size,
    pub granted: abi::PixelFormat,
    /// Links and pad formats that are restored when the camera is closed.
    pub wiring: Option<Wiring>,
}

/// Opens the camera's nodes and sets their formats.
///
/// # Errors
/// [`CameraError`] of the node or pad that could not be opened or did not accept its format.
pub(super) fn open(kernel: &mut dyn Kernel, options: &Options) -> Result<CameraNodes, CameraError> {
    match media::locate(kernel, options)? {
        Some(located) => open_route(kernel, &located, options),
        None => open_node(kernel, options),
    }
}

/// Returns the requested size of the pictures: for a known sensor that of the mode that covers the whole sensor,
/// unless the options name another size.
fn asked(known: Option<&Sensor>, options: &Options) -> Size {
    known.filter(|_| options.full_view).map_or(options.size, |sensor| sensor.full_view)
}

/// Opens a node without a media graph, and its sensor's sub-device if there is one.
fn open_node(kernel: &mut dyn Kernel, options: &Options) -> Result<CameraNodes, CameraError> {
    let path = &options.path;
    let mut video = capture_node(kernel, path)?;
    let own = Knob::find(video.as_mut(), options.size.width).is_some();
    let found = if own && options.subdevice.is_none() {
        None
    } else {
        device::find_sensor(kernel, options.subdevice.as_deref())?
    };
    let known = found.as_ref().and_then(|found| exposure::sensor(&found.name));
    let mut sensor = found.map(|found| found.node);
    let asked = asked(known, options);
    let carried = sensor.as_mut().and_then(|sensor| negotiate::set_pad(sensor.as_mut(), asked));
    let granted = negotiate::set_format(video.as_mut(), carried, asked, options)?;
    Ok(CameraNodes { video, sensor, known, asked, granted, wiring: None })
}

/// Opens a node that captures single-planar pictures.
fn capture_node(kernel: &mut dyn Kernel, path: &Path) -> Result<Box<dyn Node>, CameraError> {
    let mut video = access::open(kernel, path)?;
    let caps = access::capability(video.as_mut(), path)?;
    if !access::captures(&caps) {
        let expected = "a node that captures single-planar video in a stream".into();
        return Err(CameraError::Unfit {
            path: path.into(),
            found: "another kind of device".into(),
            expected,
        });
    }
    Ok(video)
}

/// Opens the first route of the camera, by length, on which every pad and the node accept the format; returns the error of the best route
/// if none does.
fn open_route(
    kernel: &mut dyn Kernel,
    located: &Located,
    options: &Options,
) -> Result<CameraNodes, CameraError> {
    let mut refused = None;
    let shortest = located.routes.first().map_or(0, |route| route.links.len());
    for route in located.routes.iter().filter(|route| route.links.len() == shortest) {
        let mut wiring = match Wiring::new(kernel, located, route) {
            Ok(wiring) => wiring,
            Err(error) => {
                refused = refused.or(Some(error));
                continue;
            }
        };
        let entity = |at: Option<usize>| at.and_then(|at| located.graph.entities.get(at)?.device);
        let devices = [entity(route.end(&located.graph)), entity(Some(located.sensor))];
        let paths = devices.map(|device| device.and_then(|device| kernel.node_of(device)));
        let [Some(video), Some(sensor)] = paths else { continue };
        wiring.keep(access::open(kernel, &video)?);
        for code in wiring.codes() {
            match open_with(kernel, &mut wiring, code, located, options, [&video, &sensor]) {
                Ok(place) => return Ok(CameraNodes { wiring: Some(wiring), ..place }),
                Err(error) => refused = refused.or(Some(error)),
            }
        }
    }
    let (found, expected) =
        ("no media bus code that is read".into(), "a sensor of raw, RGB or YUYV pictures".into());
    Err(refused.unwrap_or(CameraError::Unfit { path: located.path.clone(), found, expected }))
}

/// Sets the pads of a route and its node to media bus code `code`.
fn open_with(
    kernel: &mut dyn Kernel,
    wiring: &mut Wiring,
    code: u32,
    located: &Located,
    options: &Options,
    [video, sensor]: [&PathBuf; 2],
) -> Result<CameraNodes, CameraError> {
    let known = exposure::sensor(located.sensor_name());
    let asked = asked(known, options);
    let pad = wiring.set_formats(code, asked)?;
    let carried = Carried { code: pad.code, size: Size::new(pad.width, pad.height) };
    let mut node = capture_node(kernel, video)?;
    let granted = negotiate::set_format(node.as_mut(), Some(carried), asked, options)?;
    let sensor = Some(access::open(kernel, sensor)?);
    Ok(CameraNodes { video: node, sensor, known, asked, granted, wiring: None })
}
