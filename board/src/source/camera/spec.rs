//! A camera as a source: `v4l2:PATH[,OPTION=VALUE]...`.

use crate::v4l2::Size;
use crate::v4l2::formats;
use crate::v4l2::schedule::MAX_DELAY;
use crate::v4l2::setup::{Options, StandIn};
use hemilux_core::MAX_EXPOSURES;
use std::fmt;
use std::path::PathBuf;

/// Options of a camera source for the help text.
pub const HELP: &str = "\
A CSI camera is v4l2:NAME with the beginning of its sensor's name, v4l2:/dev/mediaN or a node that is linked to its sensor. Camera options, after the path: ,lens=FILE (a [lens] table; default: 180 degrees across the picture), ,size=640x480 (default: that of the lens file, or the mode that covers a known sensor),
,format=YUYV, ,rate=30 (default: 28, which suits lamps on the mains, where the driver has it), ,exposures=0.0009/0.0055/0.0333 (seconds; or auto: they follow the light, as they do without the option where the response is known), ,sensor=imx219 (the beginning of a sensor's name, or its sub-device), ,delay=2 (frames; default: measured),
,stand-in=Brightness:64/128/192 (for test benches: a control that replaces the exposure).";

/// The path and options of a camera source as text that was checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraSpec {
    /// The text behind `v4l2:`, as written.
    text: String,
}

impl CameraSpec {
    /// Checks `text`, the part of a source's name behind `v4l2:`.
    ///
    /// # Errors
    /// The option that was found and the values that are accepted.
    pub fn parse(text: &str) -> Result<Self, String> {
        let spec = Self { text: text.into() };
        spec.options().map(|_| spec.clone())
    }

    /// Returns the path of the lens file in the options, if they have one.
    #[must_use]
    pub fn lens(&self) -> Option<PathBuf> {
        self.pairs().find(|(name, _)| *name == "lens").map(|(_, value)| value.into())
    }

    /// Returns the path or name of the camera's device.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.text.split(',').next().unwrap_or_default().into()
    }

    /// Returns true if the options contain the option `name`.
    pub(super) fn names(&self, name: &str) -> bool {
        self.pairs().any(|(given, _)| given == name)
    }

    fn pairs(&self) -> impl Iterator<Item = (&str, &str)> {
        self.text.split(',').skip(1).map(|pair| pair.split_once('=').unwrap_or((pair, "")))
    }

    /// Parses the options of the camera.
    ///
    /// # Errors
    /// The option that was found and the values that are accepted.
    pub fn options(&self) -> Result<Options, String> {
        let mut options = Options::of(self.path());
        if options.path.as_os_str().is_empty() {
            return Err("found no device, expected v4l2:PATH, such as v4l2:/dev/video0".into());
        }
        for (name, value) in self.pairs() {
            let refuse = |expected: &str| format!("found {name}={value}, expected {expected}");
            match name {
                "lens" if !value.is_empty() => {}
                "lens" => return Err(refuse("a lens file")),
                "size" => {
                    options.size = size(value).ok_or_else(|| refuse("columns x rows, such as 640x480"))?;
                    options.full_view = false;
                }
                "format" => {
                    let known = formats::parse(value).filter(|f| formats::rank(*f).is_some());
                    options.fourcc =
                        Some(known.ok_or_else(|| refuse(&format!("one of {}", formats::names())))?);
                }
                "rate" => {
                    let rate = number(value).filter(|r| (0.1..=1000.0).contains(r));
                    options.rate_hz = rate.ok_or_else(|| refuse("0.1 to 1000 frames a second"))?;
                    options.spreads_phases = false;
                }
                "exposures" if value == "auto" => options.follows_light = true,
                "exposures" => {
                    options.exposures_s = exposures(value).ok_or_else(|| {
                        refuse(&format!(
                            "1 to {MAX_EXPOSURES} rising times in seconds, such as 0.001/0.01, or auto"
                        ))
                    })?;
                }
                "sensor" if !value.is_empty() => options.subdevice = Some(value.into()),
                "sensor" => {
                    return Err(refuse("a sensor's name or its sub-device, such as /dev/v4l-subdev0"));
                }
                "delay" => {
                    let delay = value.parse().ok().filter(|d| *d <= MAX_DELAY);
                    options.delay = Some(delay.ok_or_else(|| refuse(&format!("0 to {MAX_DELAY} frames")))?);
                }
                "stand-in" => {
                    options.stand_in = Some(
                        stand_in(value)
                            .ok_or_else(|| refuse("a control and its values, such as Gain:1/50/200"))?,
                    );
                }
                _ => {
                    let known = "lens, size, format, rate, exposures, sensor, delay or stand-in";
                    return Err(format!("found the camera option '{name}', expected {known}"));
                }
            }
        }
        if options.follows_light && options.stand_in.is_some() {
            return Err("found exposures=auto with a stand-in, expected exposures=S/S/S".into());
        }
        let values = options.stand_in.as_ref().map_or(0, |s| s.values.len());
        if values > 0 && values != options.exposures_s.len() {
            let exposures = options.exposures_s.len();
            return Err(format!(
                "found {values} stand-in values, expected {exposures}, one for each exposure"
            ));
        }
        Ok(options)
    }
}

