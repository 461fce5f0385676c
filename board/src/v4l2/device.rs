//! The list of cameras with their formats and controls.

use super::Size;
use super::access::{capability, captures, open};
use super::controls::{self, Info};
use super::exposure::{self, Knob, Sensor};
use super::media::{self, Located, bus};
use super::view::{self, View};
use super::{Call, CameraError, Kernel, Node, abi, formats, persist, text};
use serde::Serialize;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Largest number of entries that are read of each list of a driver: pixel formats, frame sizes of a format,
/// frame rates of a size.
const MAX_FORMATS: u32 = 64;
const MAX_SIZES: u32 = 64;
const MAX_RATES: u32 = 64;

/// Properties of a camera, as `hemilux devices` lists them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Description {
    /// Device node of the camera.
    pub path: PathBuf,
    /// Name of the camera that its driver reports.
    pub name: String,
    /// Bus address of the camera.
    pub bus: String,
    /// Name of the camera's driver.
    pub driver: String,
    /// Pixel formats of the camera.
    pub formats: Vec<FormatInfo>,
    /// Shortest and longest exposure time, seconds; null if the exposure cannot be set.
    pub exposure_s: Option<[f64; 2]>,
    /// Least and largest value of the gain, in the driver's unit; null for a camera without a gain control.
    pub gain: Option<[i64; 2]>,
    /// The sub-device with the exposure control, if the node itself has none.
    pub sensor: Option<PathBuf>,
    /// The sensor's name, which `v4l2:NAME` accepts; unlike node numbers, it does not change from boot to boot.
    pub sensor_name: Option<String>,
    /// The media device whose graph connects the sensor with the node.
    pub media: Option<PathBuf>,
    /// Modes of the camera's sensor.
    pub modes: Vec<ModeInfo>,
}

/// A mode of a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModeInfo {
    /// Width of the pictures of the mode, pixels.
    pub width: u32,
    /// Height of the pictures of the mode, pixels.
    pub height: u32,
    /// Part of the sensor that the mode covers; null if neither the driver nor the table of sensors has it.
    pub view: Option<View>,
    /// Fraction of the sensor's area that the mode covers, 0 to 1.
    pub share: Option<f64>,
}

/// A pixel format that a camera offers, with its frame sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatInfo {
    /// FourCC of the pixel format.
    pub fourcc: String,
    /// Description of the format for people.
    pub description: String,
    /// Whether this program can read frames of the format.
    pub readable: bool,
    /// Frame sizes that the camera offers in the format.
    pub sizes: Vec<SizeInfo>,
}

/// A frame size of a pixel format, with its frame rates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SizeInfo {
    /// Width of the frame, pixels.
    pub width: u32,
    /// Height of the frame, pixels.
    pub height: u32,
    /// Frame rates that the camera offers at this size, Hz.
    pub rates: Vec<f64>,
}

impl SizeInfo {
    /// Returns width and height of the frame.
    #[must_use]
    pub const fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }
}

