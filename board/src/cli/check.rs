//! `hemilux devices --check`: measures exposures, noise and losses of a camera, and gives advice.

use super::{Failure, say};
use crate::noise::{Noise, PhotonTransfer};
use crate::source::camera::CameraSpec;
use crate::v4l2::Kernel;
use crate::v4l2::capture::Camera;
use crate::v4l2::frame::{Counters, RawFrame};
use crate::v4l2::luma;
use crate::v4l2::real::RealKernel;
use crate::v4l2::schedule::Known;
use crate::v4l2::setup::Agreed;
use crate::v4l2::view::View;
use hemilux_core::{Format, Response};
use serde::Serialize;
use std::fmt::Write;
use std::time::Duration;

/// Largest difference between the numbers of broken and of complete frames, above which the check fails.
const MOST_BROKEN: u64 = 100;

/// Longest wait for a frame of the camera in one call.
const WAIT: Duration = Duration::from_millis(500);

#[derive(Debug, Serialize)]
struct Report {
    agreed: Vec<Agreed>,
    /// Exposure times of the camera's burst, seconds.
    exposures: Vec<f64>,
    /// Indices of the exposures whose times were measured, since they differ from the control's values.
    measured: Vec<usize>,
    /// Values of the exposure control for the exposures.
    values: Vec<i64>,
    /// Standard deviation of a sample of each exposure from frame to frame, 1 for the whole range of codes; null where it is unknown.
    noise: Vec<Option<f64>>,
    /// The noise of a sample as a function of its code; null for processed codes and for scenes that do not determine it.
    noise_model: Option<Noise>,
    /// The part of the sensor that pictures cover; null where it is unknown.
    view: Option<View>,
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
    frames: Vec<Delivered>,
}

/// A frame that the camera delivered during the check.
#[derive(Debug, Serialize)]
struct Delivered {
    sequence: u32,
    timestamp_ns: u64,
    /// CLOCK_MONOTONIC at which the frame was dequeued, nanoseconds. It shows the delay of a driver that loses frames although a buffer is
    /// free.
    arrived_ns: u64,
    /// Index of the frame's exposure; `None` if the exposure is unknown.
    exposure: Option<usize>,
    known: &'static str,
    /// Mean relative code of the frame, 0 for black and 1 for white.
    level: f32,
}

/// Checks the camera of `spec` with `count` frames and prints a report.
pub(super) fn run(spec: &CameraSpec, count: u32, json: bool) -> Result<(), Failure> {
    let wished = spec.options().map_err(Failure::usage)?;
    let mut camera = Camera::open(&mut RealKernel, &wished).map_err(Failure::new)?;
    let report = check(&mut camera, &mut RealKernel, count as usize)?;
    if json { write_json(&report) } else { say(&summary(&report)) }
}

/// Writes `value` to stdout as JSON.
pub(super) fn write_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::new)?;
    say(&(text + "\n"))
}

/// Captures `count` frames of the camera and measures their properties.
fn check(camera: &mut Camera, kernel: &mut dyn Kernel, count: usize) -> Result<Report, Failure> {
    let (mut frame, mut codes, mut frames) = (RawFrame::default(), Vec::new(), Vec::new());
    let mut noise = vec![NoiseSums::default(); camera.settings().len()];
    let (curve, most) = (camera.curve(), camera.picture().max_code());
    let mut transfer = PhotonTransfer::new(curve.black * most, LINEAR * curve.white * most);
    while frames.len() < count {
        let broken = camera.counters().broken;
        if broken.total() > MOST_BROKEN + frames.len() as u64 {
            let path = camera.path().display();
            return Err(Failure::new(format!(
                "{path}: found broken frames ({broken}), expected complete ones"
            )));
        }
        if !camera.next(kernel, WAIT, &mut frame).map_err(Failure::new)? {
            continue;
        }
        luma::sample(&camera.picture().layout, &frame.bytes, &mut codes);
        let (taken, level) = (frame.taken, luma::mean(&codes));
        if let Some(noise) = taken.slot.and_then(|slot| noise.get_mut(slot)) {
            transfer.add(
                noise.before.iter().zip(&codes).map(|(a, b)| (f64::from(*a) * most, f64::from(*b) * most)),
            );
            noise.note(&codes);
        }
        frames.push(Delivered {
            sequence: taken.sequence,
            timestamp_ns: taken.timestamp_ns,
            arrived_ns: kernel.now_ns(),
            exposure: taken.slot,
            known: taken.known.name(),
            level,
        });
    }
    let mut report = report(camera, frames);
    report.noise = noise.iter().map(NoiseSums::deviation).collect();
    let is_linear = curve.response == Response::Linear && has_one_sample(camera.picture().layout.format());
    report.noise_model = transfer.noise().filter(|_| is_linear);
    report.verdict = verdict(&report);
    Ok(report)
}

/// Part of the range from black to white in which the codes of a sensor are linear.
const LINEAR: f64 = 0.95;