impl fmt::Display for CameraSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|v: &f64| v.is_finite())
}

fn size(text: &str) -> Option<Size> {
    let (width, height) = text.split_once('x')?;
    let side = |t: &str| t.parse().ok().filter(|v| (2..=1 << 14).contains(v));
    Some(Size::new(side(width)?, side(height)?))
}

fn exposures(text: &str) -> Option<Vec<f64>> {
    let times: Vec<f64> =
        text.split('/').map(|t| number(t).filter(|s| (1e-6..=60.0).contains(s))).collect::<Option<_>>()?;
    (times.len() <= MAX_EXPOSURES && times.windows(2).all(|w| w[0] < w[1])).then_some(times)
}

fn stand_in(text: &str) -> Option<StandIn> {
    let (control, values) = text.split_once(':').filter(|(control, _)| !control.is_empty())?;
    let values = values.split('/').map(|v| v.parse().ok()).collect::<Option<Vec<i64>>>()?;
    (values.len() <= MAX_EXPOSURES).then(|| StandIn { control: control.into(), values })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_follow_the_path() {
        let spec = CameraSpec::parse(
            "/dev/v4l/by-path/x:1.0,size=1280x720,format=YUYV,exposures=0.001/0.02,delay=2,lens=l.toml",
        );
        let spec = spec.expect("a camera");
        let options = spec.options().expect("checked");
        assert_eq!(
            (options.size, options.exposures_s, options.delay),
            (Size::new(1280, 720), vec![0.001, 0.02], Some(2)),
            "read"
        );
        let auto = CameraSpec::parse("/dev/video0,exposures=auto").and_then(|spec| spec.options());
        assert!(auto.is_ok_and(|options| options.follows_light), "auto");
        assert_eq!(
            (spec.lens(), spec.path()),
            (Some("l.toml".into()), "/dev/v4l/by-path/x:1.0".into()),
            "read"
        );
    }

    #[test]
    fn wrong_options_are_named_with_the_accepted_values() {
        let cases = [
            ("", "no device"),
            ("/dev/video0,size=640", "size=640"),
            ("/dev/video0,format=H264", "YUYV"),
            ("/dev/video0,rate=0", "rate=0"),
            ("/dev/video0,exposures=0.01/0.001", "rising"),
            ("/dev/video0,exposures=nan", "rising"),
            ("/dev/video0,exposures=auto,stand-in=Gain:1/2/3", "exposures=S/S/S"),
            ("/dev/video0,delay=9", "0 to 8"),
            ("/dev/video0,stand-in=Gain:1/2", "2 stand-in values"),
            ("/dev/video0,colour=red", "'colour'"),
            ("/dev/video0,lens=", "a lens file"),
        ];
        for (text, named) in cases {
            let line = CameraSpec::parse(text).expect_err(text);
            assert!(
                line.contains(named) && line.contains("expected") && !line.contains('\n'),
                "{text}: {line}"
            );
        }
    }
}
