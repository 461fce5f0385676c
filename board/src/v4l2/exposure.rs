//! The controls that set a camera's exposure, and the control values for the requested exposure times.
//!
//! UVC cameras use units of 100 us within the frame interval. Sensors use lines within a frame whose length follows VBLANK. The gain is
//! constant throughout a burst: on many sensors a gain acts one frame earlier than an exposure time.

use super::Size;
use super::controls::{self, Info};
use super::{Node, abi};

/// A requested exposure time and the value of the control that sets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureSetting {
    /// Value of the exposure control for this exposure.
    pub value: i64,
    /// Exposure time that was requested for this setting, seconds.
    pub asked_s: f64,
    /// Exposure time that the control's value sets, seconds.
    pub seconds: f64,
}

impl ExposureSetting {
    /// Returns the setting of a camera whose exposure cannot be set: exposure for the whole frame interval of
    /// `period_s` seconds.
    pub(super) const fn whole(period_s: f64) -> Self {
        Self { value: 0, asked_s: period_s, seconds: period_s }
    }
}

/// The control that sets the exposure of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Knob {
    /// Properties of the exposure control, as the driver describes them.
    pub info: Info,
    /// Unit of the exposure control's values.
    pub unit: ControlUnit,
}

/// Unit of the values of the exposure control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ControlUnit {
    /// Units of 100 us, as in USB cameras (UVC).
    Uvc,
    /// Lines of a sensor; the field is the readout time of a line in seconds.
    Lines(f64),
    /// No time: on a test bench, the values are those of another control, which replaces the exposure.
    StandIn,
}

impl Knob {
    /// Finds the exposure control of `node`; `width` is the width of the sensor's frames in pixels.
    pub fn find(node: &mut dyn Node, width: u32) -> Option<Self> {
        if let Some(info) = controls::find(node, abi::EXPOSURE_ABSOLUTE).filter(Info::is_settable) {
            return Some(Self { info, unit: ControlUnit::Uvc });
        }
        let info = controls::find(node, abi::EXPOSURE).filter(Info::is_settable)?;
        Some(Self { info, unit: ControlUnit::Lines(line_s(node, width)?) })
    }

    /// Returns the shortest and the longest exposure of the control's range, seconds.
    #[must_use]
    pub fn range_s(&self) -> Option<[f64; 2]> {
        let second = self.unit.second()?;
        Some([self.info.minimum.max(1) as f64 * second, self.info.maximum as f64 * second])
    }
}

impl ControlUnit {
    /// Returns the time of one unit of the control's values, seconds; `None` if the values are no times.
    pub(super) const fn second(self) -> Option<f64> {
        match self {
            Self::Uvc => Some(1e-4),
            Self::Lines(s) => Some(s),
            Self::StandIn => None,
        }
    }
}

/// Returns the readout time of a line of the sensor, seconds, from the pixel rate and the length of the line.
fn line_s(node: &mut dyn Node, width: u32) -> Option<f64> {
    let rate = controls::find(node, abi::PIXEL_RATE).and_then(|i| controls::value(node, &i).ok())?;
    let blank = controls::find(node, abi::HBLANK).and_then(|i| controls::value(node, &i).ok())?;
    let pixels = i64::from(width).checked_add(blank)?;
    (rate > 0 && pixels > 0).then(|| pixels as f64 / rate as f64)
}

/// Black level of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlackLevel {
    /// Code of a sample of the sensor without light.
    pub code: u32,
    /// Number of bits of a sample for which `code` is stated.
    pub bits: u32,
}

impl BlackLevel {
    /// Returns the black level as a fraction of the largest code, 0 to 1.
    #[must_use]
    pub fn share(self) -> f64 {
        f64::from(self.code) / f64::from((1u32 << self.bits) - 1)
    }
}

/// Properties of a sensor model, which is found by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sensor {
    /// Prefix of the name of the sensor's sub-device.
    pub name: &'static str,
    /// Number of lines of a frame that cannot be exposed.
    pub reserve_lines: i64,
    /// Control delay of the sensor's exposure, frames after the next one.
    pub delay: u32,
    /// Black level of the sensor.
    pub black: BlackLevel,
    /// Size of the mode that images the whole sensor; smaller modes are crops.
    pub full_view: Size,
}

const fn black(code: u32, bits: u32) -> BlackLevel {
    BlackLevel { code, bits }
}

