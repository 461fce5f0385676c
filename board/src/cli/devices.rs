//! `hemilux devices`: the list of cameras, and a check of one camera.

use super::{Failure, check, say};
use crate::source::camera::CameraSpec;
use crate::v4l2::device::{self, Description};
use crate::v4l2::real::RealKernel;
use clap::Args;
use std::fmt::Write;

#[derive(Clone, Debug, Args)]
pub(super) struct Devices {
    /// Write the result as JSON.
    #[arg(long)]
    json: bool,
    /// Stream from this camera, v4l2:PATH with its options, and report number, time, exposure and brightness of every frame.
    #[arg(long, value_name = "SOURCE", value_parser = camera)]
    check: Option<CameraSpec>,
    /// Number of frames to check.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "check", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
}

/// Parses a camera and its options, as written on the command line.
pub(super) fn camera(text: &str) -> Result<CameraSpec, String> {
    CameraSpec::parse(text.strip_prefix("v4l2:").ok_or("expected v4l2:PATH, such as v4l2:/dev/video0")?)
}

pub(super) fn run(options: &Devices) -> Result<(), Failure> {
    if let Some(spec) = &options.check {
        return check::run(spec, options.frames, options.json);
    }
    let cameras = device::list(&mut RealKernel).map_err(Failure::new)?;
    if options.json {
        return check::write_json(&cameras);
    }
    if cameras.is_empty() {
        return say("no cameras: no /dev/video* that captures\n");
    }
    cameras.iter().try_for_each(|camera| say(&told(camera)))
}

fn told(camera: &Description) -> String {
    let mut text =
        format!("{}  {} ({}, {})\n", camera.path.display(), camera.name, camera.driver, camera.bus);
    if let Some(sensor) = &camera.sensor {
        let _ = writeln!(text, "  sensor    {}", sensor.display());
    }
    if let Some(name) = &camera.sensor_name {
        let _ = writeln!(text, "  name      v4l2:{name}");
    }
    for mode in &camera.modes {
        let view = mode.view.map_or("an unknown part of the sensor".into(), |view| view.to_string());
        let _ = writeln!(text, "  mode      {} x {}  {view}", mode.width, mode.height);
    }
    let exposure = camera.exposure_s.map(|[a, b]| format!("{:.3} to {:.3} ms", a * 1e3, b * 1e3));
    let gain = camera.gain.map(|[a, b]| format!("{a} to {b}"));
    let _ = writeln!(text, "  exposure  {}", exposure.as_deref().unwrap_or("no control"));
    let _ = writeln!(text, "  gain      {}", gain.as_deref().unwrap_or("no control"));
    for format in &camera.formats {
        let note = if format.readable { "" } else { ", not read" };
        let _ = writeln!(text, "  {:<9} {}{note}", format.fourcc, format.description);
        for size in &format.sizes {
            let short = |r: &f64| format!("{r:.2}").trim_end_matches('0').trim_end_matches('.').to_owned();
            let rates: Vec<String> = size.rates.iter().map(short).collect();
            let _ = writeln!(text, "            {} x {}  {} Hz", size.width, size.height, rates.join(" "));
        }
    }
    text
}
