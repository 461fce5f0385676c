//! The page in a real browser: Chromium without a window, driven by playwright-core from `page/*.mjs`.
//!
//! HEMILUX_NODE names a folder with node_modules/playwright-core and axe-core (`npm install --prefix FOLDER playwright-core axe-core`). If a
//! tool is missing, the test prints its name and is skipped; with `HEMILUX_RIG=1` it fails.

mod bench;

use bench::board::{BoardCamera, true_lens};
use bench::room::{RoomCamera, true_code, true_illumination};
use bench::{Bench, SECRET, Step, browser, with_token};
use glam::DVec3;
use hemilux::config_file::ConfigFile;
use hemilux::probe::Config;
use hemilux::probe::settings::wish_of;
use hemilux::recorded::{read_lens, read_photometric};
use hemilux::server::{Access, KnownHosts, Limits, Options};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const EVERY: Duration = Duration::from_millis(100);

/// A lock, so that one browser runs at a time: without a GPU a browser uses all processors.
static BROWSER: Mutex<()> = Mutex::new(());

/// Runs a scenario of `page/run.mjs` against `bench`, which is stopped and started on the request of the scenario.
fn run(scenario: &str, bench: impl FnOnce() -> Bench) {
    run_moving(scenario, bench, || unreachable!("{scenario} moves nothing before the camera"));
}

/// Runs a scenario like [`run`], and calls `next` on the request of the scenario to move the object before the camera.
fn run_moving(scenario: &str, bench: impl FnOnce() -> Bench, next: impl Fn()) {
    let waited = || {
        let bench = bench();
        bench.wait();
        bench
    };
    run_with(scenario, waited, next);
}

/// Runs a scenario like [`run_moving`], for a bench that may have no light set.
fn run_with(scenario: &str, bench: impl FnOnce() -> Bench, next: impl Fn()) {
    let Some((program, folder)) = browser::tools() else { return };
    let _alone = BROWSER.lock().unwrap_or_else(PoisonError::into_inner);
    let mut bench = bench();
    let address = bench.address();
    let mut child = browser::scenario(scenario, &format!("http://{address}/"), SECRET, program, &folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("node runs");
    let mut said = child.stdin.take().expect("a pipe");
    let (mut told, mut stopped) = (Vec::new(), None);
    for line in BufReader::new(child.stdout.take().expect("a pipe")).lines() {
        let line = line.expect("text");
        match line.as_str() {
            "stop" => {
                bench.running.stop();
                stopped = Some(bench.probe);
                bench = Bench::running(EVERY, Limits::default(), Options::default());
            }
            "start" => {
                drop(stopped.take());
                bench = Bench::at(address, EVERY);
            }
            "next" => next(),
            _ => told.push(line),
        }
        // The scenario may have ended already.
        let _ = writeln!(said, "done");
    }
    let _ = child.wait();
    println!("{scenario}: {}", told.join("\n"));
    assert_eq!(told.last().map(String::as_str), Some("passed"), "{scenario}: {}", told.join("\n"));
}

fn open() -> Bench {
    Bench::running(EVERY, Limits::default(), Options::default())
}

#[test]
fn page_displays_the_lights_and_updates_them() {
    run("live", open);
}

#[test]
fn controls_work_by_keyboard_and_no_element_is_wider_than_a_phone() {
    run("controls", || Bench::still(EVERY));
}

#[test]
fn every_setting_has_an_effect_and_wrong_input_is_refused_beside_its_field() {
    run("settings", open);
}

#[test]
fn two_samplers_are_compared_on_the_same_frames() {
    run("compare", open);
}

#[test]
fn saved_settings_are_loaded_at_the_next_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("hemilux.toml");
    std::fs::write(&path, "# Mine.\nlisten = \"127.0.0.1:0\"\n").expect("a file");
    let file = ConfigFile::open(&path).expect("a configuration").file;
    let options = Options { file: Some(file), ..Options::default() };
    run("save", || Bench::running(EVERY, Limits::default(), options));
    if browser::tools().is_none() {
        return;
    }
    let kept = ConfigFile::open(&path).expect("a configuration").kept;
    let settings = serde_json::to_value(kept.settings).expect("JSON");
    let mut config = Config::steady();
    wish_of(settings.as_object().expect("settings")).expect("settings").apply(&mut config);
    assert_eq!((config.pipeline.lights, config.budgets.ms(1)), (21, 12.5), "{settings}");
    assert_eq!(config.exposures_s, Some(vec![0.001, 0.02]), "{settings}");
    let text = std::fs::read_to_string(&path).expect("a file");
    assert!(text.starts_with("# Mine.\nlisten = \"127.0.0.1:0\"\n"), "other lines are unchanged: {text}");
}

#[test]
fn approximations_of_the_shading_are_hardly_visible() {
    run("shading", || Bench::still(EVERY));
}

#[test]
fn shadows_of_discs_equal_the_mean_shadow_of_many_points() {
    run("penumbra", || Bench::still(EVERY));
}

#[test]
fn a_shadow_is_visible_without_a_gpu() {
    run("gathered", || Bench::still(EVERY));
}

/// The test prints figures and asserts nothing about them.
#[test]
fn the_first_picture_and_the_scene_are_timed() {
    run("speed", open);
}

