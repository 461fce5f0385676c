//! The part of a sensor that a mode images.
//!
//! The small modes of most sensors are crops of the sensor's middle. Drivers report the imaged part by selection rectangles; for drivers without
//! them, a table contains the modes of common sensors.

use super::Size;
use super::exposure::Sensor;
use super::{Call, Node, abi, persist};
use crate::recorded::Shown;
use serde::Serialize;

/// Largest side of a sensor, pixels.
const MAX_SIDE: u32 = 1 << 16;

/// The part of a sensor that the pictures of a mode cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct View {
    /// Left edge, top edge, width and height of the part, in pixels of the sensor from the corner of its active area.
    pub crop: [u32; 4],
    /// Columns and rows of the sensor's active area.
    pub whole: [u32; 2],
    /// Number of sensor pixels that are combined into one pixel of the picture, across and down.
    pub binning: [u32; 2],
}

impl View {
    /// Returns the view of pictures of `size`, from `shown`, the rectangle that they cover, and `bounds`, that of the active
    /// area; `None` if the rectangles are inconsistent.
    #[must_use]
    pub fn of(size: Size, shown: [u32; 4], bounds: [u32; 4]) -> Option<Self> {
        let [x, y, width, height] = shown;
        let [left, top, columns, rows] = bounds;
        let crop = [x.checked_sub(left)?, y.checked_sub(top)?, width, height];
        let binning = [rounded(width, size.width)?, rounded(height, size.height)?];
        let inside = |at: u32, side: u32, all: u32| all <= MAX_SIDE && at <= all && side <= all - at;
        let fits = inside(crop[0], width, columns) && inside(crop[1], height, rows);
        fits.then_some(Self { crop, whole: [columns, rows], binning })
    }

    /// Returns the covered part of the sensor, without the size of the active area.
    #[must_use]
    pub const fn shown(&self) -> Shown {
        Shown { crop: self.crop, binning: self.binning }
    }

    /// Returns the fraction of the sensor's active area that pictures cover, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        let area = |w: u32, h: u32| f64::from(w) * f64::from(h);
        area(self.crop[2], self.crop[3]) / area(self.whole[0], self.whole[1])
    }
}

impl std::fmt::Display for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([_, _, width, height], [columns, rows]) = (self.crop, self.whole);
        let percent = 100.0 * self.share();
        write!(f, "{percent:.0} % of the sensor, {width} x {height} of {columns} x {rows}")
    }
}

/// Returns the integer ratio of `shown` covered sensor pixels to `pixels` picture pixels; `None` if it is not
/// between 1 and 64.
fn rounded(shown: u32, pixels: u32) -> Option<u32> {
    let ratio = (f64::from(shown) / f64::from(pixels.max(1))).round();
    (pixels > 0 && (1.0..=64.0).contains(&ratio)).then_some(ratio as u32)
}

/// A mode of a sensor: columns and rows of its pictures, and of the central part of the sensor that they cover.
struct Mode {
    sensor: &'static str,
    size: Size,
    shown: Size,
}

const fn mode(sensor: &'static str, size: [u32; 2], shown: [u32; 2]) -> Mode {
    Mode { sensor, size: Size::new(size[0], size[1]), shown: Size::new(shown[0], shown[1]) }
}

/// Modes of the kernel's drivers; the first mode of each sensor covers the whole sensor.
const MODES: [Mode; 25] = [
    mode("imx219", [3280, 2464], [3280, 2464]),
    mode("imx219", [1920, 1080], [1920, 1080]),
    mode("imx219", [1640, 1232], [3280, 2464]),
    mode("imx219", [640, 480], [1280, 960]),
    mode("imx477", [4056, 3040], [4056, 3040]),
    mode("imx477", [2028, 1520], [4056, 3040]),
    mode("imx477", [2028, 1080], [4056, 2160]),
    mode("imx477", [1332, 990], [2664, 1980]),
    mode("imx500", [4056, 3040], [4056, 3040]),
    mode("imx500", [2028, 1520], [4056, 3040]),
    mode("imx519", [4656, 3496], [4656, 3496]),
    mode("imx519", [3840, 2160], [3840, 2160]),
    mode("imx519", [2328, 1748], [4656, 3496]),
    mode("imx519", [1920, 1080], [3840, 2160]),
    mode("imx519", [1280, 720], [2560, 1440]),
    mode("imx708", [4608, 2592], [4608, 2592]),
    mode("imx708", [2304, 1296], [4608, 2592]),
    mode("imx708", [1536, 864], [3072, 1728]),
    mode("imx296", [1456, 1088], [1456, 1088]),
    mode("ov5647", [2592, 1944], [2592, 1944]),
    mode("ov5647", [1920, 1080], [1920, 1080]),
    mode("ov5647", [1296, 972], [2592, 1944]),
    mode("ov5647", [640, 480], [2560, 1920]),
    mode("ov9281", [1280, 800], [1280, 800]),
    mode("ov9281", [1280, 720], [1280, 720]),
];

