//! What cameras there are and what they can do.

use super::controls::{self, Info};
use super::exposure::Knob;
use super::{Call, CameraError, Kernel, Node, abi, formats, persist, text};
use rustix::io::Errno;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Most entries of each list that are read from a driver.
const MAX_FORMATS: u32 = 64;
const MAX_SIZES: u32 = 64;
const MAX_RATES: u32 = 64;

/// A camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Description {
    /// Its node.
    pub path: PathBuf,
    /// What it calls itself.
    pub name: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Name of its driver.
    pub driver: String,
    /// What it gives.
    pub formats: Vec<FormatInfo>,
    /// Exposure times that can be set, shortest and longest; null where they cannot.
    pub exposure_s: Option<(f64, f64)>,
    /// Least and largest value of its gain, in the driver's own unit; null where it has none.
    pub gain: Option<(i64, i64)>,
    /// The sub-device that has the exposure, where the node itself has not.
    pub sensor: Option<PathBuf>,
}

/// A pixel format.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatInfo {
    /// The four characters.
    pub fourcc: String,
    /// For people.
    pub description: String,
    /// Whether frames of it can be read.
    pub readable: bool,
    /// Its sizes.
    pub sizes: Vec<SizeInfo>,
}

/// A size of pictures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SizeInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames a second.
    pub rates: Vec<f64>,
}

/// All cameras. Nodes that cannot be opened are left out, but the first reason is given where nothing can.
///
/// # Errors
/// [`CameraError`] where there are nodes and none can be opened.
pub fn list(kernel: &mut dyn Kernel) -> Result<Vec<Description>, CameraError> {
    let (mut found, mut refused, mut opened) = (Vec::new(), None, false);
    for path in kernel.video_nodes() {
        match describe(kernel, &path) {
            Ok(camera) => {
                opened = true;
                found.extend(camera);
            }
            Err(error) => refused = refused.or(Some(error)),
        }
    }
    refused.filter(|_| !opened).map_or(Ok(found), Err)
}

/// The camera at `path`; `None` where that node captures nothing.
///
/// # Errors
/// [`CameraError`] where it cannot be opened.
pub fn describe(kernel: &mut dyn Kernel, path: &Path) -> Result<Option<Description>, CameraError> {
    let mut node = open(kernel, path)?;
    let caps = capability(node.as_mut(), path)?;
    if !captures(&caps) {
        return Ok(None);
    }
    let formats = formats(node.as_mut());
    let width = formats.iter().flat_map(|f| &f.sizes).map(|s| s.width).max().unwrap_or(0);
    let mut range = (exposure(node.as_mut(), width), gain(node.as_mut()));
    let mut sensor = None;
    if range.0.is_none()
        && let Ok(Some((mut sub, path, _))) = find_sensor(kernel, None)
    {
        range = (exposure(sub.as_mut(), width), gain(sub.as_mut()));
        sensor = Some(path);
    }
    let (name, bus, driver) = (text(&caps.card), text(&caps.bus_info), text(&caps.driver));
    Ok(Some(Description {
        path: path.into(),
        name,
        bus,
        driver,
        formats,
        exposure_s: range.0,
        gain: range.1,
        sensor,
    }))
}

fn exposure(node: &mut dyn Node, width: u32) -> Option<(f64, f64)> {
    Knob::find(node, width)?.range_s()
}

fn gain(node: &mut dyn Node) -> Option<(i64, i64)> {
    let found = [abi::ANALOGUE_GAIN, abi::GAIN].into_iter().find_map(|id| controls::find(node, id));
    found.filter(Info::is_settable).map(|i| (i.minimum, i.maximum))
}

/// Opens a node.
///
/// # Errors
/// [`CameraError`].
pub(super) fn open(kernel: &mut dyn Kernel, path: &Path) -> Result<Box<dyn Node>, CameraError> {
    persist(|| kernel.open(path)).map_err(|e| match e {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => CameraError::Gone(path.into()),
        Errno::ACCESS | Errno::PERM => {
            failed(path, "open", e, "a device that this user may open (is the user in the group video?)")
        }
        _ => failed(path, "open", e, "a camera that no other program holds"),
    })
}

