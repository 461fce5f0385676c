//! Opening a camera and agreeing with it: format, rate, manual exposure. What was asked and what was got is kept for the report.

use super::controls::{self, Info};
use super::device::{self, failed};
use super::exposure::{self, Held, Knob, Manual, Sensor, Setting, Unit};
use super::formats::{self, Picture};
use super::{Call, CameraError, Kernel, Node, abi, persist};
use hemilux_core::Response;
use hemilux_core::format::{Pattern, Yuv};
use rustix::io::Errno;
use std::path::{Path, PathBuf};

/// A control in the place of the exposure, for benches whose camera has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StandIn {
    /// The control's name, in any case of letters.
    pub control: String,
    /// Its values, one for each exposure in the same order.
    pub values: Vec<i64>,
}

/// What is wished for.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The camera's node.
    pub path: PathBuf,
    /// The sensor's sub-device, where it is not the only one.
    pub subdevice: Option<PathBuf>,
    /// Columns and rows.
    pub size: (u32, u32),
    /// Whether a sensor that is known is asked for the mode that sees all of it in place of `size`.
    pub full_view: bool,
    /// The size that pictures must have, where a lens is known for no other.
    pub lens_size: Option<(u32, u32)>,
    /// Pixel format; the best readable one otherwise.
    pub fourcc: Option<u32>,
    /// Frames a second.
    pub rate_hz: f64,
    /// Exposure times, seconds.
    pub exposures_s: Vec<f64>,
    /// A control in the place of the exposure.
    pub stand_in: Option<StandIn>,
    /// Frames after the next one until a control acts; found out otherwise.
    pub delay: Option<u32>,
    /// Codes to relative exposure; by the pixel format otherwise.
    pub response: Option<Response>,
    /// Codes of darkness and of relative exposure 1; by the sensor and the pixel format otherwise.
    pub levels: Option<(f64, f64)>,
}

impl Options {
    /// The default options for the camera at `path`.
    #[must_use]
    pub fn of(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            subdevice: None,
            size: (640, 480),
            full_view: true,
            lens_size: None,
            fourcc: None,
            rate_hz: 30.0,
            exposures_s: vec![0.000_9, 0.005_5, 0.033_3],
            stand_in: None,
            delay: None,
            response: None,
            levels: None,
        }
    }
}

/// One thing that was asked for, and what came of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Agreed {
    /// What.
    pub what: &'static str,
    /// Asked for.
    pub asked: String,
    /// Got.
    pub got: String,
}

/// An open camera that has agreed.
pub(super) struct Setup {
    pub video: Box<dyn Node>,
    /// Where the exposure is controlled, if not at `video`.
    pub sensor: Option<Box<dyn Node>>,
    pub picture: Picture,
    pub period_s: f64,
    pub knob: Option<Knob>,
    /// Controls that keep their values while the camera streams, in the order in which they are set.
    pub held: Vec<Held>,
    /// At least one; without a knob exactly one, of the frame's own time.
    pub settings: Vec<Setting>,
    /// From the table of sensors.
    pub delay: Option<u32>,
    /// Relative code of darkness, from the same table.
    pub black: f64,
    pub agreed: Vec<Agreed>,
}

