//! Light sets in the export forms: directions and irradiances are read back from each file by the rules of its format. `tests/exports` opens the
//! same files with usd-core, gltf-validator and Mitsuba.

use hemilux::export::{ExportError, Form, encode};
use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{Coordinates, LightSet, Stale, Unit};

/// A light that was read from a file: direction towards the light in the axes of the file, and perpendicular irradiance.
#[derive(Debug)]
struct Read {
    direction: [f64; 3],
    irradiance: [f64; 3],
}

fn light(id: u32, direction: [f32; 3], irradiance: [f32; 3], radius_deg: f32) -> Light {
    let direction = glam::Vec3::from_array(direction).normalize();
    Light { id, direction, irradiance, radius_deg, ..Light::default() }
}

fn lights() -> Vec<Light> {
    vec![
        light(1, [0.0, 0.0, 1.0], [3.0, 2.0, 1.0], 5.0),
        light(2, [0.0, 0.0, -1.0], [0.25, 0.5, 0.125], 90.0),
        light(7, [1.0, 2.0, 3.0], [1e5, 1.5e5, 2e5], 0.0),
        light(9, [-0.3, 0.9, -0.2], [1e-6, 0.0, 2e-6], 30.0),
        light(u32::MAX, [-1.0, 0.0, 0.0], [0.0; 3], 1.0),
    ]
}

fn bytes(form: Form, set: &LightSet<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(form, set, Some("maps/room.exr"), &mut bytes).expect("axes that the form has");
    bytes
}

fn text(form: Form, set: &LightSet<'_>) -> String {
    String::from_utf8(bytes(form, set)).expect("UTF-8")
}

fn numbers(text: &str) -> Vec<f64> {
    let parts = text.split(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).filter(|p| !p.is_empty());
    parts.map(|p| p.parse().unwrap_or_else(|_| panic!("{p:?} in {text:?}"))).collect()
}

fn triple(values: &[f64]) -> [f64; 3] {
    [values[0], values[1], values[2]]
}

