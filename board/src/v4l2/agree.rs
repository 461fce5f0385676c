//! The control values for requested exposure times: the range of the exposure control, and the values that the
//! camera accepts.

use super::Node;
use super::controls::{self, Info};
use super::exposure::{ControlUnit, ExposureSetting, Knob};
use crate::exposure_plan::TimeRange;

/// Largest number of control values that are tried for an exposure that the camera refuses or changes.
const MOST_TRIES: usize = 512;

/// Largest ratio between the requested value of the exposure control and another value that is tried, in either direction.
const TRIED_FACTOR: f64 = 4.0;

/// Difference of the accepted from the requested exposure, as a natural logarithm, above which other control values are tried; the steps
/// of the control itself are finer.
const TRIED_FROM: f64 = 0.05;

/// Sets the exposure control to the value nearest to `wanted` that the camera accepts and returns the value that is read back; `None` if
/// every value is refused.
///
/// Some cameras accept only the values of a coarse list that no request returns, and refuse or ignore all others. Values around `wanted`
/// are tried by rising distance from it until no untried value can be nearer than the nearest value read back.
fn take_nearest(node: &mut dyn Node, info: &Info, wanted: i64, most: i64) -> Option<i64> {
    let distance = |value: i64| (value.max(1) as f64 / wanted.max(1) as f64).ln().abs();
    let mut best: Option<i64> = None;
    // A single write may fail by chance.
    let tries = [wanted; 3].into_iter().chain(beside(wanted, info, most));
    for value in tries.take(MOST_TRIES) {
        if best.is_some_and(|b| distance(b) <= distance(value).max(TRIED_FROM)) {
            break;
        }
        if controls::set(node, info, value).is_ok() {
            // A control that cannot be read is taken to have the written value.
            let found = controls::value(node, info).unwrap_or(value);
            if best.is_none_or(|b| distance(found) < distance(b)) {
                best = Some(found);
            }
        }
    }
    let best = best?;
    let _ = controls::set(node, info, best);
    Some(controls::value(node, info).unwrap_or(best))
}

/// Returns the values of a control around `wanted`, in the order of their ratio to `wanted`.
fn beside(wanted: i64, info: &Info, most: i64) -> impl Iterator<Item = i64> {
    let step = info.step.max(1);
    let (least, most) = (info.minimum.max(1), info.maximum.min(most));
    let (mut below, mut above) = (wanted, wanted);
    let next = move || {
        let (down, up) = (below.saturating_sub(step), above.saturating_add(step));
        let is_in = |v: i64| {
            let ratio = v as f64 / wanted.max(1) as f64;
            (least..=most).contains(&v) && (1.0 / TRIED_FACTOR..=TRIED_FACTOR).contains(&ratio)
        };
        let nearer_above = (up as f64) * (down as f64) <= (wanted as f64).powi(2);
        if is_in(up) && (nearer_above || !is_in(down)) {
            above = up;
            Some(up)
        } else if is_in(down) {
            below = down;
            Some(down)
        } else {
            None
        }
    };
    std::iter::from_fn(next)
}

/// The settings that a camera took for the requested exposures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settled {
    /// The accepted exposure settings, ascending and without repetition.
    pub settings: Vec<ExposureSetting>,
    /// Whether the exposure control reads as the value that was written.
    pub reads_back: bool,
}

/// Returns the exposure times that the control accepts at a frame interval of `period_s` seconds; `None` for a control
/// that sets no time.
pub fn range(node: &mut dyn Node, knob: &Knob, period_s: f64) -> Option<TimeRange> {
    let second = knob.unit.second()?;
    let info = controls::find(node, knob.info.id).unwrap_or_else(|| knob.info.clone());
    let longest = info.maximum.min(longest_value(knob.unit, period_s)) as f64 * second;
    let shortest_s = info.minimum.max(1) as f64 * second;
    Some(TimeRange { shortest_s, longest_s: longest.max(shortest_s), step_s: info.step as f64 * second })
}

/// Returns the largest value of the exposure control at a frame interval of `period_s` seconds: a longer UVC exposure lengthens the
/// interval or is cut.
fn longest_value(unit: ControlUnit, period_s: f64) -> i64 {
    match unit {
        ControlUnit::Uvc => ((period_s / 1e-4 + 1e-6) as i64).max(1),
        ControlUnit::Lines(_) | ControlUnit::StandIn => i64::MAX,
    }
}

/// Returns the settings nearest to the requested exposure times `wished_s`, seconds, ascending, without a write
/// to the control.
pub fn nearest(node: &mut dyn Node, knob: &Knob, wished_s: &[f64], period_s: f64) -> Vec<ExposureSetting> {
    let Some(second) = knob.unit.second() else { return Vec::new() };
    // The range is read again, since a sensor's range follows VBLANK.
    let info = controls::find(node, knob.info.id).unwrap_or_else(|| knob.info.clone());
    let most = longest_value(knob.unit, period_s);
    let of = |asked_s: &f64| {
        let value = info.nearest(((asked_s / second).round().clamp(1.0, 1e9) as i64).min(most));
        ExposureSetting { value, asked_s: *asked_s, seconds: value as f64 * second }
    };
    distinct(wished_s.iter().map(of).collect())
}

/// Sets each requested exposure and reads it back. If the control reads as the same value after each of several writes, the written values
/// are returned.
pub fn agree(node: &mut dyn Node, knob: &Knob, wished_s: &[f64], period_s: f64) -> Settled {
    let Some(second) = knob.unit.second() else { return Settled::default() };
    let info = controls::find(node, knob.info.id).unwrap_or_else(|| knob.info.clone());
    let most = longest_value(knob.unit, period_s);
    let (mut taken, mut written) = (Vec::new(), Vec::new());
    for wanted in nearest(node, knob, wished_s, period_s) {
        let Some(value) = take_nearest(node, &info, wanted.value, most) else { continue };
        taken.push(ExposureSetting { value, seconds: value as f64 * second, ..wanted });
        written.push(wanted);
    }
    let taken = distinct(taken);
    let is_readable = controls::value(node, &info).is_ok();
    if taken.len() == 1 && written.len() > 1 {
        return Settled { settings: written, reads_back: false };
    }
    Settled { settings: taken, reads_back: is_readable }
}

/// Returns those of `settings` with positive exposure times in ascending order, each control value once.
fn distinct(mut settings: Vec<ExposureSetting>) -> Vec<ExposureSetting> {
    settings.retain(|s| s.seconds > 0.0);
    settings.sort_by_key(|s| s.value);
    settings.dedup_by_key(|s| s.value);
    settings
}
