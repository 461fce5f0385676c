//! Every form of a light set contains the whole energy of the frame, or states the part that it leaves out.

use super::*;
use crate::pipeline::Settings;
use crate::probe::Worker;
use crate::probe::tiers::Selection;
use crate::server::answer::Answer;
use crate::server::format::Format;
use crate::server::query::Variant;
use crate::server::sets::encode;
use hemilux_core::SamplerKind;
use hemilux_core::wire::{BinarySet, Coordinates};

/// Contents of an encoded set: scalar flux of the lights, of the ambient light and of the part left out, and the number of lights.
#[derive(Debug, Default)]
struct EncodedEnergy {
    lights: [f64; 3],
    ambient: [f64; 3],
    left_out: [f64; 3],
    count: usize,
}

impl EncodedEnergy {
    fn add(&mut self, irradiance: [f64; 3]) {
        self.lights = std::array::from_fn(|c| self.lights[c] + irradiance[c]);
        self.count += 1;
    }
}

/// Returns the scalar flux over the upper hemisphere of radiance in spherical harmonics.
fn flux(sh: impl Fn(usize, usize) -> f64) -> [f64; 3] {
    use std::f64::consts::PI;
    // The integrals of 1 / (2 sqrt(pi)) and of sqrt(3 / (4 pi)) cos(theta) over the hemisphere.
    std::array::from_fn(|c| PI.sqrt() * sh(0, c) + (3.0 * PI / 4.0).sqrt() * sh(2, c))
}

fn triple(value: &Value) -> [f64; 3] {
    std::array::from_fn(|c| value[c].as_f64().unwrap_or_default())
}

fn held(format: Format, bytes: &[u8]) -> EncodedEnergy {
    let mut held = EncodedEnergy::default();
    match format {
        Format::Binary => {
            let set = BinarySet::try_new(bytes).expect("a set");
            set.lights().for_each(|light| held.add(light.irradiance.map(f64::from)));
            if let Some(sh) = set.ambient_sh() {
                held.ambient = flux(|row, c| f64::from(sh[row][c]));
            }
            // The energy that was left out follows from the other numbers.
            let whole = set.head().scalar_flux.map(f64::from);
            let rest: [f64; 3] = std::array::from_fn(|c| whole[c] - held.lights[c] - held.ambient[c]);
            if rest.iter().any(|v| v.abs() > 1e-3 * whole[0]) {
                held.left_out = rest;
            }
        }
        Format::Text => {
            for line in std::str::from_utf8(bytes).expect("UTF-8").lines() {
                let numbers: Vec<f64> = line.split_whitespace().filter_map(|v| v.parse().ok()).collect();
                if let Some(left_out) = line.strip_prefix("# left_out ") {
                    let numbers: Vec<f64> = left_out.split(' ').filter_map(|v| v.parse().ok()).collect();
                    held.left_out.copy_from_slice(&numbers);
                } else if !line.starts_with('#') {
                    held.add([numbers[4], numbers[5], numbers[6]]);
                }
            }
        }
        Format::Xml => {
            let text = std::str::from_utf8(bytes).expect("UTF-8");
            let document = roxmltree::Document::parse(text).expect("XML");
            let root = document.root_element();
            for light in root.children() {
                held.add(
                    ["r", "g", "b"]
                        .map(|name| light.attribute(name).unwrap_or("").parse().expect("a number")),
                );
            }
            for (slot, v) in held.left_out.iter_mut().zip(root.attribute("left_out").unwrap_or("").split(' '))
            {
                *slot = v.parse().unwrap_or_default();
            }
        }
        _ => {
            let text = std::str::from_utf8(bytes).expect("UTF-8");
            let object = text.find('{').map_or(text, |start| text[start..].trim_end());
            let set: Value = serde_json::from_str(object).expect("JSON");
            for light in set["lights"].as_array().expect("lights") {
                held.add(triple(&light["irradiance"]));
            }
            if let Some(sh) = set["ambient_sh"].as_array() {
                held.ambient = flux(|row, c| sh[row][c].as_f64().unwrap_or_default());
            }
            held.left_out = triple(&set["left_out"]);
        }
    }
    held
}

fn selections() -> impl Iterator<Item = Selection> {
    let lights = [None, Some(1), Some(3), Some(8), Some(20), Some(200), Some(50_000)];
    let ambient = [None, Some(false), Some(true)];
    let of = move |lights| ambient.map(|ambient| Selection { lights, ambient, soft: None });
    lights.into_iter().flat_map(of)
}