/// Returns the view of the sensor's mode of `size` in the table of modes.
#[must_use]
pub fn known(sensor: &Sensor, size: Size) -> Option<View> {
    let mut modes = MODES.iter().filter(|m| m.sensor == sensor.name);
    let all = MODES.iter().find(|m| m.sensor == sensor.name)?.shown;
    let Size { width, height } = modes.find(|m| m.size == size)?.shown;
    let (left, top) = ((all.width - width) / 2, (all.height - height) / 2);
    View::of(size, [left, top, width, height], [0, 0, all.width, all.height])
}

/// Returns the view of a sensor's present mode, from the driver if it reports one, else from the table.
pub fn present(node: &mut dyn Node, sensor: Option<&Sensor>, size: Size) -> Option<View> {
    told(node, size).or_else(|| known(sensor?, size))
}

/// Returns the view that a sensor's driver reports, also for a node that reports the rectangles of its sensor.
fn told(node: &mut dyn Node, size: Size) -> Option<View> {
    let shown = rectangle(node, abi::SELECT_CROP)?;
    let bounds = rectangle(node, abi::SELECT_BOUNDS).or_else(|| rectangle(node, abi::SELECT_NATIVE))?;
    View::of(size, shown, bounds)
}

fn rectangle(node: &mut dyn Node, target: u32) -> Option<[u32; 4]> {
    let mut pad = abi::PadSelection { target, ..Default::default() };
    if persist(|| node.call(Call::GetPadSelection(&mut pad))).is_ok() {
        return Some(pad.area);
    }
    let mut own = abi::Selection { target, ..Default::default() };
    persist(|| node.call(Call::GetSelection(&mut own))).ok()?;
    Some(own.area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::exposure;

    /// Values of the drivers: 640 x 480 of imx219 covers 1280 x 960 of 3280 x 2464.
    #[test]
    fn small_modes_cover_the_middle() {
        for (name, size, crop, binning, share) in [
            ("imx219", Size::new(640, 480), [1000, 752, 1280, 960], [2, 2], 0.152),
            ("imx219", Size::new(1640, 1232), [0, 0, 3280, 2464], [2, 2], 1.0),
            ("imx477", Size::new(1332, 990), [696, 530, 2664, 1980], [2, 2], 0.428),
            ("imx708", Size::new(1536, 864), [768, 432, 3072, 1728], [2, 2], 0.444),
        ] {
            let view = known(exposure::sensor(name).expect("known"), size).expect("a mode");
            assert_eq!((view.crop, view.binning), (crop, binning), "{name} {size}");
            assert!((view.share() - share).abs() < 1e-3, "{name} {size}: {}", view.share());
        }
    }

    #[test]
    fn the_full_view_of_each_known_sensor_covers_its_area() {
        for sensor in exposure::sensors() {
            let view = known(sensor, sensor.full_view);
            assert_eq!(view.map(|v| v.share()), Some(1.0), "{}", sensor.name);
        }
    }

    #[test]
    fn contradictory_rectangles_are_refused() {
        let bounds = [8, 8, 3280, 2464];
        assert!(View::of(Size::new(640, 480), [1008, 760, 1280, 960], bounds).is_some(), "as imx219 tells");
        for shown in [[0, 0, 1280, 960], [8, 8, 3281, 2464], [u32::MAX, 8, 640, 480], [8, 8, 0, 0]] {
            assert_eq!(View::of(Size::new(640, 480), shown, bounds), None, "{shown:?}");
        }
        assert_eq!(View::of(Size::new(0, 0), bounds, bounds), None, "no picture");
        assert_eq!(
            View::of(Size::new(640, 480), [0, 0, u32::MAX, u32::MAX], [0, 0, u32::MAX, u32::MAX]),
            None,
            "huge"
        );
    }
}