/// Returns true for formats in which a sampled luminance is one sample of the sensor, so that its noise is that of a sample.
fn has_one_sample(format: Format) -> bool {
    !matches!(format, Format::Rgb24 | Format::Bgr24 | Format::Rgb48)
}

/// Range of relative codes in which noise is measured: outside of it, noise is clipped.
const MEASURED: std::ops::Range<f32> = 0.03..0.97;

/// Sums over the samples of one exposure, from which noise is computed as the difference of successive frames.
#[derive(Clone, Debug, Default)]
struct NoiseSums {
    before: Vec<f32>,
    squares: f64,
    count: u64,
}

impl NoiseSums {
    fn note(&mut self, codes: &[f32]) {
        for (old, new) in self.before.iter().zip(codes) {
            if MEASURED.contains(old) && MEASURED.contains(new) {
                self.squares += f64::from(new - old).powi(2);
                self.count += 1;
            }
        }
        self.before.clear();
        self.before.extend_from_slice(codes);
    }

    /// Returns the standard deviation of a sample: that of the differences between frames, divided by the root of two.
    fn deviation(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64 / 2.0).sqrt())
    }
}

fn report(camera: &Camera, frames: Vec<Delivered>) -> Report {
    let Counters {
        frames: delivered, lost, broken, late, failed_writes, unstamped, mismatches, resyncs, ..
    } = camera.counters();
    let span = frames
        .last()
        .zip(frames.first())
        .map(|(b, a)| (b.sequence.wrapping_sub(a.sequence), b.timestamp_ns.saturating_sub(a.timestamp_ns)));
    let rate_hz = span.filter(|(_, ns)| *ns > 0).map_or(0.0, |(n, ns)| f64::from(n) / (ns as f64 / 1e9));
    Report {
        agreed: camera.agreed().to_vec(),
        exposures: camera.seconds(),
        measured: camera.measured(),
        values: camera.settings().iter().map(|s| s.value).collect(),
        noise: Vec::new(),
        noise_model: None,
        view: camera.view(),
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
    for Agreed { what, asked, got } in &report.agreed {
        let _ = writeln!(text, "{what:<10} {asked} requested, {got} granted");
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
    if let Some(Noise { read, gain, dark }) = report.noise_model {
        let _ = writeln!(
            text,
            "{:<10} variance of a sample, codes: {read:.2}^2 + {gain:.4} x (code - {dark:.0}); for the lens file: [sensor] \
             read_noise = {read:.2}, codes_per_electron = {gain:.4}",
            "noise"
        );
    }
    for line in &report.verdict {
        let _ = writeln!(text, "{:<10} {line}", "verdict");
    }
    text
}

/// Least range of exposure times that measures both lamps and a room, stops.
const LEAST_STOPS: f64 = 4.0;

/// Least fraction of the sensor's area that contains the rim of a fisheye image.
const LEAST_SHARE: f64 = 0.9;

/// Largest acceptable standard deviation of a sample, as a fraction of the whole range of codes.
const MOST_NOISE: f64 = 0.02;

/// Largest acceptable fraction of lost or broken frames.
const MOST_LOST: f64 = 0.01;

/// Returns findings about the checked camera, each with advice.
fn verdict(report: &Report) -> Vec<String> {
    let mut all = vec![range_verdict(report), exposure_verdict(report), delay_verdict(report)];
    all.extend([frame_verdict(report), view_verdict(report), noise_verdict(report)]);
    let refused = report.agreed.iter().filter(|a| a.what == "control");
    all.extend(refused.map(|a| {
        format!(
            "control {} expected, {} found: the camera changes brightness or colour automatically",
            a.asked, a.got
        )
    }));
    all
}

fn delay_verdict(report: &Report) -> String {
    report.delay.map_or_else(
        || "the control's delay is unknown: more light while the probe starts, or delay=".into(),
        |delay| format!("an exposure acts {delay} frames after the next one: measured"),
    )
}

fn view_verdict(report: &Report) -> String {
    let Some(view) = report.view else {
        return "the part of the sensor that pictures show is unknown: compare the picture's rim with the lens's".into();
    };
    if view.share() >= LEAST_SHARE {
        return format!("pictures show {view}: enough");
    }
    format!("pictures show {view}: the rim of a fisheye is lost, a larger size=")
}

/// Describes the noise of each exposure, with advice where the lights would flicker.
fn noise_verdict(report: &Report) -> String {
    let seen = report.noise.iter().zip(&report.exposures).filter_map(|(noise, s)| Some(((*noise)?, s * 1e3)));
    let told: Vec<_> = seen.clone().map(|(n, ms)| format!("{:.2} % at {ms:.2} ms", 100.0 * n)).collect();
    let most = seen.map(|(noise, _)| noise).fold(0.0, f64::max);
    match told.join(", ") {
        told if told.is_empty() => "noise could not be measured: more or less light".into(),
        told if most <= MOST_NOISE => format!("noise is {told} of the whole range: low"),
        told => {
            format!(
                "noise is {told} of the whole range: less gain, more light, or nothing that moves in front of the lens"
            )
        }
    }
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
    format!("exposures are verified in {verified:.0} % of frames: good")
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

    fn checked(script: Script, exposures: &str) -> Report {
        let mut kernel = FakeKernel::new(script);
        let spec = CameraSpec::parse(&format!("/dev/video0,exposures={exposures}")).expect("options");
        let mut wished = spec.options().expect("options");
        wished.response = Some(Response::Linear);
        let mut camera = Camera::open(&mut kernel, &wished).expect("a camera");
        check(&mut camera, &mut kernel, 200).unwrap_or_else(|f| panic!("{}", f.line))
    }

    #[test]
    fn a_good_camera_is_accepted_and_a_bad_one_gets_advice() {
        let good = checked(Script::default(), "0.001/0.006/0.036").verdict;
        let ends = [": enough", ": good", ": measured", ": few", "the lens's", ": low"];
        assert_eq!(good.len(), ends.len(), "{good:?}");
        assert!(good.iter().zip(ends).all(|(line, end)| line.ends_with(end)), "{good:?}");
        assert!(good[0].contains("5.2 stops") && good[2].contains("acts 2 frames"), "{good:?}");

        let script = Script { loss: 0.1, noise: 12, least_sharpness: 2, ..Script::default() };
        let bad = checked(script, "0.010/0.036").verdict;
        assert!(bad[0].contains("stops, expected 4 or more") && bad[0].contains("exposures="), "{bad:?}");
        assert!(bad[3].contains("another cable") && bad[5].contains("less gain"), "{bad:?}");
        assert!(bad[6].starts_with("control Sharpness = 0 expected, 2 found"), "{bad:?}");
    }

    /// Computed by hand: uniform noise of -3 to 3 codes has a standard deviation of 2 codes of 255.
    #[test]
    fn noise_is_the_standard_deviation_of_a_sample() {
        let report = checked(Script { noise: 3, ..Script::default() }, "0.001/0.006/0.036");
        for noise in &report.noise {
            let codes = noise.expect("seen") * 255.0;
            assert!((codes - 2.0).abs() < 0.1, "{:?}", report.noise);
        }
    }

    /// Computed by hand: uniform noise of -1 to 1 codes has a variance of 2/3, rounding after photon noise one of 1/12.
    #[test]
    fn noise_model_of_a_linear_camera_is_found_and_printed_for_the_lens_file() {
        let script = Script { noise: 1, codes_per_electron: 0.1, ..Script::default() };
        let report = checked(script, "0.001/0.006/0.036");
        let Noise { read, gain, dark } = report.noise_model.expect("a model");
        assert!((gain - 0.1).abs() < 0.01 && (read - 0.75f64.sqrt()).abs() < 0.15, "{read} {gain}");
        assert_eq!(dark, 0.0);
        let text = summary(&report);
        let line = text.lines().find(|line| line.starts_with("noise ")).expect("a line of the model");
        assert!(
            line.ends_with(&format!("[sensor] read_noise = {read:.2}, codes_per_electron = {gain:.4}")),
            "{line}"
        );
        let mut kernel = FakeKernel::new(Script { noise: 1, codes_per_electron: 0.1, ..Script::default() });
        let spec = CameraSpec::parse("/dev/video0,exposures=0.001/0.006/0.036").expect("options");
        let mut camera = Camera::open(&mut kernel, &spec.options().expect("options")).expect("a camera");
        let unknown = check(&mut camera, &mut kernel, 200).unwrap_or_else(|f| panic!("{}", f.line));
        assert_eq!(
            unknown.noise_model, None,
            "the codes of a camera of unknown response are taken as processed"
        );
    }

    #[test]
    fn a_cropped_mode_is_named_and_json_has_all_values() {
        let mut kernel = FakeKernel::new(crate::v4l2::media::pi_4_script());
        let spec = CameraSpec::parse("imx219,size=640x480").expect("options");
        let mut camera = Camera::open(&mut kernel, &spec.options().expect("options")).expect("a camera");
        let report = check(&mut camera, &mut kernel, 30).unwrap_or_else(|f| panic!("{}", f.line));
        let line = &report.verdict[4];
        assert!(
            line.contains("15 % of the sensor, 1280 x 960 of 3280 x 2464") && line.contains("size="),
            "{line}"
        );
        let json = serde_json::to_value(&report).expect("JSON");
        assert_eq!(json["view"]["crop"][2], 1280, "{}", json["view"]);
        assert!(
            json["noise"].as_array().is_some_and(|n| n.len() == report.exposures.len()),
            "{}",
            json["noise"]
        );
        assert!(json["agreed"][0]["what"].is_string(), "{}", json["agreed"]);
    }
}
