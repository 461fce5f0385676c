//! `hemilux calibrate` on real pictures of a chessboard; each test returns early where the pictures are absent.

#![cfg(feature = "server")]

use hemilux::calibrate::{Board, Grey, Guide, Offer};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns the pictures of a board of 8 x 6 inner corners; `None` where they are absent.
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

/// Output, errors and exit status of a finished run of the program.
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

/// Asserts that the program failed with one line on stderr that contains `words`.
fn assert_refused(ended: &Ended, words: &[&str]) {
    assert_eq!(ended.status, Some(1), "{}{}", ended.out, ended.error);
    assert_eq!(ended.error.lines().count(), 1, "{}", ended.error);
    for word in words {
        assert!(ended.error.contains(word), "{word}: {}", ended.error);
    }
}

#[test]
fn real_pictures_determine_a_lens_with_its_uncertainty() {
    let Some(pictures) = pictures() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("lens.toml");
    let residuals = folder.path().join("residuals.svg");
    let mode = ["--crop", "0,0,2064,1556", "--binning", "2,2"];
    let more = [&["--residuals", residuals.to_str().expect("UTF-8")][..], &mode].concat();
    let ended = lens("8x6", &pictures, &out, &more);
    assert_eq!(ended.status, Some(0), "{}", ended.error);
    let read = hemilux::recorded::read_lens(&out).expect("a lens file");
    assert_eq!(read.size, [1032, 778]);
    let shown = read.shown.expect("crop and binning");
    assert_eq!((shown.crop, shown.binning), ([0, 0, 2064, 1556], [2, 2]), "the mode");
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
fn wrong_board_sizes_are_refused_with_the_detected_size() {
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

/// Writes a changed copy of a picture and returns its path.
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

const LENS: &str = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [200, 200]\ncentre = [99.5, 99.5]\nfocal = [60.0, 60.0]\n\
     max_angle_deg = 90.0\n";

fn run(arguments: &[&str]) -> Ended {
    let output = Command::new(env!("CARGO_BIN_EXE_hemilux")).arg("calibrate").args(arguments).output();
    let output = output.expect("the program runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    Ended { status: output.status.code(), out: text(output.stdout), error: text(output.stderr) }
}

#[test]
fn flat_field_writes_the_vignetting_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let (lens, flat) = (folder.path().join("lens.toml"), folder.path().join("flat.png"));
    std::fs::write(&lens, format!("{LENS}[response]\nmodel = \"linear\"\n")).expect("a file");
    let theta = |x: u32, y: u32| (f64::from(x) - 99.5).hypot(f64::from(y) - 99.5) / 60.0;
    let image = image::GrayImage::from_fn(200, 200, |x, y| {
        let light = if theta(x, y) < 1.58 { 1.0 - 0.2 * theta(x, y).powi(2) } else { 0.0 };
        image::Luma([(230.0 * light).round() as u8])
    });
    image.save(&flat).expect("a picture");
    let arguments =
        ["vignetting", "--flat", flat.to_str().expect("UTF-8"), "--out", lens.to_str().expect("UTF-8")];
    let ended = run(&arguments);
    assert_eq!(ended.status, Some(0), "{}", ended.error);
    let read = hemilux::recorded::read_lens(&lens).expect("a lens file").lens;
    for theta in [0.0, 0.5, 1.0, 1.48f64] {
        let off = read.illumination(theta) / (1.0 - 0.2 * theta * theta) - 1.0;
        assert!(off.abs() < 0.02, "{theta}: {off}");
    }
    assert_refused(&run(&arguments), &["a vignetting", "--force"]);
}

#[test]
fn check_has_an_exit_status_for_each_class_of_fault() {
    let folder = tempfile::tempdir().expect("a folder");
    let lens = folder.path().join("lens.toml");
    let check = |text: &str, burst: Option<&Path>| {
        std::fs::write(&lens, text).expect("a file");
        let mut arguments = vec!["check", lens.to_str().expect("UTF-8")];
        arguments.extend(burst.iter().flat_map(|burst| ["--burst", burst.to_str().expect("UTF-8")]));
        run(&arguments)
    };
    assert_eq!(check(LENS, None).status, Some(0));
    assert_eq!(check("nothing", None).status, Some(3));
    let aside = LENS.replace("centre = [", "centre = [9");
    assert_ne!(aside, LENS, "a centre far outside of the image");
    assert_eq!(check(&aside, None).status, Some(5), "no pixel sees anything");
    let beyond = format!("{LENS}[calibration]\ncovered_deg = 50.0\n");
    assert_eq!(check(&beyond, None).status, Some(6), "used far beyond its calibration");
    let burst = folder.path().join("burst");
    std::fs::create_dir(&burst).expect("a folder");
    let record = |ratio: f64, focal: &str| {
        let frames = [("a.png", 0.01, 40u8), ("b.png", 0.01 * ratio, 160u8)].map(|(name, seconds, code)| {
            image::GrayImage::from_pixel(200, 200, image::Luma([code]))
                .save(burst.join(name))
                .expect("a picture");
            format!("[[frame]]\nfile = \"{name}\"\nexposure_s = {seconds}\n")
        });
        let text = LENS.replace("60.0", focal) + &frames.concat();
        std::fs::write(burst.join("burst.toml"), text).expect("a file");
    };
    record(4.0, "60.0");
    assert_eq!(check(LENS, Some(&burst)).status, Some(0));
    assert_eq!(check(&LENS.replace("[200, 200]", "[200, 202]"), Some(&burst)).status, Some(4));
    record(2.0, "60.0");
    let ended = check(LENS, Some(&burst));
    assert_eq!(ended.status, Some(7), "{}", ended.error);
    assert!(ended.error.contains("4.00") && ended.error.contains("2.00"), "{}", ended.error);
    record(4.0, "60.0");
    let text = std::fs::read_to_string(burst.join("burst.toml")).expect("a file");
    let mode = |keys: &str| LENS.replace("[lens]\n", &format!("[lens]\n{keys}\n"));
    std::fs::write(
        burst.join("burst.toml"),
        text.replace("[lens]\n", "[lens]\ncrop = [0, 0, 400, 400]\nbinning = [2, 2]\n"),
    )
    .expect("a file");
    assert_eq!(check(&mode("crop = [0, 0, 400, 400]\nbinning = [2, 2]"), Some(&burst)).status, Some(0));
    let ended = check(&mode("crop = [100, 100, 200, 200]\nbinning = [1, 1]"), Some(&burst));
    assert_eq!(ended.status, Some(9), "{}", ended.error);
    assert!(
        ended.error.contains("[100, 100, 200, 200]") && ended.error.contains("binning = [2, 2]"),
        "{}",
        ended.error
    );
    assert_eq!(
        check(&mode("crop = [0, 0, 400, 400]\nbinning = [3, 3]"), None).status,
        Some(3),
        "no such mode"
    );
    let other = format!(
        "{LENS}[photometric]\ncamera = \"0\"\n[photometric.class.any]\nfactor = 2.0\nuncertainty = 0.1\n"
    );
    let ended = check(&other, Some(&burst));
    assert_eq!(ended.status, Some(10), "{}", ended.error);
    record(4.0, "50.0");
    assert_eq!(check(LENS, Some(&burst)).status, Some(8));
}

#[test]
fn photometric_calibration_is_combined_checked_and_served_in_lux() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("photometric.toml");
    let out = out.to_str().expect("UTF-8");
    let measure = |more: &[&str]| {
        let usual = ["photometric", "--source", "scene:overcast", "--bursts", "2", "--out", out];
        run(&[&usual[..], more].concat())
    };
    let first = measure(&["--lux", "420"]);
    assert_eq!(first.status, Some(0), "{}", first.error);
    assert!(
        first.out.contains("outside of the lens's") && first.out.contains("1 reading(s)"),
        "{}",
        first.out
    );
    assert!(measure(&["--lux", "424"]).out.contains("2 reading(s)"));
    assert_refused(&measure(&["--lux", "600"]), &["off that of the earlier readings", "--fresh"]);
    let check = |lux: &str| measure(&["--lux", lux, "--check"]);
    assert!(check("430").out.contains(": good"), "{}", check("430").out);
    assert!(check("500").out.contains(": fair"), "{}", check("500").out);
    assert_refused(&check("600"), &["reject", "--fresh"]);
    let (mut probe, address) = serve(&["--source", "scene:overcast", "--photometric", out]);
    let set: serde_json::Value = serde_json::from_str(&get(&address, "/lights.json")).expect("JSON");
    assert_eq!(set["unit"], "lux");
    assert!((0.04..0.12).contains(&set["unit_uncertainty"].as_f64().expect("a number")), "{set}");
    let rgb: Vec<f64> = set["horizontal_irradiance"]
        .as_array()
        .expect("RGB")
        .iter()
        .filter_map(serde_json::Value::as_f64)
        .collect();
    let lux = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    assert!((380.0..424.0).contains(&lux), "422 lux but for what the lens does not see: {lux}");
    let metrics = get(&address, "/metrics");
    for name in
        ["hemilux_horizontal_illuminance_lux ", "hemilux_scalar_illuminance_lux ", "hemilux_scalar_flux{"]
    {
        assert!(metrics.lines().any(|line| line.starts_with(name)), "{name}: {metrics}");
    }
    let info = get(&address, "/info");
    assert!(
        info.contains("horizontal illuminance")
            && info.contains("scalar flux")
            && info.contains(" lux within"),
        "{info}"
    );
    probe.kill().expect("running");
    probe.wait().expect("ended");
}

/// Starts a probe and returns its process and its address.
fn serve(arguments: &[&str]) -> (std::process::Child, String) {
    use std::io::BufRead;
    let mut command = Command::new(env!("CARGO_BIN_EXE_hemilux"));
    command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments).stdout(std::process::Stdio::piped());
    let mut probe = command.spawn().expect("the program runs");
    let mut line = String::new();
    let out = probe.stdout.take().expect("a pipe");
    std::io::BufReader::new(out).read_line(&mut line).expect("a line");
    let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()).expect("an address");
    (probe, address.to_owned())
}