/// Rotates `v` by the quaternion (x, y, z, w).
fn turned([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    glam::DQuat::from_xyzw(x, y, z, w).mul_vec3(v.into()).to_array()
}

fn of_glb(file: &[u8]) -> Vec<Read> {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!(&file[..4], b"glTF", "the magic");
    assert_eq!([word(4), word(8), word(12) + 20], [2, file.len(), file.len()], "version and lengths");
    assert_eq!((&file[16..20], file.len() % 4), (&b"JSON"[..], 0), "one padded chunk");
    let json: serde_json::Value = serde_json::from_slice(&file[20..]).expect("JSON");
    let floats = |v: &serde_json::Value| -> Vec<f64> {
        v.as_array().expect("an array").iter().map(|v| v.as_f64().expect("a number")).collect()
    };
    let all = &json["extensions"]["KHR_lights_punctual"]["lights"];
    let scene = json["scenes"][0]["nodes"].as_array().expect("nodes").iter();
    scene
        .map(|index| {
            let node = &json["nodes"][index.as_u64().expect("an index") as usize];
            let rotation = floats(&node["rotation"]).try_into().expect("a quaternion");
            let index = node["extensions"]["KHR_lights_punctual"]["light"].as_u64().expect("an index");
            let light = &all[index as usize];
            assert_eq!(light["type"], "directional", "the type of a light");
            let colour = floats(&light["color"]);
            assert!(colour.iter().all(|c| (0.0..=1.0).contains(c)), "{light}");
            let intensity = light["intensity"].as_f64().expect("a number");
            let travel = turned(rotation, [0.0, 0.0, -1.0]);
            Read { direction: travel.map(|v| -v), irradiance: triple(&colour).map(|c| c * intensity) }
        })
        .collect()
}

/// Returns the numbers of `name = value` in a block of a .usda file.
fn usd_value(block: &str, name: &str) -> Vec<f64> {
    let found = block.lines().find_map(|l| l.split_once(&format!(" {name} = ")));
    numbers(found.unwrap_or_else(|| panic!("no {name} in {block}")).1)
}

fn of_usda(file: &str) -> Vec<Read> {
    let blocks = file.split("def DistantLight ").skip(1);
    blocks
        .map(|block| {
            let q = usd_value(block, "xformOp:orient");
            let intensity = usd_value(block, "inputs:intensity")[0];
            let travel = turned([q[1], q[2], q[3], q[0]], [0.0, 0.0, -1.0]);
            // A surface that faces the disc receives the energy times the mean cosine over the disc.
            let half = usd_value(block, "inputs:angle")[0].to_radians() / 2.0;
            let exposure = usd_value(block, "inputs:exposure")[0];
            assert!((exposure.exp2() / ((1.0 + half.cos()) / 2.0) - 1.0).abs() < 1e-5, "{block}");
            let colour = triple(&usd_value(block, "inputs:color"));
            Read { direction: travel.map(|v| -v), irradiance: colour.map(|c| c * intensity) }
        })
        .collect()
}

fn of_radiance(file: &str) -> Vec<Read> {
    let lines: Vec<&str> = file.lines().filter(|l| !l.starts_with('#') && !l.is_empty()).collect();
    lines
        .chunks(8)
        .map(|part| {
            assert!(part[0].starts_with("void light ") && part[4].contains(" source "), "{part:?}");
            let (radiance, place) = (numbers(part[3]), numbers(part[7]));
            assert_eq!([radiance[0], place[0]], [3.0, 4.0], "counts of numbers");
            let solid_angle = std::f64::consts::TAU * (1.0 - (place[4].to_radians() / 2.0).cos());
            let irradiance = triple(&radiance[1..]).map(|l| l * solid_angle);
            Read { direction: triple(&place[1..]), irradiance }
        })
        .collect()
}

fn of_mitsuba(file: &str) -> Vec<Read> {
    let document = roxmltree::Document::parse(file).expect("XML");
    let emitters = document.descendants().filter(|n| n.has_tag_name("emitter"));
    emitters
        .map(|emitter| {
            assert_eq!(emitter.attribute("type"), Some("directional"), "the type of an emitter");
            let child = |tag| emitter.children().find(|n| n.has_tag_name(tag)).expect("a child");
            let number =
                |name| child("vector").attribute(name).expect("a number").parse::<f64>().expect("a number");
            let rgb = numbers(child("rgb").attribute("value").expect("a value"));
            Read { direction: ["x", "y", "z"].map(|axis| -number(axis)), irradiance: triple(&rgb) }
        })
        .collect()
}

fn of_csv(file: &str) -> Vec<Read> {
    let mut lines = file.lines().filter(|l| !l.starts_with('#'));
    assert_eq!(lines.next(), Some("id,x,y,z,r,g,b,radius_deg,age,parent"), "the head of the table");
    let rows = lines.map(|l| l.split(',').map(str::to_string).collect::<Vec<_>>());
    rows.map(|row| {
        assert_eq!(row.len(), 10, "{row:?}");
        let values: Vec<f64> = row[..9].iter().map(|v| v.parse().expect("a number")).collect();
        Read { direction: triple(&values[1..]), irradiance: triple(&values[4..]) }
    })
    .collect()
}

fn of_text(file: &str) -> Vec<Read> {
    let lights = file.lines().filter(|line| !line.starts_with('#'));
    let light = |line| {
        let values = numbers(line);
        Read { direction: triple(&values[1..]), irradiance: triple(&values[4..]) }
    };
    lights.map(light).collect()
}

fn of_xml(file: &str) -> Vec<Read> {
    let document = roxmltree::Document::parse(file).expect("XML");
    let lights = document.descendants().filter(|n| n.has_tag_name("light"));
    let light = |n: roxmltree::Node<'_, '_>| {
        let triple = |names: [&str; 3]| {
            names.map(|name| n.attribute(name).and_then(|v| v.parse().ok()).expect("a number"))
        };
        Read { direction: triple(["x", "y", "z"]), irradiance: triple(["r", "g", "b"]) }
    };
    lights.map(light).collect()
}

/// Reads the rows of the script's table: id, direction, strength, colour, radius.
fn of_blender(text: &str) -> Vec<Read> {
    let rows = text.lines().filter_map(|line| line.trim().strip_prefix("(\""));
    rows.map(|row| {
        let (_, values) = row.split_once("\",").expect("an id");
        let v = numbers(values);
        assert_eq!(v.len(), 8, "{row}");
        // The strength is the irradiance of a surface that faces the disc.
        let facing = (1.0 + v[7].to_radians().cos()) / 2.0;
        Read { direction: triple(&v), irradiance: [v[4], v[5], v[6]].map(|c| c * v[3] / facing) }
    })
    .collect()
}

fn read(form: Form, file: &[u8]) -> Vec<Read> {
    let text = || std::str::from_utf8(file).expect("UTF-8");
    match form {
        Form::Glb => of_glb(file),
        Form::Usda => of_usda(text()),
        Form::Radiance => of_radiance(text()),
        Form::Mitsuba => of_mitsuba(text()),
        Form::Blender => of_blender(text()),
        Form::Text => of_text(text()),
        Form::Xml => of_xml(text()),
        _ => of_csv(text()),
    }
}

const FORMS: [Form; 8] =
    [Form::Glb, Form::Usda, Form::Radiance, Form::Mitsuba, Form::Blender, Form::Csv, Form::Text, Form::Xml];

#[test]
fn each_form_keeps_directions_and_irradiances() {
    let lights = lights();
    for form in FORMS {
        for axes in [Coordinates::Probe, Coordinates::YUp] {
            if form.axes(Some(axes)).is_err() {
                continue;
            }
            let set = LightSet { lights: &lights, coordinates: axes, ..LightSet::EMPTY };
            let found = read(form, &bytes(form, &set));
            assert_eq!(found.len(), lights.len(), "{form:?}");
            for (read, light) in found.iter().zip(&lights) {
                let [x, y, z] = light.direction.to_array().map(f64::from);
                let expected = if axes == Coordinates::YUp { [x, z, -y] } else { [x, y, z] };
                for (i, expected) in expected.into_iter().enumerate() {
                    assert!(
                        (read.direction[i] - expected).abs() < 2e-6,
                        "{form:?} {axes:?} {read:?} {light:?}"
                    );
                    let e = f64::from(light.irradiance[i]);
                    assert!((read.irradiance[i] - e).abs() <= 2e-5 * e, "{form:?} {read:?} {light:?}");
                }
            }
        }
    }
}

#[test]
fn a_set_without_lights_is_exported_as_a_file_without_lights() {
    for form in FORMS {
        let set = LightSet { coordinates: form.native_axes(), ..LightSet::EMPTY };
        let file = bytes(form, &set);
        if form == Form::Glb {
            let json: serde_json::Value = serde_json::from_slice(&file[20..]).expect("JSON");
            assert!(
                json.get("nodes").is_none() && json.get("extensions").is_none(),
                "empty lists are no glTF"
            );
        } else {
            assert_eq!(read(form, &file).len(), 0, "{form:?}");
        }
    }
}

#[test]
fn axes_that_a_program_does_not_have_are_refused_by_name() {
    for (form, axes) in [
        (Form::Glb, Coordinates::Probe),
        (Form::Glb, Coordinates::Unity),
        (Form::Usda, Coordinates::Unreal),
        (Form::Mitsuba, Coordinates::Unity),
        (Form::Radiance, Coordinates::Unreal),
    ] {
        let set = LightSet { coordinates: axes, ..LightSet::EMPTY };
        let mut bytes = Vec::new();
        let refused = encode(form, &set, None, &mut bytes).expect_err("refused");
        assert!(matches!(refused, ExportError::Axes { .. }) && bytes.is_empty(), "{refused}");
        let line = refused.to_string();
        assert!(line.contains(axes.name()) && line.contains(form.name()) && line.contains("y-up"), "{line}");
    }
}

#[test]
fn comments_name_unit_stale_source_and_ambient_energy_left_out() {
    let lights = lights();
    let mut sh = Sh9::default();
    // A constant radiance of 1 has the harmonic coefficient 2 sqrt(pi) and the flux 4 pi.
    sh[0] = [3.544_907_7; 3];
    let reason = "unplugged -- \"see\nbelow\" ---> \u{ffff}";
    for form in FORMS {
        let set = LightSet {
            run: "k3v9x",
            lights: &lights,
            coordinates: form.native_axes(),
            unit: Unit::Lux,
            ambient_sh: Some(&sh),
            stale: Some(Stale { age_ms: 1500, reason }),
            ..LightSet::EMPTY
        };
        let file = bytes(form, &set);
        assert_eq!(read(form, &file).len(), lights.len(), "{form:?}: comments that end their line or file");
        let text = String::from_utf8_lossy(&file);
        for part in ["k3v9x", "unit: lux", "1500 ms: unplugged", "left out", "12.56637"] {
            assert!(text.contains(part), "{form:?}: no {part:?} in {text}");
        }
    }
}

#[test]
fn usd_names_the_map_in_an_invisible_dome_and_its_up_axis() {
    for (coordinates, up) in [(Coordinates::YUp, "Y"), (Coordinates::Probe, "Z")] {
        let file = text(Form::Usda, &LightSet { coordinates, ..LightSet::EMPTY });
        assert!(file.starts_with("#usda 1.0\n") && file.contains(&format!("upAxis = \"{up}\"")), "{file}");
        let dome = file.split("def DomeLight ").nth(1).expect("a dome");
        assert!(
            dome.contains("@@@maps/room.exr@@@") && dome.contains("visibility = \"invisible\""),
            "{dome}"
        );
        // In a texture, longitude 0 is local +Z, longitude 90 degrees +X and the upper edge +Y; each row is the image of a local axis.
        let m = usd_value(dome, "xformOp:transform");
        let expected = match coordinates {
            Coordinates::YUp => [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
            _ => [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        };
        assert_eq!([triple(&m[0..]), triple(&m[4..]), triple(&m[8..])], expected);
    }
    let mut file = Vec::new();
    encode(Form::Usda, &LightSet { coordinates: Coordinates::YUp, ..LightSet::EMPTY }, None, &mut file)
        .expect("axes");
    assert!(!String::from_utf8_lossy(&file).contains("DomeLight \""), "no map, no dome");
}

#[test]
fn names_of_forms_are_unique_and_read_back() {
    for (name, form) in Form::NAMED {
        assert_eq!((Form::from_name(name), form.name()), (Some(form), name));
    }
    assert_eq!(Form::from_name("obj"), None);
}