/// Opens the camera that `options` name and agrees with it.
pub(super) fn open(kernel: &mut dyn Kernel, options: &Options) -> Result<Setup, CameraError> {
    let path = &options.path;
    let mut video = device::open(kernel, path)?;
    let caps = device::capability(video.as_mut(), path)?;
    if !device::captures(&caps) {
        let expected = "a node that captures single-planar video in a stream".into();
        return Err(CameraError::Unfit {
            path: path.clone(),
            found: "another kind of device".into(),
            expected,
        });
    }
    let own = Knob::find(video.as_mut(), options.size.0).is_some();
    let found = if own && options.subdevice.is_none() {
        None
    } else {
        device::find_sensor(kernel, options.subdevice.as_deref())?
    };
    let known = found.as_ref().and_then(|(_, _, name)| exposure::sensor(name));
    let mut sensor = found.map(|(node, _, _)| node);
    let full_view = known.filter(|_| options.full_view).map(|sensor| sensor.full_view);
    let asked = full_view.unwrap_or(options.size);
    let granted = set_format(video.as_mut(), sensor.as_mut(), asked, options)?;
    let picture = Picture::of(&granted).map_err(|(found, expected)| CameraError::Unfit {
        path: path.clone(),
        found,
        expected,
    })?;
    let got = picture.camera_size();
    if let Some(lens) = options.lens_size.filter(|lens| *lens != got) {
        let found = format!("pictures of {} pixels", size(got));
        let expected = format!("{} as the lens file says: another size= or another lens", size(lens));
        return Err(CameraError::Unfit { path: path.clone(), found, expected });
    }
    let mut period_s = set_rate(video.as_mut(), options.rate_hz, path)?;
    let holder: &mut dyn Node = match &mut sensor {
        Some(node) => node.as_mut(),
        None => video.as_mut(),
    };
    let Exposing { knob, settings, held } = expose(holder, options, &picture, known, &mut period_s);
    let mut agreed = vec![
        agreed("size", size(asked), size(got)),
        agreed(
            "format",
            options.fourcc.map_or("the best".into(), formats::name),
            formats::name(picture.camera_fourcc()),
        ),
        agreed("rate", format!("{:.2} Hz", options.rate_hz), format!("{:.2} Hz", 1.0 / period_s)),
    ];
    agreed.extend(settings.iter().map(|s| Agreed {
        what: "exposure",
        asked: format!("{:.2} ms", s.asked_s * 1e3),
        got: if knob.is_some() { format!("{:.2} ms", s.seconds * 1e3) } else { "no control".into() },
    }));
    agreed.extend(held.iter().filter(|h| !h.holds()).map(refused));
    let black = known
        .filter(|_| picture.is_raw())
        .map_or(0.0, |s| f64::from(s.black.0) / f64::from((1u32 << s.black.1) - 1));
    Ok(Setup {
        video,
        sensor,
        picture,
        period_s,
        knob,
        held,
        settings,
        delay: known.map(|s| s.delay),
        black,
        agreed,
    })
}

fn agreed(what: &'static str, asked: String, got: String) -> Agreed {
    Agreed { what, asked, got }
}

fn size((width, height): (u32, u32)) -> String {
    format!("{width} x {height}")
}

/// A control that did not take its value.
fn refused(held: &Held) -> Agreed {
    let got = held.found.map_or_else(|| "unreadable".into(), |value| value.to_string());
    agreed("control", format!("{} = {}", held.info.name, held.wanted), got)
}

/// Sets controls again that a camera changed when its stream started; true if there were any.
pub(super) fn restore(setup: &mut Setup) -> bool {
    let Setup { video, sensor, held, .. } = setup;
    let node: &mut dyn Node = match sensor {
        Some(sensor) => sensor.as_mut(),
        None => video.as_mut(),
    };
    let mut changed = false;
    for control in held.iter_mut() {
        if controls::value(node, &control.info).ok() == control.found {
            continue;
        }
        changed = true;
        let _ = controls::set(node, &control.info, control.found.unwrap_or(control.wanted));
    }
    changed
}

/// The value of the exposure control as it is read back.
pub(super) fn exposure_value(setup: &mut Setup) -> Option<i64> {
    let Setup { video, sensor, knob, .. } = setup;
    let node: &mut dyn Node = sensor.as_deref_mut().unwrap_or(video.as_mut());
    controls::value(node, &knob.as_ref()?.info).ok()
}

/// How a camera's exposure is controlled.
struct Exposing {
    knob: Option<Knob>,
    settings: Vec<Setting>,
    held: Vec<Held>,
}