pub(super) fn failed(
    path: &Path,
    operation: &'static str,
    errno: Errno,
    expected: &'static str,
) -> CameraError {
    if [Errno::NODEV, Errno::NXIO].contains(&errno) {
        return CameraError::Gone(path.into());
    }
    CameraError::Failed { path: path.into(), operation, errno: errno.to_string(), expected }
}

pub(super) fn capability(node: &mut dyn Node, path: &Path) -> Result<abi::Capability, CameraError> {
    let mut caps = abi::Capability::default();
    persist(|| node.call(Call::QueryCapability(&mut caps)))
        .map_err(|e| failed(path, "QUERYCAP", e, "a V4L2 device"))?;
    Ok(caps)
}

/// Whether the node gives pictures of one plane in a stream.
pub(super) fn captures(caps: &abi::Capability) -> bool {
    let own = caps.capabilities & abi::CAP_DEVICE_CAPS != 0;
    let caps = if own { caps.device_caps } else { caps.capabilities };
    let needed = abi::CAP_CAPTURE | abi::CAP_STREAMING;
    caps & needed == needed
}

/// An open sub-device, its path and its name.
type OpenSensor = (Box<dyn Node>, PathBuf, String);

/// The sub-device with an exposure control, with its path and name: the `wished` one, or the only one there is.
///
/// # Errors
/// [`CameraError`] where the wished one cannot be opened.
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
            found.push((node, path, name));
        }
    }
    if let (Some(wished), true) = (wished, found.is_empty()) {
        let (found, expected) = ("no exposure control there".into(), "a sensor's sub-device".into());
        return Err(CameraError::Unfit { path: wished.into(), found, expected });
    }
    Ok(if found.len() == 1 { found.pop() } else { None })
}

/// All pixel formats.
pub(super) fn formats(node: &mut dyn Node) -> Vec<FormatInfo> {
    let mut found = Vec::new();
    for index in 0..MAX_FORMATS {
        let mut d = abi::FormatDescription { index, ..Default::default() };
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

/// Sizes within a range that are tried, beside its ends.
const USUAL: [(u32, u32); 4] = [(320, 240), (640, 480), (1280, 720), (1920, 1080)];

fn sizes(node: &mut dyn Node, fourcc: u32) -> Vec<SizeInfo> {
    let mut found = Vec::new();
    for index in 0..MAX_SIZES {
        let mut d = abi::SizeDescription { index, fourcc, ..Default::default() };
        if persist(|| node.call(Call::EnumSizes(&mut d))).is_err() {
            break;
        }
        let [a, b, c, e, f, g] = d.size;
        if d.kind == abi::DISCRETE {
            found.push((a, b));
            continue;
        }
        let (width, height) = ((a, b, c.max(1)), (e, f, g.max(1)));
        let takes = |v: u32, (least, most, step): (u32, u32, u32)| {
            (least..=most).contains(&v) && (v - least).is_multiple_of(step)
        };
        found.push((a, e));
        found.extend(USUAL.into_iter().filter(|(w, h)| takes(*w, width) && takes(*h, height)));
        found.push((b, f));
        break;
    }
    found.dedup();
    let rated = |(width, height)| SizeInfo { width, height, rates: rates(node, fourcc, width, height) };
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

/// The size nearest to `wished` in pixels.
#[must_use]
pub fn nearest_size(format: &FormatInfo, wished: (u32, u32)) -> Option<(u32, u32)> {
    let area = |w: u32, h: u32| u64::from(w) * u64::from(h);
    let off = |s: &&SizeInfo| {
        (area(s.width, s.height).abs_diff(area(wished.0, wished.1)), s.width.abs_diff(wished.0))
    };
    format.sizes.iter().min_by_key(off).map(|s| (s.width, s.height))
}
