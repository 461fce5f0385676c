//! Encoded light sets parsed by independent parsers.

use crate::common::{RngExt, direction, light_set, seeded};
use embedded_io::SliceWriteError;
use glam::Vec3;
use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{self, Coordinates, FrameFault, Latency, LightSet, Overrun, Stale, Step};
use serde_json::Value;

const HOSTILE: &str = "a\"b\\c\n1 2 3\r\t\u{0}\u{1f}\u{7f}\u{85}\u{2028}\u{fffe}\u{ffff}<&>'é🌞]]>-->";

type Written = Result<(), SliceWriteError>;
type Encoder = fn(&LightSet<'_>, &mut &mut [u8]) -> Written;

fn json(set: &LightSet<'_>, w: &mut &mut [u8]) -> Written {
    wire::json(set, w)
}

fn text(set: &LightSet<'_>, w: &mut &mut [u8]) -> Written {
    wire::text(set, w)
}

fn xml(set: &LightSet<'_>, w: &mut &mut [u8]) -> Written {
    wire::xml(set, w)
}

fn encode(encoder: Encoder, set: &LightSet<'_>) -> String {
    let mut bytes = [0; 1 << 16];
    let mut rest = &mut bytes[..];
    encoder(set, &mut rest).expect("room enough");
    let left = rest.len();
    let used = bytes.len() - left;
    String::from_utf8(bytes[..used].to_vec()).expect("UTF-8")
}

fn lights(n: u32) -> Vec<Light> {
    let mut rng = seeded(41);
    let light = |i| Light {
        id: 4 + i,
        direction: direction(&mut rng).as_vec3(),
        irradiance: [1e-20, 0.25 * i as f32, 3.4e38],
        radius_deg: 2.5,
        age: 7 * i,
        parent: (i % 2 == 1).then_some(i),
    };
    (0..n).map(light).collect()
}

fn set<'a>(lights: &'a [Light], ambient: Option<&'a Sh9>) -> LightSet<'a> {
    let latency = Latency { total: u32::MAX, ..light_set(&[], None).latency };
    LightSet { frame: u64::MAX, estimated_error: Some(0.004), latency, ..light_set(lights, ambient) }
}

fn keys(value: &Value) -> Vec<&str> {
    let mut keys: Vec<&str> = value.as_object().expect("an object").keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

fn sorted(words: &str) -> Vec<&str> {
    let mut words: Vec<&str> = words.split_whitespace().collect();
    words.sort_unstable();
    words
}

fn triple(value: &Value) -> [f32; 3] {
    let numbers = value.as_array().expect("an array");
    assert_eq!(numbers.len(), 3, "three channels or axes");
    core::array::from_fn(|i| numbers[i].to_string().parse().expect("a number"))
}

/// The members of a JSON light set that `board/FORMATS.md` lists.
const KEYS: &str = "version run frame timestamp_ns wall_ms valid stale sampler requested unit coordinates lights scalar_flux \
                    horizontal_irradiance clipped unseen estimated_error latency_us overrun";

#[test]
fn json_holds_exactly_the_keys_of_the_format() {
    let (lights, sh) = (lights(3), [[0.5; 3]; 9]);
    let with = format!("{KEYS} ambient_sh");
    for (ambient, expected) in [(None, KEYS), (Some(&sh), with.as_str())] {
        let text = encode(json, &set(&lights, ambient));
        let value: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(keys(&value), sorted(expected));
        assert_eq!(keys(&value["latency_us"]), sorted("capture front pyramid sample filter encode total"));
        assert_eq!(keys(&value["lights"][0]), sorted("id direction irradiance radius_deg age parent"));
        assert!(!text.contains('\n') && text.matches("ambient_sh").count() <= 1);
    }
}

#[test]
fn json_parses_to_the_encoded_values() {
    let (lights, sh) = (lights(3), core::array::from_fn(|i| [i as f32, -0.5, 1e-9]));
    let value: Value = serde_json::from_str(&encode(json, &set(&lights, Some(&sh)))).expect("JSON");
    assert_eq!(value["version"], 1);
    assert_eq!((&value["run"], &value["sampler"]), (&"k3v9".into(), &"q2tree".into()));
    assert_eq!(value["frame"].as_u64(), Some(u64::MAX));
    assert_eq!(value["timestamp_ns"].as_u64(), Some(123_456_789_012));
    assert_eq!(value["wall_ms"].as_u64(), Some(1_700_000_000_000));
    assert_eq!((&value["valid"], &value["stale"]), (&true.into(), &Value::Null));
    assert_eq!((&value["unit"], &value["coordinates"]), (&"lux".into(), &"y-up".into()));
    assert_eq!(value["requested"], 64);
    assert_eq!((triple(&value["scalar_flux"])[2], triple(&value["horizontal_irradiance"])[2]), (3.0, 1.5));
    assert_eq!(
        (value["unseen"].as_f64(), value["latency_us"]["total"].as_u64()),
        (Some(0.125), Some(4_294_967_295))
    );
    for (found, light) in value["lights"].as_array().expect("an array").iter().zip(&lights) {
        let d = light.direction;
        assert_eq!(triple(&found["direction"]), [d.x, d.z, -d.y], "floats survive to the last bit");
        assert_eq!(triple(&found["irradiance"]), light.irradiance);
        assert_eq!(found["parent"].as_u64(), light.parent.map(u64::from));
        assert_eq!(
            (found["id"].as_u64(), found["age"].as_u64()),
            (Some(light.id.into()), Some(light.age.into()))
        );
    }
    assert_eq!(value["ambient_sh"].as_array().map(Vec::len), Some(9));
}

#[test]
fn overrun_names_stages_above_their_budget_but_not_at_it() {
    let mut set = LightSet::EMPTY;
    set.latency = Latency { capture: 10, front: 11, filter: 9, total: 500, ..Latency::default() };
    set.overrun = Overrun::of(&set.latency, &[10, 10, 10, 10, 8, 10, 499]);
    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    assert_eq!(value["overrun"], serde_json::json!(["front", "filter", "total"]));
    let value: Value = serde_json::from_str(&encode(json, &LightSet::EMPTY)).expect("JSON");
    assert_eq!(value["overrun"], serde_json::json!([]));
}

#[test]
fn the_uncertainty_of_the_unit_is_in_each_text_form() {
    let set = LightSet { unit_uncertainty: Some(0.05), ..LightSet::EMPTY };
    assert!(encode(text, &set).contains("\n# unit_uncertainty 0.05\n"), "a comment");
    assert!(encode(xml, &set).contains(" unit_uncertainty=\"0.05\" "), "an attribute");
    assert!(encode(json, &set).contains("\"unit_uncertainty\":0.05"), "a number");
    assert!(!encode(text, &LightSet::EMPTY).contains("unit_uncertainty"), "relative");
    assert!(!encode(xml, &LightSet::EMPTY).contains("unit_uncertainty"), "relative");
}

#[test]
fn frames_left_out_are_listed_with_index_and_reason_or_not_at_all() {
    let mut set = LightSet::EMPTY;
    assert!(!encode(json, &set).contains("frames_left_out"));
    set.frames_left_out.insert(2, FrameFault::Black);
    set.frames_left_out.insert(0, FrameFault::WrongExposure);
    set.frames_left_out.insert(99, FrameFault::Torn);
    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    let expected = serde_json::json!([{"index": 0, "why": "wrong-exposure"}, {"index": 2, "why": "black"}]);
    assert_eq!(value["frames_left_out"], expected);
}

#[test]
fn steps_of_a_degraded_set_are_listed_or_not_at_all() {
    let mut set = LightSet::EMPTY;
    assert!(!encode(json, &set).contains("degraded"));
    for step in [Step::Lights, Step::Exposures, Step::Lights] {
        set.degraded.add(step);
    }
    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    assert_eq!(value["degraded"], serde_json::json!(["exposures", "lights", "lights"]));
}

#[test]
fn removed_flicker_is_written_with_its_frequency_or_not_at_all() {
    let mut set = LightSet::EMPTY;
    assert!(!encode(json, &set).contains("mains"));
    set.flicker.share = 0.5;
    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    assert_eq!(value["mains"], serde_json::json!({"frequency_hz": null, "depth": 0, "share": 0.5}));
    (set.flicker.frequency_hz, set.flicker.depth) = (Some(100.0), 0.25);
    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    assert_eq!(value["mains"], serde_json::json!({"frequency_hz": 100, "depth": 0.25, "share": 0.5}));
}

#[test]
fn the_set_before_the_first_frame_is_not_valid() {
    let value: Value = serde_json::from_str(&encode(json, &LightSet::EMPTY)).expect("JSON");
    assert_eq!((&value["valid"], &value["estimated_error"]), (&false.into(), &Value::Null));
    assert_eq!(value["lights"], Value::Array(vec![]));
    assert_eq!(value["latency_us"]["total"], 0);
    roxmltree::Document::parse(&encode(xml, &LightSet::EMPTY)).expect("XML");
}

#[test]
fn hostile_strings_are_escaped() {
    let lights = lights(2);
    let stale = Some(Stale { age_ms: 9, reason: HOSTILE });
    let set = LightSet { run: HOSTILE, sampler: HOSTILE, stale, ..set(&lights, None) };

    let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
    assert_eq!((&value["run"], &value["sampler"]), (&HOSTILE.into(), &HOSTILE.into()));
    assert_eq!(value["stale"], serde_json::json!({"age_ms": 9, "reason": HOSTILE}));

    let document = encode(xml, &set);
    let document = roxmltree::Document::parse(&document).expect("XML");
    let run = document.root_element().attribute("run").expect("an attribute");
    assert!(run.starts_with("a\"b\\c 1 2 3") && run.ends_with("<&>'é🌞]]>-->"), "{run}");

    let lines = encode(text, &set);
    let data: Vec<&str> = lines.split(['\n', '\r', '\u{85}']).filter(|l| !l.starts_with('#')).collect();
    assert_eq!(data.len(), 2 + 1, "two lights and the empty rest after the last line break: {data:?}");
}

#[test]
fn xml_contains_every_light() {
    let lights = lights(4);
    let bytes = encode(xml, &LightSet { coordinates: Coordinates::Unreal, ..set(&lights, None) });
    let document = roxmltree::Document::parse(&bytes).expect("XML");
    let root = document.root_element();
    assert_eq!(root.tag_name().name(), "lights");
    let names: Vec<&str> = root.attributes().map(|a| a.name()).collect();
    assert_eq!(names, ["version", "run", "frame", "sampler", "unit", "coordinates", "stale"]);
    assert_eq!((root.attribute("version"), root.attribute("stale")), (Some("1"), Some("")));
    assert_eq!(root.attribute("coordinates"), Some("unreal"));
    assert_eq!(root.children().count(), 4);
    for (node, light) in root.children().zip(&lights) {
        let names: Vec<&str> = node.attributes().map(|a| a.name()).collect();
        assert_eq!(names, ["id", "x", "y", "z", "r", "g", "b"]);
        let number = |name| node.attribute(name).expect("an attribute").parse::<f32>().expect("a number");
        assert_eq!(
            Vec3::new(number("x"), number("y"), number("z")),
            light.direction * Vec3::new(1.0, -1.0, 1.0)
        );
        assert_eq!([number("r"), number("g"), number("b")], light.irradiance);
        assert_eq!(node.attribute("id"), Some(light.id.to_string().as_str()));
    }
}

#[test]
fn text_has_comments_then_one_line_per_light() {
    let lights = lights(4);
    let stale = Some(Stale { age_ms: 250, reason: "camera gone" });
    let lines = encode(text, &LightSet { stale, coordinates: Coordinates::Unity, ..set(&lights, None) });
    assert!(lines.ends_with('\n'));
    let (comments, data): (Vec<&str>, Vec<&str>) = lines.lines().partition(|l| l.starts_with('#'));
    for (comment, name) in comments.iter().zip(["run", "frame", "sampler", "unit", "coordinates", "stale"]) {
        assert!(comment.starts_with(&format!("# {name} ")), "{comment}");
    }
    assert_eq!((comments.len(), comments[5]), (6, "# stale 250 ms camera gone"));
    assert_eq!(data.len(), 4);
    for (line, light) in data.iter().zip(&lights) {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!((words.len(), words[0]), (7, light.id.to_string().as_str()));
        let n: Vec<f32> = words[1..].iter().map(|w| w.parse().expect("a number")).collect();
        let d = light.direction;
        assert_eq!(n, [[d.x, d.z, d.y], light.irradiance].concat());
        assert!(!line.contains(['e', 'E', 'n', 'N']), "decimal: {line}");
    }
}

#[test]
fn non_finite_numbers_are_written_as_zero() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let light = Light {
            id: 1,
            direction: Vec3::splat(bad),
            irradiance: [bad; 3],
            radius_deg: bad,
            ..Light::default()
        };
        let (lights, sh) = ([light], [[bad; 3]; 9]);
        let set = LightSet {
            scalar_flux: [bad; 3],
            horizontal_irradiance: [bad; 3],
            clipped: bad,
            unseen: bad,
            estimated_error: Some(bad),
            ..set(&lights, Some(&sh))
        };
        for encoder in [json as Encoder, text, xml] {
            let bytes = encode(encoder, &set);
            assert!(!bytes.contains("NaN") && !bytes.contains("inf"), "{bytes}");
        }
        let value: Value = serde_json::from_str(&encode(json, &set)).expect("JSON");
        assert_eq!(triple(&value["lights"][0]["irradiance"]), [0.0; 3]);
        assert_eq!(triple(&value["ambient_sh"][8]), [0.0; 3]);
    }
}