/// Lists all cameras. Nodes that cannot be opened are left out.
///
/// # Errors
/// [`CameraError`] of the first node, if there are nodes and none can be opened.
pub fn list(kernel: &mut dyn Kernel) -> Result<Vec<Description>, CameraError> {
    let (mut found, mut refused, mut opened) = (Vec::new(), None, false);
    let sensors = media::all(kernel);
    for path in kernel.video_nodes() {
        let device = kernel.device_of(&path);
        let is_part = |l: &Located| device.is_some() && l.graph.entities.iter().any(|e| e.device == device);
        let described = match sensors.iter().find(|l| device.is_some() && l.device() == device) {
            Some(located) => describe_sensor(kernel, &path, located).map(Some),
            None if sensors.iter().any(is_part) => continue,
            None => describe(kernel, &path),
        };
        match described {
            Ok(camera) => {
                opened = true;
                found.extend(camera);
            }
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    refused.filter(|_| !opened).map_or(Ok(found), Err)
}

/// Describes the camera at `path`; `None` if the node does not capture.
///
/// # Errors
/// [`CameraError`] if the node cannot be opened.
pub fn describe(kernel: &mut dyn Kernel, path: &Path) -> Result<Option<Description>, CameraError> {
    let mut node = open(kernel, path)?;
    let caps = capability(node.as_mut(), path)?;
    if !captures(&caps) {
        return Ok(None);
    }
    let formats = formats(node.as_mut(), 0);
    let width = formats.iter().flat_map(|f| &f.sizes).map(|s| s.width).max().unwrap_or(0);
    let (mut exposure_s, mut gain) = (exposure_range(node.as_mut(), width), gain_range(node.as_mut()));
    let mut sensor = None;
    if exposure_s.is_none()
        && let Ok(Some(found)) = find_sensor(kernel, None)
    {
        let OpenSensor { node: mut sub, path, .. } = found;
        (exposure_s, gain) = (exposure_range(sub.as_mut(), width), gain_range(sub.as_mut()));
        sensor = Some(path);
    }
    let common = Description::of(path, &caps, formats);
    Ok(Some(Description { exposure_s, gain, sensor, ..common }))
}

/// Describes the camera whose sensor is connected with the node at `path` by a media graph.
fn describe_sensor(
    kernel: &mut dyn Kernel,
    path: &Path,
    located: &Located,
) -> Result<Description, CameraError> {
    let mut node = open(kernel, path)?;
    let caps = capability(node.as_mut(), path)?;
    let common = Description::of(path, &caps, formats(node.as_mut(), 0));
    let device = located.graph.entities.get(located.sensor).and_then(|e| e.device);
    let Some(sensor) = device.and_then(|device| kernel.node_of(device)) else { return Ok(common) };
    let mut sub = open(kernel, &sensor)?;
    let name = located.sensor_name();
    let modes = modes(sub.as_mut(), exposure::sensor(name));
    let width = modes.iter().map(|m| m.width).max().unwrap_or(0);
    Ok(Description {
        exposure_s: exposure_range(sub.as_mut(), width),
        gain: gain_range(sub.as_mut()),
        modes,
        sensor: Some(sensor),
        sensor_name: Some(name.into()),
        media: Some(located.path.clone()),
        ..common
    })
}

impl Description {
    fn of(path: &Path, caps: &abi::Capability, formats: Vec<FormatInfo>) -> Self {
        let (name, bus, driver) = (text(&caps.card), text(&caps.bus_info), text(&caps.driver));
        Self {
            path: path.into(),
            name,
            bus,
            driver,
            formats,
            exposure_s: None,
            gain: None,
            sensor: None,
            sensor_name: None,
            media: None,
            modes: Vec::new(),
        }
    }
}

/// Returns the frame sizes of the sensor's preferred media bus code, each with the part of the sensor that it
/// covers.
fn modes(sensor: &mut dyn Node, known: Option<&Sensor>) -> Vec<ModeInfo> {
    let codes = bus::offered(sensor, 0);
    let Some(code) = bus::ranked(&codes).first().copied() else { return Vec::new() };
    let mut sizes = Vec::new();
    for index in 0..MAX_SIZES {
        let mut d = abi::PadSize { index, code, ..Default::default() };
        if persist(|| sensor.call(Call::EnumPadSizes(&mut d))).is_err() {
            break;
        }
        let [_, width, _, height] = d.size;
        sizes.push(Size { width, height });
    }
    sizes.dedup();
    let mut present = abi::PadFormat::default();
    let is_told = persist(|| sensor.call(Call::GetPadFormat(&mut present))).is_ok();
    let mut described = |size: Size| {
        // The driver reports the covered rectangle of the present mode only.
        let is_present = is_told && Size::new(present.width, present.height) == size;
        let view = if is_present {
            view::present(sensor, known, size)
        } else {
            known.and_then(|sensor| view::known(sensor, size))
        };
        ModeInfo { width: size.width, height: size.height, view, share: view.map(|v| v.share()) }
    };
    sizes.into_iter().map(&mut described).collect()
}

fn exposure_range(node: &mut dyn Node, width: u32) -> Option<[f64; 2]> {
    Knob::find(node, width)?.range_s()
}

fn gain_range(node: &mut dyn Node) -> Option<[i64; 2]> {
    let found = [abi::ANALOGUE_GAIN, abi::GAIN].into_iter().find_map(|id| controls::find(node, id));
    found.filter(Info::is_settable).map(|i| [i.minimum, i.maximum])
}

/// An open sub-device with its path and name.
pub(super) struct OpenSensor {
    pub node: Box<dyn Node>,
    pub path: PathBuf,
    pub name: String,
}

/// Opens the sub-device with an exposure control: the one of the options, or the only one.
///
/// # Errors
/// [`CameraError`] if the sub-device of the options cannot be opened.
pub(super) fn find_sensor(
    kernel: &mut dyn Kernel,
    wished: Option<&Path>,
) -> Result<Option<OpenSensor>, CameraError> {
    let mut found = Vec::new();
    let named = kernel.subdevices();
    for (path, name) in named {
        if wished.is_none_or(|w| w == path)
            && let Ok(mut node) = open(kernel, &path)
            && controls::find(node.as_mut(), abi::EXPOSURE).is_some()
        {
            found.push(OpenSensor { node, path, name });
        }
    }
    if let (Some(wished), true) = (wished, found.is_empty()) {
        let (found, expected) = ("no exposure control".into(), "a sensor's sub-device".into());
        return Err(CameraError::Unfit { path: wished.into(), found, expected });
    }
    Ok(if found.len() == 1 { found.pop() } else { None })
}

/// Returns all pixel formats of a node; with a non-zero media bus code `code`, only the formats for that code.
pub(super) fn formats(node: &mut dyn Node, code: u32) -> Vec<FormatInfo> {
    let mut found = Vec::new();
    for index in 0..MAX_FORMATS {
        let mut d = abi::FormatDescription { index, mbus_code: code, ..Default::default() };
        if persist(|| node.call(Call::EnumFormats(&mut d))).is_err() {
            break;
        }
        if d.flags & abi::FORMAT_EMULATED == 0 {
            let (fourcc, readable) = (formats::name(d.fourcc), formats::rank(d.fourcc).is_some());
            let sizes = sizes(node, d.fourcc);
            found.push(FormatInfo { fourcc, description: text(&d.description), readable, sizes });
        }
    }
    found
}

/// Frame sizes that are listed for a driver that reports a range of sizes, in addition to the ends of the
/// range.
const USUAL: [Size; 4] =
    [Size::new(320, 240), Size::new(640, 480), Size::new(1280, 720), Size::new(1920, 1080)];

fn sizes(node: &mut dyn Node, fourcc: u32) -> Vec<SizeInfo> {
    let mut found = Vec::new();
    for index in 0..MAX_SIZES {
        let mut d = abi::SizeDescription { index, fourcc, ..Default::default() };
        if persist(|| node.call(Call::EnumSizes(&mut d))).is_err() {
            break;
        }
        let [a, b, c, e, f, g] = d.size;
        if d.kind == abi::DISCRETE {
            found.push(Size::new(a, b));
            continue;
        }
        let takes = |v: u32, range: RangeInclusive<u32>, step: u32| {
            range.contains(&v) && (v - range.start()).is_multiple_of(step.max(1))
        };
        found.push(Size::new(a, e));
        found.extend(USUAL.into_iter().filter(|s| takes(s.width, a..=b, c) && takes(s.height, e..=f, g)));
        found.push(Size::new(b, f));
        break;
    }
    found.dedup();
    let rated =
        |Size { width, height }| SizeInfo { width, height, rates: rates(node, fourcc, width, height) };
    found.into_iter().map(rated).collect()
}

fn rates(node: &mut dyn Node, fourcc: u32, width: u32, height: u32) -> Vec<f64> {
    let mut found = Vec::new();
    let rate = |n: u32, d: u32| (n > 0 && d > 0).then(|| f64::from(d) / f64::from(n));
    for index in 0..MAX_RATES {
        let mut d = abi::IntervalDescription { index, fourcc, width, height, ..Default::default() };
        if persist(|| node.call(Call::EnumIntervals(&mut d))).is_err() {
            break;
        }
        found.extend(rate(d.interval[0], d.interval[1]));
        if d.kind != abi::DISCRETE {
            found.extend(rate(d.interval[2], d.interval[3]));
            break;
        }
    }
    found
}

/// Returns the frame size of `format` whose number of pixels is nearest to that of `wished`.
#[must_use]
pub fn nearest_size(format: &FormatInfo, wished: Size) -> Option<Size> {
    let off = |size: &Size| (size.area().abs_diff(wished.area()), size.width.abs_diff(wished.width));
    format.sizes.iter().map(SizeInfo::size).min_by_key(off)
}