/// The table of sensor models, with values from libcamera's sensor helpers and tuning files.
const SENSORS: [Sensor; 8] = [
    Sensor {
        name: "imx219",
        reserve_lines: 4,
        delay: 2,
        black: black(64, 10),
        full_view: Size::new(1640, 1232),
    },
    Sensor {
        name: "imx477",
        reserve_lines: 22,
        delay: 2,
        black: black(256, 12),
        full_view: Size::new(2028, 1520),
    },
    Sensor {
        name: "imx500",
        reserve_lines: 22,
        delay: 2,
        black: black(256, 12),
        full_view: Size::new(2028, 1520),
    },
    Sensor {
        name: "imx519",
        reserve_lines: 32,
        delay: 2,
        black: black(64, 10),
        full_view: Size::new(2328, 1748),
    },
    Sensor {
        name: "imx708",
        reserve_lines: 48,
        delay: 2,
        black: black(64, 10),
        full_view: Size::new(2304, 1296),
    },
    Sensor {
        name: "imx296",
        reserve_lines: 4,
        delay: 2,
        black: black(60, 10),
        full_view: Size::new(1456, 1088),
    },
    Sensor {
        name: "ov5647",
        reserve_lines: 4,
        delay: 2,
        black: black(16, 10),
        full_view: Size::new(1296, 972),
    },
    Sensor {
        name: "ov9281",
        reserve_lines: 25,
        delay: 2,
        black: black(64, 10),
        full_view: Size::new(1280, 800),
    },
];

/// Number of lines of a frame that cannot be exposed, for a sensor that is not in the table: more than any
/// sensor of the table needs.
const RESERVE_LINES: i64 = 64;

/// Returns the sensor model of which `name`, the name of a sub-device, has the prefix.
#[must_use]
pub fn sensor(name: &str) -> Option<&'static Sensor> {
    SENSORS.iter().find(|s| name.starts_with(s.name))
}

/// Returns all sensor models of the table.
#[cfg(test)]
pub fn sensors() -> impl Iterator<Item = &'static Sensor> {
    SENSORS.iter()
}

/// Controls of automatic processing that changes brightness, colour or sharpness of a frame; each is set to 0.
const AUTOMATICS: [u32; 11] = [
    abi::AUTOGAIN,
    abi::AUTO_WHITE_BALANCE,
    abi::DYNAMIC_FRAME_RATE,
    abi::BACKLIGHT_COMPENSATION,
    abi::AUTO_HUE,
    abi::SHARPNESS,
    abi::AUTO_BRIGHTNESS,
    abi::AUTO_FOCUS,
    abi::WHITE_BALANCE_PRESET,
    abi::WIDE_DYNAMIC_RANGE,
    abi::AUTO_ISO,
];

/// A control that keeps one value while the camera streams.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// Properties of the control that is held at one value, as the driver describes them.
    pub info: Info,
    /// Value that was written to the held control.
    pub wanted: i64,
    /// Value that was read back after the write; `None` if the control cannot be read.
    pub found: Option<i64>,
}

impl Held {
    /// Sets control `id`, if the node has it, and reads it back.
    pub fn set(node: &mut dyn Node, id: u32, wanted: i64) -> Option<Self> {
        let info = controls::find(node, id).filter(Info::is_settable)?;
        let wanted = info.nearest(wanted);
        let _ = controls::set(node, &info, wanted);
        let found = controls::value(node, &info).ok();
        Some(Self { info, wanted, found })
    }

    /// Returns whether the value that was read back is the one that was written.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.found == Some(self.wanted)
    }
}

/// The result of switching a camera to manual exposure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Manual {
    /// Whether the exposure of the camera can be set.
    pub settable: bool,
    /// Controls of automatic processing that were set.
    pub held: Vec<Held>,
}

/// Switches the automatic processing of a node off and its exposure to manual.
pub fn go_manual(node: &mut dyn Node) -> Manual {
    let mut held: Vec<Held> = AUTOMATICS.into_iter().filter_map(|id| Held::set(node, id, 0)).collect();
    if controls::find(node, abi::EXPOSURE_AUTO).is_none() {
        return Manual { settable: true, held };
    }
    // Most cameras have only some of the manual modes; some drivers list no modes.
    let modes = abi::MANUAL_MODES.into_iter().filter(|m| controls::has_item(node, abi::EXPOSURE_AUTO, *m));
    let modes: Vec<i64> = modes.collect();
    let modes = if modes.is_empty() { abi::MANUAL_MODES.into() } else { modes };
    let mode = modes.into_iter().find_map(|m| Held::set(node, abi::EXPOSURE_AUTO, m).filter(Held::holds));
    let settable = mode.is_some();
    // The exposure mode is first in the list, since it unlocks the other controls.
    held.splice(0..0, mode);
    Manual { settable, held }
}

/// Lengthens a sensor's frame for an exposure of `longest_s` seconds and a frame interval of `period_s` seconds, and returns the frame
/// interval in seconds.
///
/// VBLANK is set alone and before the exposure, since the range of the exposure depends on it.
pub fn stretch_frame(
    node: &mut dyn Node,
    knob: &Knob,
    height: u32,
    [longest_s, period_s]: [f64; 2],
    sensor: Option<&Sensor>,
) -> Option<f64> {
    let ControlUnit::Lines(line) = knob.unit else { return None };
    let info = controls::find(node, abi::VBLANK)?;
    let reserve = sensor.map_or(RESERVE_LINES, |s| s.reserve_lines);
    let lines = |seconds: f64| (seconds / line).min(1e9);
    let lines = (lines(longest_s).ceil() as i64 + reserve).max(lines(period_s).round() as i64);
    let blank = controls::settle(node, abi::VBLANK, lines - i64::from(height)).unwrap_or(info.default);
    Some((i64::from(height) + blank) as f64 * line)
}