#[test]
fn full_writer_gives_an_error_at_every_length() {
    let (lights, sh) = (lights(2), [[0.5; 3]; 9]);
    let set = set(&lights, Some(&sh));
    for encoder in [json as Encoder, text, xml] {
        let whole = encode(encoder, &set).len();
        for room in 0..whole {
            let mut bytes = vec![0; room];
            assert_eq!(encoder(&set, &mut &mut bytes[..]), Err(SliceWriteError::Full), "{room}");
        }
        let mut bytes = vec![0; whole];
        assert_eq!(encoder(&set, &mut &mut bytes[..]), Ok(()));
    }
}

#[test]
fn random_sets_always_parse() {
    let mut rng = seeded(42);
    for _ in 0..300 {
        let mut number = || f32::from_bits(rng.random());
        let mut light = || Light {
            id: 3,
            direction: Vec3::new(number(), number(), number()),
            irradiance: [number(), number(), number()],
            radius_deg: number(),
            age: 0,
            parent: None,
        };
        let lights = [light(), light()];
        let set = LightSet { clipped: number(), scalar_flux: [number(); 3], ..set(&lights, None) };
        serde_json::from_str::<Value>(&encode(json, &set)).expect("JSON");
        roxmltree::Document::parse(&encode(xml, &set)).expect("XML");
    }
}

#[test]
fn decimals_are_as_short_as_those_of_the_standard_library_and_round_trip() {
    let hard = [0, 1, 0x7f7f_ffff, 0x3f80_0000, 0x5a0e_1bca, 0x5a0e_1bc9, 0x3727_c5ac, 0x3727_c5ad];
    // All bit patterns in steps of 2^20, so that every exponent occurs with both signs.
    let strided = (0..1u32 << 20).map(|i| i.wrapping_mul(4093));
    let all: Vec<f32> =
        hard.into_iter().chain(strided).map(f32::from_bits).filter(|v| v.is_finite()).collect();
    for three in all.as_chunks::<3>().0 {
        let light = Light { irradiance: *three, ..Light::default() };
        let text = encode(text, &LightSet { lights: &[light], ..LightSet::EMPTY });
        let words: Vec<_> = text.lines().last().expect("a light").split(' ').skip(4).collect();
        for (word, v) in words.iter().zip(three) {
            // If two decimals are equally near, the last digit may differ.
            assert_eq!((word.parse(), word.len()), (Ok(*v), v.to_string().len()), "{word}: expected {v}");
            assert!(!word.contains(['e', 'E']), "{word}");
        }
    }
}
