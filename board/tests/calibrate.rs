//! `hemilux calibrate` on real pictures of a chessboard; each test returns early where these are absent.

#![cfg(feature = "server")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Pictures of a board of 8 x 6 inner corners.
fn pictures() -> Option<Vec<PathBuf>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/chessboard-a");
    if !folder.is_dir() {
        eprintln!("SKIPPED: no chessboard-a beside the workspace");
        return None;
    }
    let mut files: Vec<_> =
        std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    Some(files)
}

/// What a run of the program gave.
struct Ended {
    status: Option<i32>,
    out: String,
    error: String,
}

fn lens(board: &str, pictures: &[PathBuf], out: &Path, more: &[&str]) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hemilux"));
    command.args(["calibrate", "lens", "--board", board, "--out"]).arg(out).args(pictures).args(more);
    let output = command.output().expect("the program runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    Ended { status: output.status.code(), out: text(output.stdout), error: text(output.stderr) }
}

fn number(table: &toml::Table, name: &str) -> f64 {
    let value = table["calibration"].get(name).unwrap_or_else(|| panic!("{name}"));
    value.as_float().or(value.as_integer().map(|v| v as f64)).unwrap_or_else(|| panic!("{name}"))
}

/// One line that holds `words`, and the status of a failure.
fn assert_refused(ended: &Ended, words: &[&str]) {
    assert_eq!(ended.status, Some(1), "{}{}", ended.out, ended.error);
    assert_eq!(ended.error.lines().count(), 1, "{}", ended.error);
    for word in words {
        assert!(ended.error.contains(word), "{word}: {}", ended.error);
    }
}

#[test]
fn real_pictures_give_a_lens_with_its_uncertainty() {
    let Some(pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("lens.toml");
    let residuals = folder.path().join("residuals.svg");
    let ended = lens("8x6", &pictures, &out, &["--residuals", residuals.to_str().expect("UTF-8")]);
    assert_eq!(ended.status, Some(0), "{}", ended.error);
    let read = hemilux::recorded::read_lens(&out).expect("a lens file");
    assert_eq!(read.size, [1032, 778]);
    let table: toml::Table = std::fs::read_to_string(&out).expect("a file").parse().expect("TOML");
    assert!(number(&table, "boards") >= 14.0, "{table}");
    assert!(number(&table, "rms_px") <= 0.30, "{table}");
    assert!(number(&table, "largest_px") <= 1.5, "{table}");
    assert!((75.0..95.0).contains(&number(&table, "covered_deg")), "{table}");
    let uncertainty = table["calibration"]["uncertainty_deg"].as_array().expect("an array");
    assert!(uncertainty.iter().all(|v| v.as_float().is_some_and(|v| v > 0.0 && v < 0.3)), "{uncertainty:?}");
    let arrows = std::fs::read_to_string(residuals).expect("a picture").matches("h4v4h-4z").count();
    assert_eq!(arrows as f64, number(&table, "corners"), "an arrow for each corner");
}

#[test]
fn worse_lens_does_not_replace_a_better_one_unless_forced() {
    let Some(pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("lens.toml");
    assert_eq!(lens("8x6", &pictures, &out, &[]).status, Some(0));
    let kept = "\n[response]\nmodel = \"srgb\"\n";
    let better = std::fs::read_to_string(&out).expect("a file") + kept;
    std::fs::write(&out, &better).expect("a file");
    let few = [&pictures[7..9], &pictures[13..]].concat();
    assert_refused(&lens("8x6", &few, &out, &[]), &["lens.toml", "--force"]);
    assert_eq!(std::fs::read_to_string(&out).expect("a file"), better, "unchanged");
    assert_eq!(lens("8x6", &few, &out, &["--force"]).status, Some(0));
    assert!(
        std::fs::read_to_string(&out).expect("a file").contains("model = \"srgb\""),
        "the response is kept"
    );
}

#[test]
fn wrong_board_sizes_are_refused_with_what_was_found() {
    let Some(pictures) = pictures() else { return };
    let out = Path::new("/nonexistent/lens.toml");
    for board in ["7x6", "8x5", "5x4"] {
        assert_refused(&lens(board, &pictures, out, &[]), &["more than", board, "--board"]);
    }
    for board in ["9x6", "9x7"] {
        assert_refused(&lens(board, &pictures, out, &[]), &["at most 8x6", board, "--board 8x6"]);
    }
}

#[test]
fn too_few_pictures_are_refused() {
    let Some(pictures) = pictures() else { return };
    let ended = lens("8x6", &pictures[..1], Path::new("/nonexistent/lens.toml"), &[]);
    assert_refused(&ended, &["found 1 picture", "at least 3"]);
}

/// A changed copy of a picture.
fn changed(
    picture: &Path,
    folder: &Path,
    change: impl Fn(image::DynamicImage) -> image::DynamicImage,
) -> PathBuf {
    let out = folder.join(picture.file_name().expect("a name")).with_extension("png");
    change(image::open(picture).expect("a picture")).save(&out).expect("a picture");
    out
}

#[test]
fn picture_of_another_size_is_named() {
    let Some(mut pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    pictures[4] = changed(&pictures[4], folder.path(), |image| image.crop_imm(0, 0, 1000, 700));
    let ended = lens("8x6", &pictures, Path::new("/nonexistent/lens.toml"), &[]);
    assert_refused(&ended, &["Fisheye1_13.png", "1000 x 700", "1032 x 778"]);
}

#[test]
fn mirrored_picture_is_named() {
    let Some(mut pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    pictures[6] = changed(&pictures[6], folder.path(), |image| image.fliph());
    let ended = lens("8x6", &pictures, Path::new("/nonexistent/lens.toml"), &[]);
    assert_refused(&ended, &["Fisheye1_15.png", "mirrored"]);
}

#[test]
fn boards_in_one_part_of_the_view_are_refused() {
    let Some(pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let shrink = |image: image::DynamicImage| {
        let small = image.resize_exact(516, 389, image::imageops::FilterType::Triangle);
        let mut whole = image::DynamicImage::new_luma8(1032, 778);
        image::imageops::overlay(&mut whole, &small, 0, 0);
        whole
    };
    let small: Vec<_> = pictures.iter().take(6).map(|p| changed(p, folder.path(), shrink)).collect();
    let ended = lens("8x6", &small, Path::new("/nonexistent/lens.toml"), &[]);
    assert_refused(&ended, &["upper left part", "elsewhere"]);
}

#[test]
fn two_boards_in_view_are_refused() {
    let Some(mut pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let twice = |image: image::DynamicImage| {
        let small = image.resize_exact(516, 778, image::imageops::FilterType::Triangle);
        let mut whole = image::DynamicImage::new_luma8(1032, 778);
        for left in [0, 516] {
            image::imageops::overlay(&mut whole, &small, left, 0);
        }
        whole
    };
    pictures[2] = changed(&pictures[2], folder.path(), twice);
    let ended = lens("8x6", &pictures, Path::new("/nonexistent/lens.toml"), &[]);
    assert_refused(&ended, &["Fisheye1_11.png", "two boards"]);
}