#[test]
fn nothing_is_shown_or_changed_without_the_token() {
    let access = with_token();
    run("login", || Bench::running(EVERY, Limits::default(), Options { access, ..Options::default() }));
}

/// Starts a probe whose second host name is `probe.lan`.
fn known(access: Access) -> Bench {
    let hosts = KnownHosts::of(([127, 0, 0, 1], 0).into(), &["probe.lan".to_owned()]);
    Bench::running(EVERY, Limits::default(), Options { hosts, access, ..Options::default() })
}

#[test]
fn foreign_pages_change_nothing_without_a_token() {
    run("foreignOpen", || known(Access::Open));
}

#[test]
fn foreign_pages_change_nothing_with_remembered_basic_credentials() {
    run("foreignBasic", || known(with_token()));
}

#[test]
fn foreign_pages_change_nothing_with_a_session_cookie() {
    run("foreignCookie", || known(with_token()));
}

#[test]
fn offered_files_and_program_texts_work_unchanged() {
    let options = Options { origins: vec!["http://localhost:8000".into()], ..Options::default() };
    run("visitor", || Bench::running(EVERY, Limits::default(), options));
}

#[test]
fn the_first_view_and_the_stream_after_it_are_small() {
    run("traffic", open);
}

#[test]
fn page_displays_the_fault_of_a_probe_without_a_camera() {
    run_with(
        "fault",
        || {
            let bench = Bench::new(Limits::default());
            bench.step(Step::Fail("no camera at /dev/video7"));
            bench
        },
        || unreachable!("nothing moves before a camera that fails"),
    );
}

#[test]
fn another_source_is_chosen_on_the_page() {
    run("source", open);
}

#[test]
fn page_continues_after_the_probe_restarts() {
    run("restart", open);
}

/// Runs the calibration as a person would, with a camera before which a board is moved.
#[test]
fn a_lens_is_calibrated_on_the_page_and_saved() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lens.toml");
    let options = Options { calibration_file: Some(path.clone()), ..Options::default() };
    let camera = || Box::new(BoardCamera::new(EVERY, Duration::from_secs(2)));
    run("calibrate", || Bench::of(camera(), std::sync::mpsc::channel().0, Limits::default(), 64, options));
    if browser::tools().is_none() {
        return;
    }
    let file = read_lens(&path).expect("a lens file");
    assert_eq!(file.size, [480, 480]);
    for (theta, phi) in [(0.0, 0.0), (0.5, 1.0), (1.0, 3.0), (1.0, 5.0), (1.25, 2.0)] {
        let truth =
            DVec3::new(f64::sin(theta) * f64::cos(phi), f64::sin(theta) * f64::sin(phi), f64::cos(theta));
        let pixel = true_lens().project(truth).expect("in view");
        let found = file.lens.unproject(pixel).expect("in view");
        assert!(truth.angle_between(found) < 0.2f64.to_radians(), "{theta} {phi}: {found}");
    }
    let photometric = read_photometric(&path, None).expect("a photometric calibration");
    assert!(photometric.factor > 0.0 && photometric.uncertainty < 0.5, "{photometric:?}");
}

/// Returns a bench whose page writes to `path`.
fn calibrating(camera: RoomCamera, path: &Path) -> Bench {
    let options = Options { calibration_file: Some(path.into()), ..Options::default() };
    Bench::of(Box::new(camera), std::sync::mpsc::channel().0, Limits::default(), 64, options)
}

/// Measures vignetting on a phone as a person would: a lit screen at one angle after another.
#[test]
fn vignetting_is_measured_on_a_phone_and_saved() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lens.toml");
    std::fs::write(&path, LENS).expect("a file");
    let place = Arc::new(AtomicUsize::new(0));
    let camera = RoomCamera::screens(EVERY, Arc::clone(&place));
    run_moving(
        "vignetting",
        || calibrating(camera, &path),
        || {
            place.fetch_add(1, Ordering::Relaxed);
        },
    );
    if browser::tools().is_none() {
        return;
    }
    let lens = read_lens(&path).expect("a lens file").lens;
    for degrees in [20.0, 40.0, 60.0, 80.0f64] {
        let theta = degrees.to_radians();
        let found = lens.illumination(theta) / lens.illumination(0.0);
        assert!((found / true_illumination(theta) - 1.0).abs() < 0.02, "{degrees} degrees: {found}");
    }
}

/// The lens file of the camera in the room.
const LENS: &str = "version = 1

[lens]
model = \"equidistant\"
size = [480, 480]
centre = [239.5, 239.5]
focal = [152.47, 152.47]
max_angle_deg = 90.0
";

/// Calibrates on a phone as a person would: the image circle by touch, and the response from a still scene.
#[test]
fn circle_and_response_are_found_on_a_phone_and_saved() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lens.toml");
    run("response", || calibrating(RoomCamera::still(EVERY), &path));
    if browser::tools().is_none() {
        return;
    }
    let file = read_lens(&path).expect("a lens file");
    let response = file.told_response().expect("a response");
    // A response is determined up to a factor.
    let factor = |x: f64| response.exposure(1, true_code(x)) / x;
    for exposure in [0.02, 0.1, 0.4, 0.8] {
        let off = factor(exposure) / factor(0.2) - 1.0;
        assert!(off.abs() < 0.03, "relative exposure {exposure}: {off}");
    }
}
