//! Opening of a camera and negotiation of format, rate and manual exposure, with a report of the requested and the granted values.

use super::agree;
use super::controls::{self, Info};
use super::exposure::{self, ControlUnit, ExposureSetting, Held, Knob, Manual, Sensor};
use super::formats::Mismatch;
use super::formats::{self, Picture};
use super::media::wiring::Wiring;
use super::negotiate;
pub use super::options::{Agreed, LensFit, Options, StandIn};
use super::place::{self, CameraNodes};
use super::view::{self, View};
use super::{CameraError, Kernel, Node, abi};
use crate::exposure_plan::TimeRange;
use rustix::io::Errno;

/// An open camera whose format and exposures are negotiated.
pub(super) struct Setup {
    pub video: Box<dyn Node>,
    /// Node of the sensor with the exposure control; `None` if the capture node has the control.
    pub sensor: Option<Box<dyn Node>>,
    pub picture: Picture,
    pub period_s: f64,
    pub knob: Option<Knob>,
    /// Whether the exposure control reads as the value that was written.
    pub reads_back: bool,
    /// Controls that keep their values while the camera streams, in the order in which they are set.
    pub held: Vec<Held>,
    /// Range of exposure times that the exposure control accepts, if it sets a time.
    pub range: Option<TimeRange>,
    /// Exposures of the burst, at least one; without an exposure control exactly one, the frame interval.
    pub settings: Vec<ExposureSetting>,
    /// Part of the sensor that pictures cover; `None` if it is unknown.
    pub view: Option<View>,
    /// Control delay from the table of sensors, frames after the next one.
    pub delay: Option<u32>,
    /// Relative code of black from the table of sensors, 0 to 1; 0 for other sensors.
    pub black: f64,
    pub agreed: Vec<Agreed>,
    /// This field is the last one, so that the nodes are closed before formats and links are restored.
    _wiring: Option<Wiring>,
}

/// Opens the camera of `options` and negotiates its format and exposures.
pub(super) fn open(kernel: &mut dyn Kernel, options: &Options) -> Result<Setup, CameraError> {
    let path = &options.path;
    let CameraNodes { mut video, mut sensor, known, asked, granted, wiring } = place::open(kernel, options)?;
    let picture = Picture::of(&granted).map_err(|Mismatch { found, expected }| CameraError::Unfit {
        path: path.clone(),
        found,
        expected,
    })?;
    let got = picture.camera_size();
    let view = match &mut sensor {
        Some(node) => view::present(node.as_mut(), known, got),
        None => view::present(video.as_mut(), None, got),
    };
    if let Some(lens) = &options.lens {
        lens.check(got, view.as_ref(), path)?;
    }
    let mut period_s = negotiate::choose_rate(video.as_mut(), options)?;
    let holder: &mut dyn Node = match &mut sensor {
        Some(node) => node.as_mut(),
        None => video.as_mut(),
    };
    let Exposing { knob, settings, reads_back, held } =
        expose(holder, options, &picture, known, &mut period_s);
    let range = knob.as_ref().and_then(|knob| agree::range(holder, knob, period_s));
    let mut agreed = vec![
        agreed("size", asked.to_string(), got.to_string()),
        agreed(
            "format",
            options.fourcc.map_or("the best".into(), formats::name),
            formats::name(picture.camera_fourcc()),
        ),
        agreed("rate", format!("{:.2} Hz", options.rate_hz), format!("{:.2} Hz", 1.0 / period_s)),
    ];
    agreed.extend(view.map(|view| agreed_view(&view)));
    agreed.extend(settings.iter().map(|s| Agreed {
        what: "exposure",
        asked: format!("{:.2} ms", s.asked_s * 1e3),
        got: if knob.is_some() { format!("{:.2} ms", s.seconds * 1e3) } else { "no control".into() },
    }));
    if !reads_back {
        agreed.push(Agreed {
            what: "exposure control",
            asked: "the value that was written".into(),
            got: "another one, or none; the written values are used".into(),
        });
    }
    agreed.extend(held.iter().filter(|h| !h.holds()).map(refused));
    let black = known.filter(|_| picture.is_raw()).map_or(0.0, |sensor| sensor.black.share());
    Ok(Setup {
        video,
        sensor,
        picture,
        period_s,
        knob,
        reads_back,
        held,
        range,
        settings,
        view,
        delay: known.map(|s| s.delay),
        black,
        agreed,
        _wiring: wiring,
    })
}

