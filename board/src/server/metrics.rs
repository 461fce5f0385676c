//! `/metrics`, in the text format 0.0.4 of Prometheus.
//!
//! The text is written without a crate: `prometheus-client` writes OpenMetrics, another format, and `prometheus` stores the values in a registry,
//! whereas all values exist already and are read once per request. The tests parse the text with `prometheus-parse`.

use super::Context;
use super::counts::{CLASSES, Counts, DELIVERY_US};
use super::paths::PATHS;
use crate::camera_status::CameraStatus;
use crate::light_set::OwnedSet;
use crate::probe::QualityStatus;
use crate::timing::Timings;
use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use hemilux_core::color::luminance;
use hemilux_core::wire::{Latency, Step};
use std::fmt::Write;
use std::sync::atomic::Ordering::Relaxed;

/// Answers with the counters and measurements of the probe and the server.
pub(super) async fn metrics(State(context): State<Context>) -> Response {
    let mut text = String::with_capacity(8 << 10);
    let link = &context.link;
    let latest = link.sets().latest();
    let up = f64::from(u8::from(link.status().failure().is_none()));
    one(&mut text, "source_up", "gauge", "1 while the source delivers bursts, else 0.", up);
    one(
        &mut text,
        "uptime_seconds",
        "gauge",
        "Time since the probe started.",
        link.started().elapsed().as_secs_f64(),
    );
    if let Some(set) = &latest {
        frames(&mut text, set, link.staleness(set).age_ms);
        let timings = link.durations().timings();
        let rate_hz = timings.rate_hz().into();
        one(&mut text, "frame_rate_hertz", "gauge", "Frames per second, smoothed.", rate_hz);
        stages(&mut text, &timings);
    }
    if let Some(status) = link.camera() {
        camera(&mut text, &status);
    }
    head(
        &mut text,
        "frames_left_out_total",
        "counter",
        "Frames that contradicted their burst and were not merged, by reason.",
    );
    for (why, count) in link.status().frames_left_out() {
        let _ = writeln!(text, "hemilux_frames_left_out_total{{why=\"{why}\"}} {count}");
    }
    quality(&mut text, &link.status().quality());
    connections(&mut text, &context.counts);
    requests(&mut text, &context.counts);
    delivery(&mut text, &context.counts);
    ([(CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

/// Writes the present reductions of quality and the numbers of changes.
fn quality(text: &mut String, quality: &QualityStatus) {
    head(text, "degraded_steps", "gauge", "Steps by which the quality is lowered to keep the budget.");
    for step in Step::ALL {
        let (name, count) = (step.name(), quality.steps.count(step));
        let _ = writeln!(text, "hemilux_degraded_steps{{step=\"{name}\"}} {count}");
    }
    head(text, "quality_steps_total", "counter", "Changes of the quality, by their direction.");
    for (direction, count) in [("down", quality.down), ("up", quality.up)] {
        let _ = writeln!(text, "hemilux_quality_steps_total{{direction=\"{direction}\"}} {count}");
    }
}

fn head(text: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(text, "# HELP hemilux_{name} {help}\n# TYPE hemilux_{name} {kind}");
}

fn one(text: &mut String, name: &str, kind: &str, help: &str, value: f64) {
    head(text, name, kind, help);
    let _ = writeln!(text, "hemilux_{name} {value}");
}

fn frames(text: &mut String, set: &OwnedSet, age_ms: u64) {
    one(text, "frames_total", "counter", "Frames finished.", set.frame as f64 + 1.0);
    one(text, "frame_age_seconds", "gauge", "Time since the end of the last burst.", age_ms as f64 / 1e3);
    one(text, "lights", "gauge", "Lights of the last set.", set.lights.len() as f64);
    one(text, "clipped_ratio", "gauge", "Clipped share of the hemisphere.", set.clipped.into());
    one(
        text,
        "unseen_ratio",
        "gauge",
        "Share of the hemisphere outside of the lens's field.",
        set.unseen.into(),
    );
    if let Some(error) = set.estimated_error {
        one(text, "estimated_error_ratio", "gauge", "The sampler's estimate of its error.", error.into());
    }
    head(text, "stage_seconds", "gauge", "Time that the last frame spent in each stage.");
    for (stage, us) in Latency::NAMES.iter().zip(set.latency.all()) {
        let _ = writeln!(text, "hemilux_stage_seconds{{stage=\"{stage}\"}} {}", f64::from(us) / 1e6);
    }
    light(text, set);
}

/// Writes the horizontal irradiance and the scalar flux of the light set `set`.
fn light(text: &mut String, set: &OwnedSet) {
    let channels = |text: &mut String, name: &str, values: [f32; 3]| {
        for (channel, v) in ["red", "green", "blue"].iter().zip(values) {
            let _ = writeln!(text, "hemilux_{name}{{channel=\"{channel}\"}} {v}");
        }
    };
    head(text, "irradiance", "gauge", "Horizontal irradiance of the last frame, in the light sets' unit.");
    channels(text, "irradiance", set.horizontal_irradiance);
    head(
        text,
        "scalar_flux",
        "gauge",
        "Radiance summed over all directions without a cosine, in the same unit.",
    );
    channels(text, "scalar_flux", set.scalar_flux);
    if let Some(uncertainty) = set.unit_uncertainty {
        let lux = |rgb| f64::from(luminance(rgb));
        let what = "Illuminance of a level surface.";
        one(text, "horizontal_illuminance_lux", "gauge", what, lux(set.horizontal_irradiance));
        let what = "Illuminance from all directions without a cosine.";
        one(text, "scalar_illuminance_lux", "gauge", what, lux(set.scalar_flux));
        let what = "Relative uncertainty of the unit lux, with 95 % coverage.";
        one(text, "unit_uncertainty_ratio", "gauge", what, uncertainty.into());
    }
}

/// Writes the state of the camera's exposures and frames.
fn camera(text: &mut String, status: &CameraStatus) {
    let frames = &status.frames;
    head(text, "camera_frames_total", "counter", "Complete frames, by the origin of their exposure.");
    for (known, count) in status.known.named() {
        let _ = writeln!(text, "hemilux_camera_frames_total{{exposure=\"{known}\"}} {count}");
    }
    head(text, "camera_broken_total", "counter", "Dropped frames, by their fault.");
    for (fault, count) in frames.broken() {
        let _ = writeln!(text, "hemilux_camera_broken_total{{fault=\"{fault}\"}} {count}");
    }
    one(text, "camera_lost_total", "counter", "Frames that the driver did not deliver.", frames.lost as f64);
    let unstamped = "Complete frames whose timestamp is not of CLOCK_MONOTONIC.";
    one(text, "camera_unstamped_total", "counter", unstamped, frames.unstamped as f64);
    head(text, "camera_writes_total", "counter", "Writes of the exposure without effect, by their fault.");
    for (fault, count) in [("late", status.late_writes), ("refused", status.failed_writes)] {
        let _ = writeln!(text, "hemilux_camera_writes_total{{fault=\"{fault}\"}} {count}");
    }
    let mismatches = "Frames whose brightness contradicts their exposure.";
    one(text, "camera_mismatches_total", "counter", mismatches, status.mismatches as f64);
    one(
        text,
        "camera_reopened_total",
        "counter",
        "Times that the camera was opened again.",
        status.reopened as f64,
    );
    if let Some(view) = status.view {
        one(text, "camera_view_ratio", "gauge", "Share of the sensor that pictures show.", view.share);
    }
    head(text, "camera_exposure_seconds", "gauge", "Exposures of the last burst.");
    for (at, exposure) in status.exposures.iter().enumerate() {
        let labels = format!("exposure=\"{at}\",known=\"{}\"", exposure.known);
        let _ = writeln!(text, "hemilux_camera_exposure_seconds{{{labels}}} {}", exposure.seconds);
    }
}

/// Writes, for each stage, percentiles of the duration since the start, the budget, and the number of frames
/// that exceeded it.
fn stages(text: &mut String, timings: &Timings) {
    let stages = || Latency::NAMES.iter().zip(timings.stages());
    head(
        text,
        "stage_quantile_seconds",
        "gauge",
        "Quantile of the stage's duration over all frames; 1 is the longest.",
    );
    for (stage, s) in stages() {
        for (quantile, us) in [("0.5", s.p50), ("0.95", s.p95), ("0.99", s.p99), ("1", s.most)] {
            let labels = format!("stage=\"{stage}\",quantile=\"{quantile}\"");
            let _ = writeln!(text, "hemilux_stage_quantile_seconds{{{labels}}} {}", f64::from(us) / 1e6);
        }
    }
    let help = "Quantile of the stage's duration over the last 30 to 60 seconds.";
    head(text, "stage_recent_seconds", "gauge", help);
    for (stage, s) in stages() {
        for (quantile, us) in [("0.5", s.recent.p50), ("0.95", s.recent.p95), ("0.99", s.recent.p99)] {
            let labels = format!("stage=\"{stage}\",quantile=\"{quantile}\"");
            let _ = writeln!(text, "hemilux_stage_recent_seconds{{{labels}}} {}", f64::from(us) / 1e6);
        }
    }
    head(text, "stage_budget_seconds", "gauge", "Budget of each stage.");
    for (stage, s) in stages() {
        let budget = f64::from(s.budget) / 1e6;
        let _ = writeln!(text, "hemilux_stage_budget_seconds{{stage=\"{stage}\"}} {budget}");
    }
    head(text, "stage_overruns_total", "counter", "Frames that exceeded the budget in effect.");
    for (stage, s) in stages() {
        let _ = writeln!(text, "hemilux_stage_overruns_total{{stage=\"{stage}\"}} {}", s.overruns);
    }
}

fn connections(text: &mut String, counts: &Counts) {
    one(text, "connections", "gauge", "Connections open now.", counts.open.load(Relaxed) as f64);
    one(text, "connections_total", "counter", "Accepted connections.", counts.accepted.load(Relaxed) as f64);
    one(
        text,
        "streams",
        "gauge",
        "Event streams and WebSockets open now.",
        counts.streams.load(Relaxed) as f64,
    );
    head(text, "refused_total", "counter", "Requests and connections refused, by reason.");
    for (reason, count) in counts.refusals() {
        let _ = writeln!(text, "hemilux_refused_total{{reason=\"{reason}\"}} {count}");
    }
}

fn requests(text: &mut String, counts: &Counts) {
    head(text, "requests_total", "counter", "Requests answered, by path and class of status.");
    let paths = PATHS.iter().copied().chain(["other"]);
    for (path, classes) in paths.zip(&counts.requests) {
        for (class, count) in (1..=CLASSES).zip(classes) {
            let count = count.load(Relaxed);
            if count > 0 {
                let _ =
                    writeln!(text, "hemilux_requests_total{{path=\"{path}\",status=\"{class}xx\"}} {count}");
            }
        }
    }
}

fn delivery(text: &mut String, counts: &Counts) {
    let help = "Time from the finished light set to the answer's transfer to the connection.";
    head(text, "delivery_seconds", "histogram", help);
    let mut sum = 0;
    for (i, count) in counts.delivery.iter().enumerate() {
        sum += count.load(Relaxed);
        let bound = DELIVERY_US.get(i).map_or("+Inf".into(), |us| (*us as f64 / 1e6).to_string());
        let _ = writeln!(text, "hemilux_delivery_seconds_bucket{{le=\"{bound}\"}} {sum}");
    }
    let seconds = counts.delivery_us.load(Relaxed) as f64 / 1e6;
    let _ = writeln!(text, "hemilux_delivery_seconds_sum {seconds}\nhemilux_delivery_seconds_count {sum}");
}