/// Switches the exposure to manual and agrees on its values; the frame's time follows a sensor's longest exposure.
fn expose(
    node: &mut dyn Node,
    options: &Options,
    picture: &Picture,
    known: Option<&Sensor>,
    period_s: &mut f64,
) -> Exposing {
    if let Some(stand_in) = &options.stand_in {
        let all = controls::all(node);
        let info =
            all.into_iter().find(|i| i.is_settable() && i.name.eq_ignore_ascii_case(&stand_in.control));
        let settings = stand_in.values.iter().zip(&options.exposures_s);
        let settings =
            settings.map(|(value, s)| Setting { value: *value, asked_s: *s, seconds: *s }).collect();
        if let Some(info) = info {
            let knob = Some(Knob { info, unit: Unit::StandIn });
            return Exposing { knob, settings, held: Vec::new() };
        }
    }
    let Manual { settable, mut held } = exposure::go_manual(node);
    // The gain stays at its least: the linear part of every sensor, and the least noise per light.
    for id in [abi::ANALOGUE_GAIN, abi::GAIN] {
        held.extend(Held::set(node, id, i64::MIN));
    }
    let knob = Knob::find(node, picture.width()).filter(|_| settable);
    if let Some(knob) = knob {
        let longest = options.exposures_s.iter().copied().fold(0.0, f64::max);
        if let Some(s) = exposure::stretch_frame(node, &knob, picture.height(), longest, known) {
            *period_s = s;
        }
        if let Some(info) = controls::find(node, abi::VBLANK).filter(Info::is_settable)
            && let Ok(value) = controls::value(node, &info)
        {
            held.push(Held { info, wanted: value, found: Some(value) });
        }
        let settings = exposure::agree(node, &knob, &options.exposures_s, *period_s);
        if !settings.is_empty() {
            return Exposing { knob: Some(knob), settings, held };
        }
    }
    let whole = Setting { value: 0, asked_s: *period_s, seconds: *period_s };
    Exposing { knob: None, settings: vec![whole], held }
}

/// Media bus codes of mosaics, most bits first.
const BUS_CODES: [(u32, u32, Pattern); 20] = [
    (0x301d, 16, Pattern::Bggr),
    (0x301e, 16, Pattern::Gbrg),
    (0x301f, 16, Pattern::Grbg),
    (0x3020, 16, Pattern::Rggb),
    (0x3019, 14, Pattern::Bggr),
    (0x301a, 14, Pattern::Gbrg),
    (0x301b, 14, Pattern::Grbg),
    (0x301c, 14, Pattern::Rggb),
    (0x3008, 12, Pattern::Bggr),
    (0x3010, 12, Pattern::Gbrg),
    (0x3011, 12, Pattern::Grbg),
    (0x3012, 12, Pattern::Rggb),
    (0x3007, 10, Pattern::Bggr),
    (0x300e, 10, Pattern::Gbrg),
    (0x300a, 10, Pattern::Grbg),
    (0x300f, 10, Pattern::Rggb),
    (0x3001, 8, Pattern::Bggr),
    (0x3013, 8, Pattern::Gbrg),
    (0x3002, 8, Pattern::Grbg),
    (0x3014, 8, Pattern::Rggb),
];

