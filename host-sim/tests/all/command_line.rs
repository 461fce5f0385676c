//! Command line of the simulator: refusal of wrong options, formats of pictures, completions and man pages.

use crate::common::{sim, sim_ok, text};

/// Returns the standard error of a refused command, which must be one line; the exit status must be 2.
fn refused(arguments: &[&str]) -> String {
    let output = sim(arguments);
    let errors = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!((output.status.code(), errors.lines().count()), (Some(2), 1), "{arguments:?}: {errors}");
    assert!(errors.starts_with("hemilux-sim: "), "{errors}");
    errors
}

#[test]
fn misspelt_options_are_refused_in_one_line_with_a_suggestion() {
    let cases: [(&[&str], &str); 4] = [
        (&["decompse", "--env", "scene:room"], "'decompose'"),
        (&["decompose", "--evn", "scene:room"], "'--env'"),
        (&["decompose", "--env", "scene:room", "--sampler", "adaptve"], "'adaptive'"),
        (&["replay", "--burst", "x", "--exposures", "mesured"], "'measured'"),
    ];
    for (arguments, right) in cases {
        let line = refused(arguments);
        assert!(line.contains(&format!("did you mean {right}?")), "{line}");
    }
    assert!(refused(&[]).contains("found no command"));
    assert!(refused(&["decompose"]).contains("--env"));
}

#[test]
fn a_picture_has_the_format_of_its_name_and_other_names_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let written = |name: &str| {
        let path = folder.path().join(name);
        sim_ok(&["decompose", "--env", "scene:room", "--lights", "4", "--picture", text(&path)]);
        std::fs::read(&path).expect("a picture")
    };
    // The first bytes of JPEG files (ISO/IEC 10918) and PNG files (ISO/IEC 15948).
    assert!(written("a.jpg").starts_with(&[0xff, 0xd8, 0xff]), "JPEG");
    assert!(written("a.PNG").starts_with(b"\x89PNG\r\n\x1a\n"), "PNG");
    for name in ["x.gif", "x", "x.exr"] {
        let line = refused(&["decompose", "--env", "scene:room", "--picture", name]);
        assert!(line.contains(".png or .jpg"), "{line}");
    }
    let line = refused(&["decompose", "--env", "scene:room", "--map", "x.hdr"]);
    assert!(line.contains(".exr"), "{line}");
}

#[test]
fn completions_and_man_pages_name_the_options() {
    let folder = tempfile::tempdir().expect("a folder");
    assert!(sim_ok(&["completions", "zsh"]).contains("--tolerance"));
    sim_ok(&["man", "--out", text(folder.path())]);
    let page = std::fs::read_to_string(folder.path().join("hemilux-sim-decompose.1")).expect("a page");
    assert!(page.contains("\\-\\-tolerance"), "{page}");
}
