//! The table of all settings of the probe.

use super::{Group, Kind, Setting, shortest};
use crate::pipeline::{WINDOWS, WindowMode};
use crate::probe::config::{EXTRAPOLATIONS, MERGES, extrapolation_name, merge_name};
use crate::probe::tiers;
use crate::samplers::{CUTOFFS_HZ, MAX_LIGHTS, ORDERS, TAPS, THRESHOLDS, TOLERANCES};
use crate::timing::BUDGETS_MS;
use hemilux_core::MAX_EXPOSURES;
use hemilux_core::SamplerKind;
use hemilux_core::mains::Lamps;
use serde_json::{Value, json};

const EXTRAPOLATION_NAMES: [&str; EXTRAPOLATIONS.len()] = [EXTRAPOLATIONS[0].0, EXTRAPOLATIONS[1].0];

const WINDOW_NAMES: [&str; WINDOWS.len()] = [WINDOWS[0].0, WINDOWS[1].0];

const MERGE_NAMES: [&str; MERGES.len()] = [MERGES[0].0, MERGES[1].0];

/// Range of the exposure times that the settings accept, seconds.
const EXPOSURES_S: (f32, f32) = (1e-6, 60.0);

/// Declares the setting for the budget of stage `$i` of [`hemilux_core::wire::Latency::NAMES`].
macro_rules! budget {
    ($name:literal, $title:literal, $i:literal, $what:literal) => {
        Setting {
            name: $name,
            parameter: $name,
            title: $title,
            group: Group::Budgets,
            kind: Kind::Real(*BUDGETS_MS.start(), *BUDGETS_MS.end()),
            unit: Some("ms"),
            what: $what,
            value: |c| json!(shortest(c.budgets.ms($i))),
            set: |c, v| real(v).into_iter().for_each(|ms| c.budgets.set_ms($i, ms)),
            in_use: |_| true,
        }
    };
}

/// Writes `value` to `field` of a configuration; leaves `field` unchanged for `None`, which [`Setting::admits`]
/// excludes.
fn put<T>(field: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *field = value;
    }
}

fn real(value: &Value) -> Option<f32> {
    value.as_f64().map(|v| v as f32)
}

fn whole<T: TryFrom<u64>>(value: &Value) -> Option<T> {
    value.as_u64().and_then(|n| T::try_from(n).ok())
}

