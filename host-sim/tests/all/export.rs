//! Options `--format` and `--coordinates` of `decompose` and `replay`.

use std::path::Path;
use std::process::{Command, Output};

fn sim(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hemilux-sim"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("it runs")
}

fn decomposed(folder: &Path, more: &[&str]) -> Vec<u8> {
    let all: Vec<&str> = ["decompose", "--env", "scene:sky", "--lights", "4"]
        .into_iter()
        .chain(more.iter().copied())
        .collect();
    let output = sim(folder, &all);
    assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

#[test]
fn every_format_has_the_first_bytes_of_its_file_type() {
    let folder = tempfile::tempdir().expect("a folder");
    for (format, start) in [
        ("json", "{\"version\":1,"),
        ("text", "# hemilux light set"),
        ("xml", "<!-- hemilux light set"),
        ("csv", "# hemilux light set"),
        ("glb", "glTF"),
        ("usda", "#usda 1.0\n"),
        ("rad", "# hemilux light set"),
        ("mitsuba", "<?xml "),
    ] {
        let file = decomposed(folder.path(), &["--format", format]);
        assert!(file.starts_with(start.as_bytes()), "{format}: {}", String::from_utf8_lossy(&file[..40]));
        assert_eq!(file.last() == Some(&b'\n'), format != "glb", "{format}: a line end, except in binary");
    }
}

#[test]
fn coordinates_convert_the_directions() {
    let folder = tempfile::tempdir().expect("a folder");
    let direction = |axes: &str| -> Vec<f64> {
        let file = decomposed(folder.path(), &["--coordinates", axes]);
        let set: serde_json::Value = serde_json::from_slice(&file).expect("JSON");
        assert_eq!(set["coordinates"], axes);
        let direction = set["lights"][0]["direction"].as_array().expect("a direction").clone();
        direction.iter().map(|v| v.as_f64().expect("a number")).collect()
    };
    let probe = direction("probe");
    assert_eq!(direction("y-up"), [probe[0], probe[2], -probe[1]]);
    assert_eq!(direction("unreal"), [probe[0], -probe[1], probe[2]]);
}

#[test]
fn usd_dome_light_refers_to_a_map_of_the_whole_sphere() {
    let folder = tempfile::tempdir().expect("a folder");
    let more = ["--hemisphere", "--format", "usda", "--map", "sky.exr"];
    let file = String::from_utf8(decomposed(folder.path(), &more)).expect("UTF-8");
    assert!(file.contains("@@@./sky.exr@@@"), "{file}");
    let map = hemilux_sim::env::EnvMap::read(&folder.path().join("sky.exr")).expect("a map");
    assert_eq!(map.width(), 2 * map.height(), "a whole sphere");
    let below = map.texels()[map.width() * map.height() / 2..].iter().flatten();
    assert!(below.clone().all(|v| *v == 0.0), "black below the horizon");
}

#[test]
fn sequences_and_axes_that_a_format_cannot_hold_are_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a", "b"] {
        let map = format!("maps/{name}.exr");
        std::fs::create_dir_all(folder.path().join("maps")).expect("a folder");
        decomposed(folder.path(), &["--map", &map]);
    }
    for (arguments, named) in [
        (&["--env", "scene:sky", "--format", "glb", "--coordinates", "unity"][..], "--coordinates"),
        (&["--env", "scene:sky", "--format", "usda", "--coordinates", "unreal"], "--coordinates"),
        (&["--env", "scene:sky", "--format", "obj"], "mitsuba"),
        (&["--env", "scene:sky", "--coordinates", "maya"], "webxr"),
        (&["--env", "maps", "--format", "glb"], "sequence of 2"),
    ] {
        let all: Vec<&str> =
            ["decompose", "--lights", "4"].into_iter().chain(arguments.iter().copied()).collect();
        let output = sim(folder.path(), &all);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {said}");
        assert!(said.contains(named), "{arguments:?}: {said}");
    }
}
