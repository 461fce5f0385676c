//! `/v1/status`: rates, durations and counters of the probe as JSON.

use super::access::Access;
use super::origin::Sender;
use super::{Context, config};
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use hemilux_core::mains::Flicker;
use hemilux_core::wire::Latency;
use serde_json::json;
use std::sync::atomic::Ordering::Relaxed;

/// Answers with the state of the source, of the newest frame, of the stages and of the connections.
pub(super) async fn status(State(context): State<Context>, sender: Sender) -> Response {
    let link = &context.link;
    let latest = link.sets().latest();
    let timings = link.durations().timings();
    let frame = latest.as_ref().map(|set| {
        let names = Latency::NAMES.iter().map(ToString::to_string);
        let latency: serde_json::Map<_, _> = names.zip(set.latency.all().map(Into::into)).collect();
        json!({
            "frame": set.frame, "age_ms": link.staleness(set).age_ms, "rate_hz": timings.rate_hz(), "lights": set.lights.len(),
            "sampler": set.sampler, "clipped": set.clipped, "unseen": set.unseen, "estimated_error": set.estimated_error,
            "unit": set.unit.name(), "unit_uncertainty": set.unit_uncertainty,
            "horizontal_irradiance": set.horizontal_irradiance, "scalar_flux": set.scalar_flux,
            "latency_us": latency, "overrun": set.overrun.names().collect::<Vec<_>>(),
        })
    });
    let mains = latest.as_ref().map(|set| set.flicker).filter(|flicker| *flicker != Flicker::NONE);
    let mains = mains.map(|f| json!({"frequency_hz": f.frequency_hz, "depth": f.depth, "share": f.share}));
    let stages = Latency::NAMES.iter().zip(timings.stages()).map(|(name, s)| {
        json!({"stage": name, "budget_us": s.budget, "overruns": s.overruns,
            "p50_us": s.p50, "p95_us": s.p95, "p99_us": s.p99, "max_us": s.most,
            "last_minute": {"p50_us": s.recent.p50, "p95_us": s.recent.p95, "p99_us": s.recent.p99}})
    });
    let tiers: Vec<_> = link
        .tiers()
        .in_use()
        .iter()
        .map(|t| json!({"lights": t.lights, "ambient": t.ambient, "soft": t.soft}))
        .collect();
    let quality = link.status().quality();
    let document = json!({
        "degraded": {"steps": quality.steps.names().collect::<Vec<_>>(), "down": quality.down, "up": quality.up},
        "tiers": {"most": link.tiers().most(), "in_use": tiers},
        "version": env!("CARGO_PKG_VERSION"),
        "run": link.run(),
        "source": link.source(),
        "fault": link.status().failure(),
        "frames_left_out": link.status().frames_left_out().collect::<std::collections::BTreeMap<_, _>>(),
        "uptime_s": link.started().elapsed().as_secs_f64(),
        "connections": context.counts.open.load(Relaxed),
        "streams": context.counts.streams.load(Relaxed),
        "changes": link.settings().applied().borrow().serial,
        "needs_token": matches!(context.admission.access, Access::Token { .. }),
        "allowed": context.admission.access.admit(&sender.headers, sender.client.key(), &context.admission.attempts).is_ok(),
        "camera": link.camera(),
        "mains": mains,
        "last": frame,
        "frames": timings.frames(),
        "stages": stages.collect::<Vec<_>>(),
    });
    config::answer(StatusCode::OK, &document)
}