/// All settings. Each entry is the only declaration of its setting: the configuration file, the command line, `/change`, `/v1/config`, the page
/// and the OpenAPI document are derived from the entries, in their order. The default values are those of
/// [`Config::default`](crate::probe::Config).
pub static SETTINGS: &[Setting] = &[
    Setting {
        name: "sampler",
        parameter: "algorithm",
        title: "Sampler",
        group: Group::Lights,
        kind: Kind::Choice(&SamplerKind::NAMES),
        unit: None,
        what: "Method that computes lights from the map. adaptive has the least error, q2tree takes the least time; the others are published methods for comparison.",
        value: |c| json!(c.pipeline.sampler.name()),
        set: |c, v| put(&mut c.pipeline.sampler, v.as_str().and_then(|name| name.parse().ok())),
        in_use: |_| true,
    },
    Setting {
        name: "lights",
        parameter: "samples",
        title: "Lights",
        group: Group::Lights,
        kind: Kind::Whole(0, MAX_LIGHTS as u64),
        unit: Some("lights"),
        what: "Largest number of lights of a set. With more lights, shadows are more accurate and a renderer takes longer. Each sampler has a least number; it is 0 for adaptive with ambient light.",
        value: |c| json!(c.pipeline.lights),
        set: |c, v| put(&mut c.pipeline.lights, whole(v)),
        in_use: |_| true,
    },
    Setting {
        name: "tolerance",
        parameter: "tolerance",
        title: "Tolerance",
        group: Group::Lights,
        kind: Kind::Optional(*TOLERANCES.start(), *TOLERANCES.end()),
        unit: Some("ratio"),
        what: "Shadowed error that a set must reach with as few lights as possible: a smaller value gives more lights and more accurate shadows. adaptive alone reads it. Without it, a set has as many lights as the setting lights.",
        value: |c| c.pipeline.tolerance.map_or(Value::Null, |t| json!(shortest(t))),
        set: |c, v| c.pipeline.tolerance = real(v),
        in_use: |c| c.pipeline.sampler.estimates_error(),
    },
    Setting {
        name: "ambient",
        parameter: "ambient",
        title: "Ambient",
        group: Group::Lights,
        kind: Kind::Switch,
        unit: None,
        what: "Whether diffuse light, such as that of an overcast sky, is returned as nine spherical-harmonic coefficients in place of lights: fewer lights, smoother shading. adaptive alone reads it.",
        value: |c| json!(c.pipeline.ambient),
        set: |c, v| put(&mut c.pipeline.ambient, v.as_bool()),
        in_use: |c| c.pipeline.sampler.estimates_error(),
    },
    Setting {
        name: "soft",
        parameter: "soft",
        title: "Soft",
        group: Group::Lights,
        kind: Kind::Switch,
        unit: None,
        what: "Whether lights are fitted as uniform discs of their radius: shadows have soft edges in renderers with disc lights. adaptive alone reads it.",
        value: |c| json!(c.pipeline.soft),
        set: |c, v| put(&mut c.pipeline.soft, v.as_bool()),
        in_use: |c| c.pipeline.sampler.estimates_error(),
    },
    Setting {
        name: "q2tree_threshold",
        parameter: "q2tree_threshold",
        title: "Threshold of q2tree",
        group: Group::Lights,
        kind: Kind::Real(*THRESHOLDS.start(), *THRESHOLDS.end()),
        unit: Some("ratio"),
        what: "Relative gain in importance from which q2tree replaces a split: with a larger value, shadows flicker less and follow a moving lamp later.",
        value: |c| json!(shortest(c.pipeline.tuning.threshold)),
        set: |c, v| put(&mut c.pipeline.tuning.threshold, real(v)),
        in_use: |c| c.pipeline.sampler.is_q2tree(),
    },
    Setting {
        name: "fir_taps",
        parameter: "fir_taps",
        title: "Filter length",
        group: Group::Lights,
        kind: Kind::Whole(*TAPS.start() as u64, *TAPS.end() as u64),
        unit: Some("frames"),
        what: "Length of the filter of hemigon-fir, frames: with a larger value, shadows flicker less and follow a moving lamp later; 1 is no filter.",
        value: |c| json!(c.pipeline.tuning.taps),
        set: |c, v| put(&mut c.pipeline.tuning.taps, whole(v)),
        in_use: |c| c.pipeline.sampler == SamplerKind::HemigonFir,
    },
    Setting {
        name: "fir_cutoff_hz",
        parameter: "fir_cutoff_hz",
        title: "Filter cut-off",
        group: Group::Lights,
        kind: Kind::Real(*CUTOFFS_HZ.start(), *CUTOFFS_HZ.end()),
        unit: Some("Hz"),
        what: "Frequency above which hemigon-fir attenuates changes of the light, at ten frames a second; it is proportional to the frame rate.",
        value: |c| json!(shortest(c.pipeline.tuning.cutoff_hz)),
        set: |c, v| put(&mut c.pipeline.tuning.cutoff_hz, real(v)),
        in_use: |c| c.pipeline.sampler == SamplerKind::HemigonFir,
    },
    Setting {
        name: "exposures_s",
        parameter: "exposures_s",
        title: "Exposures",
        group: Group::Map,
        kind: Kind::List(EXPOSURES_S.0, EXPOSURES_S.1, MAX_EXPOSURES),
        unit: Some("s"),
        what: "Exposure times of a burst, ascending. A shorter first exposure avoids clipped lamps, a longer last one lowers the noise of dark walls. Without them, the source's own exposure times are used.",
        value: |c| json!(c.exposures_s),
        set: |c, v| {
            c.exposures_s = v.as_array().map(|list| list.iter().filter_map(Value::as_f64).collect());
        },
        in_use: |_| true,
    },
    Setting {
        name: "auto_exposures",
        parameter: "auto_exposures",
        title: "Exposures by light",
        group: Group::Map,
        kind: Kind::Switch,
        unit: None,
        what: "Whether the exposures follow the light: as few as cover the radiance of the scene, at most six, in place of the setting exposures_s. It acts on built-in scenes and on cameras with an exposure control; maps and recordings keep their exposures. A camera whose response is known does so without this setting while exposures_s is empty.",
        value: |c| json!(c.auto_exposures),
        set: |c, v| put(&mut c.auto_exposures, v.as_bool()),
        in_use: |_| true,
    },
    Setting {
        name: "merge",
        parameter: "merge",
        title: "Exposures read",
        group: Group::Map,
        kind: Kind::Choice(&MERGE_NAMES),
        unit: None,
        what: "Exposures of a burst that are merged. needed: the longest and, where it is saturated in a part of a row, shorter ones; all: every exposure, which takes longer and gives a tenth less noise.",
        value: |c| json!(merge_name(c.pipeline.merge)),
        set: |c, v| {
            let known = MERGES.iter().find(|(name, _)| v.as_str() == Some(*name));
            put(&mut c.pipeline.merge, known.map(|(_, mode)| *mode));
        },
        in_use: |_| true,
    },
    Setting {
        name: "window",
        parameter: "window",
        title: "Window",
        group: Group::Map,
        kind: Kind::Choice(&WINDOW_NAMES),
        unit: None,
        what: "Frames of a set: those of one burst, or, sliding, the newest frame of each exposure, which gives a set for every frame of the camera. Places that changed take the newest valid frame alone. Sliding reads every frame whole and needs mains off.",
        value: |c| json!(c.pipeline.window.name()),
        set: |c, v| put(&mut c.pipeline.window, v.as_str().and_then(WindowMode::named)),
        in_use: |_| true,
    },
    Setting {
        name: "order",
        parameter: "order",
        title: "Map order",
        group: Group::Map,
        kind: Kind::OptionalWhole(*ORDERS.start() as u64, *ORDERS.end() as u64),
        unit: Some("(8 x 4^order texels)"),
        what: "HEALPix order of the map: each step halves the angle of a quad and quadruples the memory. Without it, the order is 6, or 7 from 256 lights.",
        value: |c| json!(c.pipeline.order),
        set: |c, v| c.pipeline.order = whole(v),
        in_use: |_| true,
    },
    Setting {
        name: "extrapolation",
        parameter: "extrapolation",
        title: "Extrapolation",
        group: Group::Map,
        kind: Kind::Choice(&EXTRAPOLATION_NAMES),
        unit: None,
        what: "Radiance of the part of the hemisphere outside of the lens's field: none (zero) or average (the mean radiance of the field, which adds light from the horizon).",
        value: |c| json!(extrapolation_name(c.pipeline.extrapolation)),
        set: |c, v| {
            let known = EXTRAPOLATIONS.iter().find(|(name, _)| v.as_str() == Some(*name));
            put(&mut c.pipeline.extrapolation, known.map(|(_, e)| *e));
        },
        in_use: |_| true,
    },
    Setting {
        name: "mains",
        parameter: "mains",
        title: "Mains",
        group: Group::Map,
        kind: Kind::Choice(&Lamps::NAMES),
        unit: None,
        what: "Frequency of the mains, hertz, whose lamps flicker twice as fast: their flicker is removed. auto finds the frequency; off leaves every map as it is. Lamps that all bursts show at one phase, as three exposures at 30 frames a second do, pass for steady ones.",
        value: |c| json!(c.pipeline.lamps.name()),
        set: |c, v| put(&mut c.pipeline.lamps, v.as_str().and_then(Lamps::named)),
        in_use: |_| true,
    },
    budget!("budget_capture_ms", "Capture", 0, "Budget of the wait for a burst and of its copy."),
    budget!("budget_front_ms", "Front", 1, "Budget of merge and map."),
    budget!("budget_pyramid_ms", "Pyramid", 2, "Budget of the pyramid, the sums over the map."),
    budget!("budget_sample_ms", "Sample", 3, "Budget of the sampler."),
    budget!(
        "budget_filter_ms",
        "Filter",
        4,
        "Budget of the sampler's temporal filters; a sampler without filters takes 0 ms."
    ),
    budget!("budget_encode_ms", "Encode", 5, "Budget of the encoding of a set for clients."),
    budget!("budget_total_ms", "Total", 6, "Budget from the end of the burst to the finished set."),
    Setting {
        name: "tiers",
        parameter: "tiers",
        title: "Tiers",
        group: Group::Other,
        kind: Kind::Whole(*tiers::MOST.start() as u64, *tiers::MOST.end() as u64),
        unit: Some("sets"),
        what: "Largest number of light sets per frame in addition to the probe's own, for clients that request other numbers of lights, ambient light or discs; further requests share these sets.",
        value: |c| json!(c.tiers),
        set: |c, v| put(&mut c.tiers, whole(v)),
        in_use: |_| true,
    },
    Setting {
        name: "degrade",
        parameter: "degrade",
        title: "Degrade",
        group: Group::Budgets,
        kind: Kind::Switch,
        unit: None,
        what: "Whether the quality is lowered step by step while frames exceed the budget of total: fewer exposures, a coarser map, fewer lights, fewer bursts. Each step is undone when frames with it fit the budget.",
        value: |c| json!(c.degrade),
        set: |c, v| put(&mut c.degrade, v.as_bool()),
        in_use: |_| true,
    },
    Setting {
        name: "gui",
        parameter: "gui",
        title: "Debug picture",
        group: Group::Other,
        kind: Kind::Switch,
        unit: None,
        what: "Whether /screenshot may draw the debug picture; each picture takes a copy of the map.",
        value: |c| json!(c.gui),
        set: |c, v| put(&mut c.gui, v.as_bool()),
        in_use: |_| true,
    },
];
