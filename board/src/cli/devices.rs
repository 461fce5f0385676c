//! `hemilux devices`: which cameras there are, and whether one keeps what it promises.

use super::{Failure, say};
use crate::source::camera::CameraSpec;
use crate::v4l2::Kernel;
use crate::v4l2::capture::Camera;
use crate::v4l2::device::{self, Description};
use crate::v4l2::frame::{Counters, RawFrame};
use crate::v4l2::luma;
use crate::v4l2::real::RealKernel;
use crate::v4l2::schedule::Known;
use clap::Args;
use serde::Serialize;
use std::fmt::Write;
use std::time::Duration;

/// Most broken frames beyond the number of complete ones.
const MOST_BROKEN: u64 = 100;

#[derive(Clone, Debug, Args)]
pub(super) struct Devices {
    /// Write JSON.
    #[arg(long)]
    json: bool,
    /// Stream from this camera instead, v4l2:PATH with its options, and report every frame's number, time, exposure and brightness.
    #[arg(long, value_name = "SOURCE", value_parser = camera)]
    check: Option<CameraSpec>,
    /// Frames to check.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "check", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
}

/// A camera's name on the command line.
pub(super) fn camera(text: &str) -> Result<CameraSpec, String> {
    CameraSpec::parse(text.strip_prefix("v4l2:").ok_or("expected v4l2:PATH, such as v4l2:/dev/video0")?)
}

pub(super) fn run(options: &Devices) -> Result<(), Failure> {
    if let Some(spec) = &options.check {
        return check(spec, options);
    }
    let cameras = device::list(&mut RealKernel).map_err(Failure::new)?;
    if options.json {
        return json(&cameras);
    }
    if cameras.is_empty() {
        return say("no cameras: no /dev/video* that captures\n");
    }
    cameras.iter().try_for_each(|camera| say(&told(camera)))
}

fn json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::new)?;
    say(&(text + "\n"))
}

