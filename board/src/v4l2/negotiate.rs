//! Negotiation of the pixel format, frame size and frame rate between a node and its sensor.

use super::access::failed;
use super::device;
use super::formats::Mismatch;
use super::media::bus;
use super::options::Options;
use super::{Call, CameraError, Node, Size, abi, formats, persist};
use hemilux_core::format::Yuv;
use hemilux_core::mains::{Lamps, best_rate_of_any};
use rustix::io::Errno;
use std::path::Path;

/// Least granted frame rate, as a fraction of the requested one, that is accepted in order that successive bursts show lamps on
/// the mains at differing phases.
const SLOWEST: f64 = 0.85;

/// The media bus format in which a node receives the frames of its sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Carried {
    /// Media bus code of the frames on the pad.
    pub code: u32,
    /// Size of the frames on the pad.
    pub size: Size,
}

/// Sets the node's format to a size of `asked` pixels, or to the size that the sensor sends: with another size the stream does
/// not start.
pub(super) fn set_format(
    video: &mut dyn Node,
    carried: Option<Carried>,
    asked: Size,
    options: &Options,
) -> Result<abi::PixelFormat, CameraError> {
    let path = &options.path;
    let wished = carried.map_or(asked, |c| c.size);
    let fitting = |fourcc: u32| {
        carried.map_or_else(
            || formats::format(fourcc, Yuv::default()).is_some(),
            |carried| bus::fits(carried.code, fourcc),
        )
    };
    let offered = offered(video, carried);
    let readable = offered.iter().filter_map(|f| Some((formats::rank(formats::parse(&f.fourcc)?)?, f)));
    let named =
        |f: &device::FormatInfo| options.fourcc.is_none_or(|wished| formats::name(wished) == f.fourcc);
    let mut readable: Vec<_> =
        readable.filter(|(_, f)| named(f) && formats::parse(&f.fourcc).is_some_and(fitting)).collect();
    readable.sort_by_key(|(rank, f)| {
        let is_other = device::nearest_size(f, wished) != Some(wished) && carried.is_none();
        (is_other, is_slow(f, wished, options.rate_hz), *rank)
    });
    let Some((_, best)) = readable.first() else {
        let offers: Vec<_> = offered.iter().map(|f| f.fourcc.as_str()).collect();
        let Mismatch { found, expected } = formats::none_of(&offers);
        let expected = options.fourcc.map_or(expected, formats::name);
        return Err(CameraError::Unfit { path: path.clone(), found, expected });
    };
    let fourcc = formats::parse(&best.fourcc).unwrap_or_default();
    let Size { width, height } =
        if carried.is_some() { wished } else { device::nearest_size(best, wished).unwrap_or(wished) };
    let pixel = abi::PixelFormat { width, height, fourcc, ..Default::default() };
    let mut format = abi::Format { pixel, ..Default::default() };
    persist(|| video.call(Call::SetFormat(&mut format)))
        .map_err(|e| failed(path, "S_FMT", e, "a camera that no other program streams from"))?;
    let got = Size::new(format.pixel.width, format.pixel.height);
    if carried.is_some_and(|carried| carried.size != got) {
        let found = format!("a node of {got} pixels");
        let expected = format!("{wished} as its sensor sends");
        return Err(CameraError::Unfit { path: path.clone(), found, expected });
    }
    Ok(format.pixel)
}

/// Returns the formats of a node; only those of the media bus code `carried`, if the node lists formats by code.
fn offered(video: &mut dyn Node, carried: Option<Carried>) -> Vec<device::FormatInfo> {
    let mut caps = abi::Capability::default();
    let told = persist(|| video.call(Call::QueryCapability(&mut caps))).is_ok();
    let filters = told && caps.device_caps & abi::CAP_MEDIA != 0;
    let code = carried.filter(|_| filters).map_or(0, |c| c.code);
    device::formats(video, code)
}

/// Returns whether a format's highest frame rate at `size` is less than half of the requested rate `rate_hz`.
fn is_slow(format: &device::FormatInfo, size: Size, rate_hz: f64) -> bool {
    let rates = format.sizes.iter().filter(|s| s.size() == size).flat_map(|s| &s.rates);
    rates.copied().reduce(f64::max).is_some_and(|most| most < rate_hz / 2.0)
}

/// Sets the bits per sample, the mosaic and the size of the frames of a sensor whose node has no media graph.
pub(super) fn set_pad(sensor: &mut dyn Node, wished: Size) -> Option<Carried> {
    let offered = bus::offered(sensor, 0);
    let code = *bus::ranked(&offered).first()?;
    let mut pad = abi::PadFormat { width: wished.width, height: wished.height, code, ..Default::default() };
    persist(|| sensor.call(Call::SetPadFormat(&mut pad))).ok()?;
    bus::is_read(pad.code).then_some(Carried { code: pad.code, size: Size::new(pad.width, pad.height) })
}

/// Number of frames up to which bursts are to record lamps on the mains at different phases. For five and more, few rates have this property.
const MOST_FRAMES: usize = 4;

/// Requests the frame rate of `options` and returns the granted frame interval in seconds.
///
/// A frame rate at which successive bursts show lamps on the mains at differing phases is requested first, and accepted if the driver
/// grants a rate of that kind. The number of frames of a burst can change while the camera runs.
pub(super) fn choose_rate(video: &mut dyn Node, options: &Options) -> Result<f64, CameraError> {
    let spread = |rate_hz| best_rate_of_any(rate_hz, MOST_FRAMES, Lamps::Auto);
    let (asked, best) = (options.rate_hz, spread(options.rate_hz));
    if options.spreads_phases && options.stand_in.is_none() && best < asked {
        let period_s = set_rate(video, best, &options.path)?;
        let granted = 1.0 / period_s;
        if (SLOWEST * asked..asked).contains(&granted) && spread(granted) >= granted {
            return Ok(period_s);
        }
    }
    set_rate(video, asked, &options.path)
}

/// Requests the frame rate `rate_hz` and returns the granted frame interval in seconds. A driver whose rate cannot be set is
/// not an error.
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
