//! The negotiated terms of a camera: format, frame interval, exposures and view.

use crate::calibration::Calibration;
use crate::exposure_plan::TimeRange;
use crate::recorded::LensFile;
use crate::v4l2::Size;
use crate::v4l2::capture::Camera;
use crate::v4l2::formats::{self, Picture};
use crate::v4l2::setup::Options;
use crate::v4l2::view::View;
use glam::DVec2;
use hemilux_core::format::{Format, Layout, Yuv};
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::{Levels, Response};

/// Exposure times of most webcams at 30 Hz, which are assumed while the camera is absent.
const USUAL_RANGE: TimeRange = TimeRange { shortest_s: 1e-4, longest_s: 0.0333, step_s: 1e-4 };

/// The negotiated properties of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms {
    /// Size and pixel format of the frames.
    pub picture: Picture,
    /// Relative code of black, 0 to 1, where the sensor is known; 0 otherwise.
    pub black: f64,
    /// Interval between frames of the camera, nanoseconds.
    pub period_ns: u64,
    /// The exposure times of a burst, seconds, ascending.
    pub seconds: Vec<f64>,
    /// The part of the sensor that pictures cover, where it is known.
    pub view: Option<View>,
    /// Range of exposure times that the exposure control accepts; `None` if the exposures cannot be set.
    pub range: Option<TimeRange>,
    /// Number of requests for other exposure times that were made before these terms.
    pub requests: u64,
}

impl Terms {
    /// Returns the terms of an open camera after `requests` requests for other exposure times.
    pub(super) fn of(camera: &Camera, requests: u64) -> Self {
        Self {
            picture: *camera.picture(),
            black: camera.black(),
            period_ns: camera.period().as_nanos() as u64,
            seconds: camera.seconds(),
            view: camera.view(),
            range: camera.range(),
            requests,
        }
    }

    /// Returns the terms that are assumed while the camera is absent: the requested size and exposures, in the pixel format of most webcams.
    pub(in crate::source) fn assumed(options: &Options) -> Self {
        let yuv = Yuv { limited: true, ..Yuv::default() };
        let wished = options.fourcc.filter(|fourcc| !formats::is_jpeg(*fourcc));
        let fourcc = wished.unwrap_or(u32::from_le_bytes(*b"YUYV"));
        let Size { width, height } = options.size;
        let format = formats::format(fourcc, yuv).unwrap_or(Format::Grey);
        // The camera will round or refuse the size if it is odd or very large.
        let layout = Layout::tight(format, width, height);
        let layout =
            layout.or_else(|_| Layout::tight(format, 640, 480)).expect("640 x 480 suits all formats");
        let period_ns = (1e9 / options.rate_hz) as u64;
        Self {
            picture: Picture { fourcc, layout, jpeg: None },
            black: 0.0,
            period_ns,
            seconds: options.exposures_s.clone(),
            view: None,
            range: options.stand_in.is_none().then_some(USUAL_RANGE),
            requests: 0,
        }
    }

    /// Returns the calibration of the lens file. Values that the file does not contain follow from the pixel format: raw frames are linear,
    /// processed frames are taken to have the sRGB curve.
    pub(in crate::source) fn calibration(&self, lens: Option<&LensFile>) -> Calibration {
        let (picture, layout) = (&self.picture, &self.picture.layout);
        let most = picture.max_code();
        let usual = if picture.is_raw() { Response::Linear } else { Response::Srgb };
        let (black, white) =
            lens.and_then(|l| l.levels).map(|l| (l.black, l.white)).unwrap_or((self.black * most, most));
        let shrink = picture.jpeg.map_or(1, |jpeg| jpeg.shrink);
        let lens_file = lens.map(|file| shrunk(self.lens_of(file), shrink));
        let mut calibration = Calibration::new(lens_file.unwrap_or_else(|| assumed_lens(layout)), *layout);
        calibration.compressed = picture.jpeg.is_some();
        calibration.response = lens.and_then(LensFile::told_response).unwrap_or(usual);
        calibration.levels = Levels { black, white };
        calibration
    }
}

impl Terms {
    /// Returns the lens of the camera's frames: that of the file, converted if the frames cover another part of the sensor.
    fn lens_of(&self, file: &LensFile) -> Lens {
        let converted =
            file.shown.zip(self.view).and_then(|(from, to)| from.convert(&file.lens, &to.shown()));
        converted.unwrap_or(file.lens)
    }
}

/// Returns `lens` for pictures that are scaled down by `shrink`, a power of two.
fn shrunk(lens: Lens, shrink: u32) -> Lens {
    (0..shrink.ilog2()).fold(lens, |lens, _| lens.halved())
}

/// Returns the lens that is assumed without a lens file: an equidistant fisheye of 180 degrees across the shorter side of the picture.
fn assumed_lens(layout: &Layout) -> Lens {
    let (width, height) = (f64::from(layout.width()), f64::from(layout.height()));
    let mut vignetting = [0.0; 8];
    vignetting[0] = 1.0;
    let lens = Lens::try_new(Intrinsics {
        model: Model::Equidistant,
        centre_px: DVec2::new((width - 1.0) / 2.0, (height - 1.0) / 2.0),
        focal_px: DVec2::splat(width.min(height) / std::f64::consts::PI),
        skew_px: 0.0,
        max_theta: std::f64::consts::FRAC_PI_2,
        vignetting,
    });
    lens.expect("an equidistant lens of 180 degrees is a lens")
}