fn get(address: &str, path: &str) -> String {
    use std::io::{Read, Write};
    let mut stream = std::net::TcpStream::connect(address).expect("a connection");
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    answer.split_once("\r\n\r\n").expect("a body").1.to_owned()
}

#[test]
fn photometric_options_that_do_not_belong_together_are_usage_errors() {
    for (more, word) in [
        (&["--patch", "1,2/3,4/5,6"][..], "--reflectance"),
        (&["--patch", "1,2/3,4", "--reflectance", "0.2", "--illuminance", "9"], "three corners"),
        (&["--lux", "0"], "positive"),
        (&["--lux", "1", "--class", "Day Light"], "daylight"),
        (&["--lux", "1", "--bursts", "0"], "1..=1000"),
        (&[], "--lux"),
    ] {
        let ended =
            run(&[&["photometric", "--source", "scene:room", "--out", "/nonexistent/x"][..], more].concat());
        assert_eq!(ended.status, Some(2), "{more:?}: {}", ended.error);
        assert!(ended.error.contains(word) && ended.error.lines().count() == 1, "{more:?}: {}", ended.error);
    }
}

/// Returns a picture in which each pixel is the mean of 15 x 15 pixels.
fn blurred(grey: &Grey) -> Grey {
    let [width, height] = grey.size();
    let image =
        image::GrayImage::from_raw(width as u32, height as u32, grey.pixels().to_vec()).expect("an image");
    Grey::new(width, image::imageops::fast_blur(&image, 6.0).into_raw()).expect("whole rows")
}