fn told(camera: &Description) -> String {
    let mut text =
        format!("{}  {} ({}, {})\n", camera.path.display(), camera.name, camera.driver, camera.bus);
    if let Some(sensor) = &camera.sensor {
        let _ = writeln!(text, "  sensor    {}", sensor.display());
    }
    let exposure = camera.exposure_s.map(|(a, b)| format!("{:.3} to {:.3} ms", a * 1e3, b * 1e3));
    let gain = camera.gain.map(|(a, b)| format!("{a} to {b}"));
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

#[derive(Serialize)]
struct Report {
    agreed: Vec<(&'static str, String, String)>,
    /// Seconds.
    exposures: Vec<f64>,
    /// Indices of those that were measured, because they are not the control's.
    measured: Vec<usize>,
    /// Of the control that makes them.
    values: Vec<i64>,
    delay: Option<u32>,
    rate_hz: f64,
    delivered: u64,
    lost: u64,
    broken: u64,
    broken_kinds: String,
    verdict: Vec<String>,
    late: u64,
    failed_writes: u64,
    unstamped: u64,
    mismatches: u64,
    resyncs: u64,
    frames: Vec<Seen>,
}

/// One frame.
#[derive(Serialize)]
struct Seen {
    sequence: u32,
    timestamp_ns: u64,
    /// CLOCK_MONOTONIC when it was there for us: a driver that loses frames although a buffer waits for it is itself late.
    arrived_ns: u64,
    /// Index into the exposures.
    exposure: Option<usize>,
    known: &'static str,
    /// Mean relative code, 0 black to 1 white.
    level: f32,
}

fn check(spec: &CameraSpec, options: &Devices) -> Result<(), Failure> {
    let wished = spec.options().map_err(Failure::usage)?;
    let mut camera = Camera::open(&mut RealKernel, &wished).map_err(Failure::new)?;
    let (mut frame, mut codes, mut frames) = (RawFrame::default(), Vec::new(), Vec::new());
    while frames.len() < options.frames as usize {
        let broken = camera.counters().broken;
        if broken.total() > MOST_BROKEN + frames.len() as u64 {
            let path = camera.path().display();
            return Err(Failure::new(format!(
                "{path}: found broken frames ({broken}), expected complete ones"
            )));
        }
        if camera.next(&mut RealKernel, Duration::from_millis(500), &mut frame).map_err(Failure::new)? {
            luma::sample(&camera.picture().layout, &frame.bytes, &mut codes);
            let (taken, level) = (frame.taken, luma::mean(&codes));
            let known = taken.known.name();
            frames.push(Seen {
                sequence: taken.sequence,
                timestamp_ns: taken.timestamp_ns,
                arrived_ns: RealKernel.now_ns(),
                exposure: taken.slot,
                known,
                level,
            });
        }
    }
    let mut report = report(&camera, frames);
    report.verdict = verdict(&report);
    if options.json { json(&report) } else { say(&summary(&report)) }
}

fn report(camera: &Camera, frames: Vec<Seen>) -> Report {
    let Counters { frames: delivered, lost, broken, late, failed_writes, unstamped, mismatches, resyncs } =
        camera.counters();
    let span = frames
        .last()
        .zip(frames.first())
        .map(|(b, a)| (b.sequence - a.sequence, b.timestamp_ns.saturating_sub(a.timestamp_ns)));
    let rate_hz = span.filter(|(_, ns)| *ns > 0).map_or(0.0, |(n, ns)| f64::from(n) / (ns as f64 / 1e9));
    Report {
        agreed: camera.agreed().iter().map(|a| (a.what, a.asked.clone(), a.got.clone())).collect(),
        exposures: camera.seconds(),
        measured: camera.measured(),
        values: camera.settings().iter().map(|s| s.value).collect(),
        delay: camera.delay(),
        rate_hz,
        delivered,
        lost,
        broken: broken.total(),
        broken_kinds: broken.to_string(),
        verdict: Vec::new(),
        late,
        failed_writes,
        unstamped,
        mismatches,
        resyncs,
        frames,
    }
}

fn summary(report: &Report) -> String {
    let mut text = String::new();
    for (what, asked, got) in &report.agreed {
        let _ = writeln!(text, "{what:<10} {asked} asked, {got} got");
    }
    let delay = report
        .delay
        .map_or("unknown: too dark, or nothing changes".into(), |d| format!("{d} frames after the next"));
    let _ = writeln!(text, "{:<10} {delay}", "delay");
    let _ = writeln!(
        text,
        "{:<10} {:.2} Hz measured, {} frames, {} lost, broken: {}, {} stamped by another clock",
        "frames", report.rate_hz, report.delivered, report.lost, report.broken_kinds, report.unstamped
    );
    let count = |known: Known| report.frames.iter().filter(|f| f.known == known.name()).count();
    let all = [Known::Verified, Known::Measured, Known::Predicted, Known::Unknown]
        .map(|k| format!("{} {}", count(k), k.name()));
    let _ = writeln!(text, "{:<10} {}", "exposures", all.join(", "));
    for slot in &report.measured {
        let seconds = report.exposures.get(*slot).copied().unwrap_or_default();
        let _ = writeln!(
            text,
            "{:<10} exposure {} is {:.2} ms by brightness",
            "measured",
            slot + 1,
            seconds * 1e3
        );
    }
    let _ = writeln!(
        text,
        "{:<10} {} writes left out as late, {} refused, {} mismatches, {} resynchronisations",
        "schedule", report.late, report.failed_writes, report.mismatches, report.resyncs
    );
    for line in &report.verdict {
        let _ = writeln!(text, "{:<10} {line}", "verdict");
    }
    text
}

/// Least range of exposures with which lamps and a room are both measured, stops.
const LEAST_STOPS: f64 = 4.0;

/// Largest share of frames that may be lost or broken.
const MOST_LOST: f64 = 0.01;

/// Statements about a checked camera, and what to change.
fn verdict(report: &Report) -> Vec<String> {
    vec![range_verdict(report), exposure_verdict(report), frame_verdict(report)]
}

fn range_verdict(report: &Report) -> String {
    let ends = report.exposures.first().zip(report.exposures.last());
    let stops = ends.map_or(0.0, |(shortest, longest)| (longest / shortest).log2());
    if stops >= LEAST_STOPS {
        return format!("exposures span {stops:.1} stops: enough");
    }
    format!(
        "exposures span {stops:.1} stops, expected {LEAST_STOPS} or more: a shorter first or a longer last time in exposures=, or a \
         camera with an exposure control"
    )
}

fn exposure_verdict(report: &Report) -> String {
    let percent = |known: Known| {
        let found = report.frames.iter().filter(|f| f.known == known.name()).count();
        100.0 * found as f64 / report.frames.len().max(1) as f64
    };
    let (verified, measured) = (percent(Known::Verified), percent(Known::Measured));
    if verified + measured < 50.0 {
        return format!(
            "exposures are verified in {verified:.0} % of frames: more light, or a lens file with the camera's [response]"
        );
    }
    if measured > verified {
        return format!(
            "exposures are measured in {measured:.0} % of frames: the control's values are wrong"
        );
    }
    format!("exposures are verified in {verified:.0} % of frames: true")
}

fn frame_verdict(report: &Report) -> String {
    let bad = report.lost + report.broken;
    let share = bad as f64 / (report.delivered + bad).max(1) as f64;
    let percent = 100.0 * share;
    if share <= MOST_LOST {
        return format!("{percent:.1} % of frames are lost or broken: few");
    }
    format!(
        "{percent:.1} % of frames are lost or broken: another cable, port or power supply, a smaller size= or a lower rate="
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::fake::{FakeKernel, Script};
    use crate::v4l2::frame::Taken;

    fn checked(loss: f64, exposures: &str) -> Vec<String> {
        let mut kernel = FakeKernel::new(Script { loss, ..Script::default() });
        let spec = CameraSpec::parse(&format!("/dev/video0,exposures={exposures}")).expect("options");
        let mut wished = spec.options().expect("options");
        wished.response = Some(hemilux_core::Response::Linear);
        let mut camera = Camera::open(&mut kernel, &wished).expect("a camera");
        let (mut frame, mut frames) = (RawFrame::default(), Vec::new());
        while frames.len() < 200 {
            if camera.next(&mut kernel, Duration::from_millis(500), &mut frame).expect("a frame") {
                let Taken { sequence, timestamp_ns, slot, known } = frame.taken;
                let (arrived_ns, known) = (timestamp_ns, known.name());
                frames.push(Seen { sequence, timestamp_ns, arrived_ns, exposure: slot, known, level: 0.5 });
            }
        }
        verdict(&report(&camera, frames))
    }

    #[test]
    fn a_good_camera_is_called_good_and_a_bad_one_gets_advice() {
        let good = checked(0.0, "0.001/0.006/0.036");
        assert!(good[0].contains("5.2 stops: enough"), "{good:?}");
        assert!(good[1].ends_with("true") && good[2].ends_with("few"), "{good:?}");
        let bad = checked(0.1, "0.010/0.036");
        assert!(bad[0].contains("1.8 stops") && bad[0].contains("exposures="), "{bad:?}");
        assert!(bad[2].contains("another cable"), "{bad:?}");
    }
}
