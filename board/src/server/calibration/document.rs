//! The state of a calibration as JSON.

use super::session::{Draft, PlacedCircle, Session};
use crate::calibrate::{Calibrated, CircleLens, Guide, SECTORS, combine};
use serde_json::{Value, json};

/// Returns the state of the calibration `session` as JSON: angles in degrees, positions in pixels of the frame.
pub(super) fn of(session: &Session, can_save: bool) -> Value {
    json!({
        "can_save": can_save,
        "unsaved": session.is_unsaved(),
        "size": session.size,
        "guide": session.guide.as_ref().map(|guide| guided(guide, session)),
        "lens": session.lens.as_ref().map(lens),
        "circle": session.circle.as_ref().map(|PlacedCircle { circle, field_deg }| json!({
            "centre": circle.centre.to_array(), "radius": circle.radius, "deviation_px": circle.deviation_px, "field_deg": field_deg,
        })),
        "vignetting": vignetting(session),
        "response": session.response.as_ref().map(|fitted| {
            let neighbours = fitted.neighbours.iter().map(|n| {
                json!({"declared": n.declared, "estimated": n.estimated, "disagreement": n.disagreement})
            });
            json!({"coefficients": fitted.coefficients, "neighbours": neighbours.collect::<Vec<_>>()})
        }),
        "photometric": photometric(session),
    })
}

fn guided(guide: &Guide, session: &Session) -> Value {
    let coverage = guide.coverage();
    let covered: Vec<Vec<bool>> = (0..coverage.corners.len())
        .map(|ring| (0..SECTORS).map(|sector| coverage.has(ring, sector)).collect())
        .collect();
    json!({
        "views": guide.views(),
        "advice": session.offer.map_or("show the board to the camera", crate::calibrate::Offer::advice),
        "taken": session.offer == Some(crate::calibrate::Offer::Taken),
        "seen": guide.last(),
        "corners": guide.corners(),
        "covered": covered,
        "share": coverage.share(),
        "lacking": coverage.lacking(),
    })
}

fn lens(draft: &Draft) -> Value {
    match draft {
        Draft::Board(calibrated) => by_board(calibrated),
        Draft::Circle(circle) => by_circle(circle),
    }
}

fn by_board(calibrated: &Calibrated) -> Value {
    let uncertainty: Vec<_> = calibrated.spread.iter().map(|s| [s.angle_deg, s.uncertainty_deg]).collect();
    let p = calibrated.lens.intrinsics();
    json!({
        "method": "board", "boards": calibrated.boards(), "corners": calibrated.corners(), "rms_px": calibrated.rms_px,
        "largest_px": calibrated.largest_px, "covered_deg": calibrated.covered_deg, "uncertainty_deg": uncertainty,
        "centre": p.centre_px.to_array(), "focal": p.focal_px.to_array(), "tells_mirror": calibrated.board.tells_mirror(),
    })
}

fn by_circle(circle: &CircleLens) -> Value {
    let p = circle.lens.intrinsics();
    json!({
        "method": "circle", "covered_deg": p.max_theta.to_degrees(), "uncertainty_deg": circle.spread,
        "centre": p.centre_px.to_array(), "focal": p.focal_px.to_array(),
    })
}

fn vignetting(session: &Session) -> Value {
    let readings: Vec<_> = session.readings.iter().map(|r| [r.theta.to_degrees(), r.light]).collect();
    let fitted = session.vignetting.as_ref().map(|fitted| {
        json!({"rms": fitted.rms, "largest": fitted.largest, "covered_deg": fitted.covered.to_degrees(),
            "coefficients": fitted.coefficients})
    });
    json!({"readings": readings, "fitted": fitted})
}

fn photometric(session: &Session) -> Value {
    let readings = session.measured.iter().map(|m| {
        let factor = combine(std::slice::from_ref(&m.reading));
        json!({"class": m.class, "method": m.reading.method, "factor": m.reading.factor, "unseen": m.reading.unseen,
            "uncertainty": factor.map(|f| f.uncertainty)})
    });
    Value::Array(readings.collect())
}