fn agreed(what: &'static str, asked: String, got: String) -> Agreed {
    Agreed { what, asked, got }
}

fn agreed_view(view: &View) -> Agreed {
    agreed("view", "all of the sensor".into(), view.to_string())
}

/// Returns the report on a held control that did not accept its value.
fn refused(held: &Held) -> Agreed {
    let got = held.found.map_or_else(|| "unreadable".into(), |value| value.to_string());
    agreed("control", format!("{} = {}", held.info.name, held.wanted), got)
}

/// Sets again the held controls that the camera changed when its stream started; returns true if it had changed
/// any.
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

/// Negotiates the exposure times `wished_s`, seconds, while the camera streams; returns an empty list if the
/// camera accepts none of them.
pub(super) fn renegotiate(setup: &mut Setup, wished_s: &[f64]) -> Vec<ExposureSetting> {
    let Setup { video, sensor, knob, reads_back, period_s, .. } = setup;
    let Some(knob) = knob else { return Vec::new() };
    let node: &mut dyn Node = sensor.as_deref_mut().unwrap_or(video.as_mut());
    if *reads_back {
        return agree::agree(node, knob, wished_s, *period_s).settings;
    }
    agree::nearest(node, knob, wished_s, *period_s)
}

/// Reads the value of the exposure control.
pub(super) fn exposure_value(setup: &mut Setup) -> Option<i64> {
    let Setup { video, sensor, knob, .. } = setup;
    let node: &mut dyn Node = sensor.as_deref_mut().unwrap_or(video.as_mut());
    controls::value(node, &knob.as_ref()?.info).ok()
}

/// The exposure control of a camera, with its unit and settings.
struct Exposing {
    knob: Option<Knob>,
    settings: Vec<ExposureSetting>,
    reads_back: bool,
    held: Vec<Held>,
}

/// Switches the exposure to manual and negotiates the values of the exposure control; the frame interval follows a
/// sensor's longest exposure.
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
            settings.map(|(value, s)| ExposureSetting { value: *value, asked_s: *s, seconds: *s }).collect();
        if let Some(info) = info {
            let knob = Some(Knob { info, unit: ControlUnit::StandIn });
            return Exposing { knob, settings, reads_back: true, held: Vec::new() };
        }
    }
    let Manual { settable, mut held } = exposure::go_manual(node);
    // The gains are set to their least value, at which every sensor is linear and has the least relative noise.
    for id in [abi::ANALOGUE_GAIN, abi::GAIN] {
        held.extend(Held::set(node, id, i64::MIN));
    }
    let knob = Knob::find(node, picture.width()).filter(|_| settable);
    if let Some(knob) = knob {
        let longest = options.exposures_s.iter().copied().fold(0.0, f64::max);
        if let Some(s) = exposure::stretch_frame(node, &knob, picture.height(), [longest, *period_s], known) {
            *period_s = s;
        }
        if let Some(info) = controls::find(node, abi::VBLANK).filter(Info::is_settable)
            && let Ok(value) = controls::value(node, &info)
        {
            held.push(Held { info, wanted: value, found: Some(value) });
        }
        let agree::Settled { settings, reads_back } =
            agree::agree(node, &knob, &options.exposures_s, *period_s);
        if !settings.is_empty() {
            return Exposing { knob: Some(knob), settings, reads_back, held };
        }
    }
    Exposing { knob: None, settings: vec![ExposureSetting::whole(*period_s)], reads_back: true, held }
}

/// Writes the value of `setting` to the exposure control.
pub(super) fn write(node: &mut dyn Node, info: &Info, setting: &ExposureSetting) -> Result<(), Errno> {
    controls::set(node, info, setting.value)
}