/// Encodes the newest set for every selection and form and returns the number of checked sets.
fn check(worker: &Worker, what: &str) -> usize {
    let link = worker.link();
    let mut checked = 0;
    for selection in selections() {
        let mut json = EncodedEnergy::default();
        for format in [Format::Json, Format::Event, Format::Text, Format::Xml, Format::Binary] {
            let ambient = if format.has_ambient() { selection.ambient } else { Some(false) };
            let selection = Selection { ambient, ..selection };
            let variant = Variant { format, coordinates: Coordinates::Probe, selection };
            let answer = Answer::newest(&link, selection, false).expect("a set");
            let whole = answer.set.scalar_flux.map(f64::from);
            let bytes = encode(variant, &link, &answer, 0).expect("bytes");
            let held = held(format, &bytes);
            let most = selection.lights.unwrap_or(usize::MAX);
            assert!(held.count <= most, "{what} {variant:?}: {} lights", held.count);
            for c in 0..3 {
                let sum = held.lights[c] + held.ambient[c] + held.left_out[c];
                let off = (sum - whole[c]).abs();
                assert!(
                    off <= 1.5e-3 * whole[0].max(whole[1]).max(whole[2]),
                    "{what} {variant:?}: {held:?} of {whole:?}"
                );
            }
            if selection.ambient == Some(false) {
                assert_eq!(held.ambient, [0.0; 3], "{what} {variant:?}");
            }
            // The binary form does not state the part left out: its lights and ambient light are those of the JSON form of the same
            // request.
            if format == Format::Json {
                json = held;
            } else if format == Format::Binary {
                let scale = whole[0].max(whole[1]).max(whole[2]);
                let pairs =
                    held.lights.iter().zip(&json.lights).chain(held.ambient.iter().zip(&json.ambient));
                for (binary, text) in pairs {
                    assert!(
                        (binary - text).abs() <= 1e-5 * scale,
                        "{what} {variant:?}: {held:?}, JSON {json:?}"
                    );
                }
                assert_eq!(held.count, json.count, "{what} {variant:?}");
            }
            checked += 1;
        }
    }
    checked
}

fn worker(scene: &str, sampler: SamplerKind, lights: usize, ambient: bool) -> Worker {
    let scene = scene::by_name(scene).expect("a scene");
    let pipeline = Settings { sampler, lights, ambient, ..Settings::default() };
    let config = Config { pipeline, ..Config::steady() };
    Worker::try_new(Box::new(SceneSource::new(scene, Pace::Free)), "test".into(), config).expect("a worker")
}

#[test]
fn every_form_contains_the_energy_or_states_the_part_left_out() {
    let mut checked = 0;
    for scene in ["room", "sky", "lamps", "overcast"] {
        for sampler in SamplerKind::ALL {
            for (lights, ambient) in [(16, false), (64, false), (8, true), (64, true), (0, true)] {
                if ambient && !sampler.estimates_error() {
                    continue;
                }
                let mut worker = worker(scene, sampler, lights, ambient);
                for _ in 0..5 {
                    worker.step().expect("a frame");
                    checked += check(&worker, &format!("{scene} {sampler} {lights} {ambient}"));
                }
            }
        }
    }
    assert!(checked >= 10_000, "{checked} combinations");
}

#[test]
fn a_set_without_ambient_light_states_the_part_left_out() {
    // The first request is answered with the probe's own set, whose lights do not contain the ambient light.
    let mut worker = worker("overcast", SamplerKind::Adaptive, 64, true);
    worker.step().expect("a frame");
    let selection = Selection { ambient: Some(false), ..Selection::OWN };
    let variant = Variant { format: Format::Json, coordinates: Coordinates::Probe, selection };
    let link = worker.link();
    let before = Answer::newest(&link, selection, false).expect("a set");
    let before = held(Format::Json, &encode(variant, &link, &before, 0).expect("bytes"));
    assert!(
        before.left_out[1] > 0.9 * before.lights[1].max(1e-6),
        "most of an overcast sky is ambient: {before:?}"
    );
    worker.step().expect("a frame");
    let after = Answer::newest(&link, selection, false).expect("a set");
    let after = held(Format::Json, &encode(variant, &link, &after, 0).expect("bytes"));
    assert_eq!(after.left_out, [0.0; 3], "a tier of lights alone has all of it");
}

/// Requests that differ in `soft` alone; the probe's own sampler does not fit discs.
#[test]
fn discs_and_points_are_served_at_the_same_time() {
    let mut worker = worker("room", SamplerKind::Q2Tree, 64, false);
    let link = worker.link();
    let select = |soft| Selection { lights: Some(16), ambient: Some(false), soft };
    for soft in [Some(false), Some(true), None] {
        let _ = link.tiers().request(select(soft));
    }
    worker.step().expect("a frame");
    worker.step().expect("a frame");
    let set = |soft| Answer::newest(&link, select(soft), false).expect("a set").set;
    let (points, discs) = (set(Some(false)), set(Some(true)));
    assert_eq!(
        (points.sampler.as_str(), discs.sampler.as_str()),
        ("q2tree", "adaptive"),
        "the sampler that fits them"
    );
    assert_eq!(set(None).lights, points.lights, "as the probe is set");
    assert_eq!(link.tiers().in_use().len(), 2, "and no tier of its own");
    assert_ne!(discs.lights, points.lights, "lights of their own");
}