/// Agrees on the pictures: first with a sensor, whose answer the bridge must then be told, or its stream does not start.
fn set_format(
    video: &mut dyn Node,
    sensor: Option<&mut Box<dyn Node>>,
    asked: (u32, u32),
    options: &Options,
) -> Result<abi::PixelFormat, CameraError> {
    let path = &options.path;
    let (mut wished, mut mosaic) = (asked, None);
    if let Some(sensor) = sensor
        && let Some((bits, found, size)) = set_pad(sensor.as_mut(), asked)
    {
        (wished, mosaic) = (size, Some((bits, found)));
    }
    let fitting = |fourcc: u32| match (mosaic, formats::format(fourcc, Yuv::default())) {
        (Some((bits, pattern)), Some(f)) => f.pattern() == Some(pattern) && f.max_code() == (1 << bits) - 1,
        (None, Some(_)) => true,
        (_, None) => false,
    };
    let offered = device::formats(video);
    let readable = offered.iter().filter_map(|f| Some((formats::rank(formats::parse(&f.fourcc)?)?, f)));
    let named =
        |f: &device::FormatInfo| options.fourcc.is_none_or(|wished| formats::name(wished) == f.fourcc);
    let mut readable: Vec<_> =
        readable.filter(|(_, f)| named(f) && formats::parse(&f.fourcc).is_some_and(fitting)).collect();
    readable.sort_by_key(|(rank, f)| {
        let is_other = device::nearest_size(f, wished) != Some(wished) && mosaic.is_none();
        (is_other, is_slow(f, wished, options.rate_hz), *rank)
    });
    let Some((_, best)) = readable.first() else {
        let offers: Vec<_> = offered.iter().map(|f| f.fourcc.as_str()).collect();
        let (found, any) = formats::none_of(&offers);
        let expected = options.fourcc.map_or(any, formats::name);
        return Err(CameraError::Unfit { path: path.clone(), found, expected });
    };
    let fourcc = formats::parse(&best.fourcc).unwrap_or_default();
    let (width, height) =
        if mosaic.is_some() { wished } else { device::nearest_size(best, wished).unwrap_or(wished) };
    let pixel = abi::PixelFormat { width, height, fourcc, ..Default::default() };
    let mut format = abi::Format { pixel, ..Default::default() };
    persist(|| video.call(Call::SetFormat(&mut format)))
        .map_err(|e| failed(path, "S_FMT", e, "a camera that no other program streams from"))?;
    Ok(format.pixel)
}

/// Whether a format's highest frame rate at `size` is less than half of the requested rate `rate_hz`.
fn is_slow(format: &device::FormatInfo, size: (u32, u32), rate_hz: f64) -> bool {
    let rates = format.sizes.iter().filter(|s| (s.width, s.height) == size).flat_map(|s| &s.rates);
    rates.copied().reduce(f64::max).is_some_and(|most| most < rate_hz / 2.0)
}

/// Sets a sensor's own format: its bits, its mosaic and its size.
fn set_pad(sensor: &mut dyn Node, wished: (u32, u32)) -> Option<(u32, Pattern, (u32, u32))> {
    let mut offered = Vec::new();
    for index in 0..64 {
        let mut code = abi::BusCode { index, ..Default::default() };
        if persist(|| sensor.call(Call::EnumBusCodes(&mut code))).is_err() {
            break;
        }
        offered.push(code.code);
    }
    let (code, ..) = *BUS_CODES.iter().find(|(code, ..)| offered.contains(code))?;
    let mut pad = abi::PadFormat { width: wished.0, height: wished.1, code, ..Default::default() };
    persist(|| sensor.call(Call::SetPadFormat(&mut pad))).ok()?;
    let (_, bits, pattern) = *BUS_CODES.iter().find(|(code, ..)| *code == pad.code)?;
    Some((bits, pattern, (pad.width, pad.height)))
}

/// Asks for a rate and gives the time of a frame that was granted. Drivers that cannot are right too.
fn set_rate(video: &mut dyn Node, rate_hz: f64, path: &Path) -> Result<f64, CameraError> {
    let rate_hz = if rate_hz > 0.0 { rate_hz.clamp(0.1, 1000.0) } else { 30.0 };
    let interval = [1000, (1000.0 * rate_hz).round() as u32];
    let mut parameters = abi::Parameters { interval, ..Default::default() };
    match persist(|| video.call(Call::SetParameters(&mut parameters))) {
        Ok(()) | Err(Errno::NOTTY | Errno::INVAL) => {}
        Err(e) => return Err(failed(path, "S_PARM", e, "a frame rate")),
    }
    let [n, d] = parameters.interval;
    let period_s = if n > 0 && d > 0 { f64::from(n) / f64::from(d) } else { 1.0 / rate_hz };
    Ok(period_s.clamp(1e-3, 10.0))
}

/// Writes a setting's value.
pub(super) fn write(node: &mut dyn Node, info: &Info, setting: &Setting) -> Result<(), Errno> {
    controls::set(node, info, setting.value)
}