#[test]
fn guide_stores_each_picture_once_if_it_is_still_sharp_and_new() {
    let Some(pictures) = pictures() else { return };
    let board: Board = "8x6".parse().expect("a board");
    let mut guide = Guide::new(board.into());
    let greys = pictures.iter().map(|path| {
        let image = hemilux::recorded::read_grey(path).expect("a picture");
        Grey::new(image.width, image.samples).expect("whole rows")
    });
    let greys: Vec<Grey> = greys.collect();
    assert_eq!(guide.offer(Grey::new(1032, vec![90; 1032 * 778]).expect("whole rows")), Offer::Nothing);
    let soft = blurred(&greys[0]);
    guide.offer(soft.clone());
    assert!(matches!(guide.offer(soft), Offer::Blurred | Offer::Nothing), "a blurred board is not taken");
    for (i, grey) in greys.iter().enumerate() {
        let offers = [(); 3].map(|()| guide.offer(grey.clone()));
        let is_seen = offers[0] != Offer::Nothing;
        let expected =
            if is_seen { [Offer::Moving, Offer::Taken, Offer::Known] } else { [Offer::Nothing; 3] };
        assert_eq!(offers, expected, "picture {i}");
    }
    assert!(guide.views() >= 14, "{}", guide.views());
    let (views, share) = (guide.views(), guide.coverage().share());
    assert!((0.3..=1.0).contains(&share), "{share}");
    guide.undo();
    assert_eq!(guide.views(), views - 1, "the last one is taken back");
    assert_eq!(guide.offer(Grey::new(100, vec![90; 100 * 100]).expect("whole rows")), Offer::OtherSize);
    let calibrated = guide.calibrate().expect("a lens");
    assert!(
        calibrated.rms_px <= 0.30 && calibrated.boards() >= 13,
        "{} {}",
        calibrated.rms_px,
        calibrated.boards()
    );
}

#[test]
fn live_pictures_without_a_board_end_in_a_refusal() {
    let ended = run(&[
        "lens",
        "--live",
        "--source",
        "scene:room",
        "--board",
        "8x6",
        "--seconds",
        "2",
        "--out",
        "/nonexistent/x",
    ]);
    assert_eq!(ended.status, Some(1), "{}", ended.error);
    let last = ended.error.lines().last().expect("a line");
    assert!(ended.error.contains("show the board") && last.contains("found 0 picture(s)"), "{}", ended.error);
}
