//! Lens files, compared with pixels that other programs computed: OpenCV 5.0 (`cv2.fisheye.projectPoints`, `cv2.projectPoints`), and the
//! published formulas in NumPy for models that OpenCV does not have.

use super::{ForeignLens, Refusal, parse};
use glam::{DVec2, DVec3};
use hemilux_core::lens::Lens;

/// A pixel that another program computed for a direction.
struct Pixel {
    theta_deg: f64,
    phi_deg: f64,
    at: [f64; 2],
}

const fn pixel(theta_deg: f64, phi_deg: f64, x: f64, y: f64) -> Pixel {
    Pixel { theta_deg, phi_deg, at: [x, y] }
}

fn parsed(text: &str) -> ForeignLens {
    let file =
        parse(text).unwrap_or_else(|(found, expected)| panic!("{text}: found {found}, expected {expected}"));
    assert_eq!(file.size, [640, 480], "{text}");
    file
}

fn refused(text: &str) -> Refusal {
    parse(text).expect_err(text)
}

fn assert_pixels(name: &str, lens: &Lens, pixels: &[Pixel], tolerance_px: f64) {
    for p in pixels {
        let (theta, phi) = (p.theta_deg.to_radians(), p.phi_deg.to_radians());
        let d = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let found = lens.project(d).unwrap_or_else(|| panic!("{name}: {} degrees are not seen", p.theta_deg));
        let off = found.distance(DVec2::from_array(p.at));
        assert!(off < tolerance_px, "{name}: {} {}: {found}, expected {:?}", p.theta_deg, p.phi_deg, p.at);
    }
}

const FISHEYE: [Pixel; 4] = [
    pixel(10.0, 0.0, 352.834, 239.5),
    pixel(35.0, 40.0, 408.9775, 314.5806),
    pixel(60.0, 200.0, 131.1596, 170.9497),
    pixel(75.0, 170.0, 73.431, 282.8886),
];

const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ \
                      190.97, 0., 319.5, 0., 190.97, 239.5, 0., 0., 1. ]\nD: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ \
                      0.0034, 0.0007, -0.0020, 0.0002 ]\n";
const KALIBR: &str = "cam0:\n  camera_model: pinhole\n  distortion_model: equidistant\n  distortion_coeffs: [0.0034, 0.0007, -0.0020, \
                      0.0002]\n  intrinsics: [190.97, 190.97, 319.5, 239.5]\n  resolution: [640, 480]\n";
const ROS: &str = "image_width: 640\nimage_height: 480\ncamera_name: fisheye\ncamera_matrix: {rows: 3, cols: 3, data: [190.97, 0, 319.5, 0, \
                   190.97, 239.5, 0, 0, 1]}\ndistortion_model: equidistant\ndistortion_coefficients: {rows: 1, cols: 4, data: [0.0034, \
                   0.0007, -0.0020, 0.0002]}\n";
const ROS_2: &str = "header:\n  frame_id: camera\nheight: 480\nwidth: 640\ndistortion_model: equidistant\nd: [0.0034, 0.0007, -0.002, \
                     0.0002]\nk: [190.97, 0.0, 319.5, 0.0, 190.97, 239.5, 0.0, 0.0, 1.0]\nbinning_x: 0\nbinning_y: 0\n---\n";
const COLMAP: &str = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 OPENCV_FISHEYE 640 480 \
                      190.97 190.97 320.0 240.0 0.0034 0.0007 -0.0020 0.0002\n";
const JSON: &str = r#"{"K": [[190.97, 0, 319.5], [0, 190.97, 239.5], [0, 0, 1]], "D": [[0.0034], [0.0007], [-0.002], [0.0002]], "DIM": [640, 480]}"#;
const XML: &str = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_width><image_height>480</image_height>\n<camera_matrix \
                   type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data>\n 190.97 0. 319.5 0.\n 190.97 239.5 0. 0. \
                   1.</data></camera_matrix>\n<distortion_coefficients type_id=\"opencv-matrix\"><rows>4</rows><cols>1</cols><dt>d</dt>\n<data>\n \
                   0.0034 0.0007 -0.002 0.0002</data></distortion_coefficients>\n</opencv_storage>\n";

#[test]
fn a_fisheye_is_the_same_lens_in_the_files_of_every_program() {
    for (name, text) in [
        ("OpenCV", OPENCV),
        ("Kalibr", KALIBR),
        ("ROS", ROS),
        ("ROS 2", ROS_2),
        ("COLMAP", COLMAP),
        ("JSON", JSON),
        ("XML", XML),
    ] {
        let file = parsed(text);
        assert_pixels(name, &file.lens, &FISHEYE, 1e-3);
        assert!(file.notes.iter().all(|n| !n.contains("fitted")), "{name}: {:?}", file.notes);
        assert!(file.notes.iter().any(|n| n.contains("field of view")), "{name}: {:?}", file.notes);
    }
}

#[test]
fn other_models_are_fitted_and_the_deviation_is_noted() {
    let kalibr = |model: &str, intrinsics: &str, distortion: &str| {
        format!(
            "cam0:\n  camera_model: {model}\n  intrinsics: [{intrinsics}, 319.5, 239.5]\n  resolution: [640, 480]\n{distortion}"
        )
    };
    let none = "  distortion_model: none\n  distortion_coeffs: []\n";
    let radtan = "  distortion_model: radtan\n  distortion_coeffs: [-0.1, 0.01, 0, 0]\n";
    let ocam = "#polynomial coefficients for the DIRECT mapping function\n\n5 -200.0 0.0 0.0012 0.0 0.0\n\n#inverse\n\n3 1.0 2.0 3.0\n\n#center: \"row\" \
                and \"column\"\n\n239.5 319.5\n\n#affine parameters \"c\", \"d\", \"e\"\n\n1.0 0.0 0.0\n\n#image size: \"height\" and \
                \"width\"\n\n480 640\n";
    let fov = kalibr("pinhole", "300.0, 300.0", "  distortion_model: fov\n  distortion_coeffs: [0.9]\n");
    let angle = |theta_deg: f64| (2.0 * theta_deg.to_radians().tan() * 0.45f64.tan()).atan() / 0.9;
    let cases = [
        (
            "ds",
            kalibr("ds", "-0.2, 0.55, 160.0, 160.0", none),
            vec![
                pixel(10.0, 0.0, 354.4372, 239.5),
                pixel(35.0, 40.0, 414.1416, 318.9137),
                pixel(75.0, 170.0, 47.0873, 287.5337),
            ],
        ),
        (
            "eucm",
            kalibr("eucm", "0.6, 1.1, 180.0, 180.0", none),
            vec![
                pixel(10.0, 0.0, 350.9192, 239.5),
                pixel(60.0, 200.0, 141.3163, 174.6465),
                pixel(75.0, 170.0, 85.2318, 280.8078),
            ],
        ),
        (
            "omni",
            kalibr("omni", "1.2, 400.0, 400.0", radtan),
            vec![
                pixel(10.0, 0.0, 351.2719, 239.5),
                pixel(60.0, 200.0, 132.8585, 171.568),
                pixel(75.0, 170.0, 69.606, 283.5631),
            ],
        ),
        (
            "ocam",
            ocam.to_string(),
            vec![
                pixel(10.0, 0.0, 354.5061, 239.5),
                pixel(35.0, 40.0, 416.465, 320.8633),
                pixel(75.0, 170.0, 12.6401, 293.6077),
            ],
        ),
        (
            "fov",
            fov,
            vec![
                pixel(10.0, 0.0, 319.5 + 300.0 * angle(10.0), 239.5),
                pixel(40.0, 90.0, 319.5, 239.5 + 300.0 * angle(40.0)),
            ],
        ),
    ];
    for (name, text, pixels) in cases {
        let file = parsed(&text);
        assert_pixels(name, &file.lens, &pixels, 0.5);
        let note = file.notes.iter().find(|n| n.contains("fitted")).expect(name);
        let degrees: f64 =
            note.split("at most ").nth(1).and_then(|t| t.split(' ').next()).expect(note).parse().expect(note);
        assert!((0.0..0.2).contains(&degrees), "{name}: {note}");
    }
}

#[test]
fn pinholes_keep_two_radial_terms_and_other_distortions_are_fitted() {
    let ros = |model: &str, k: &str| {
        format!(
            "image_width: 640\nimage_height: 480\ndistortion_model: {model}\ncamera_matrix: {{data: [460, 0, 319.5, 0, 458, 239.5, 0, 0, \
             1]}}\ndistortion_coefficients: {{data: [{k}]}}\n"
        )
    };
    let exact = parsed(&ros("plumb_bob", "-0.1, 0.01, 0, 0, 0"));
    assert!(exact.notes.iter().all(|n| !n.contains("fitted")), "{:?}", exact.notes);
    let pixels = [
        pixel(10.0, 0.0, 399.897, 239.503),
        pixel(25.0, 40.0, 474.313, 368.884),
        pixel(30.0, 200.0, 91.170, 156.803),
    ];
    let fitted = parsed(&ros("plumb_bob", "-0.28, 0.07, 0.0002, -0.0003, 0.001"));
    // The fit does not represent the tangential terms, which are up to 0.6 pixels in this file.
    assert_pixels("plumb_bob", &fitted.lens, &pixels, 0.8);
    assert!(fitted.notes.iter().any(|n| n.contains("off by at most 0.")), "{:?}", fitted.notes);
    let rational = parsed(&ros("rational_polynomial", "-0.28, 0.07, 0, 0, 0.001, 0.01, 0.0, 0.0"));
    assert!(rational.notes.iter().any(|n| n.contains("fitted")), "{:?}", rational.notes);
}

#[test]
fn several_cameras_are_noted() {
    let second = KALIBR.replace("cam0", "cam1").replace("190.97", "250.0");
    let file = parsed(&format!("{KALIBR}{second}"));
    assert_pixels("the first", &file.lens, &FISHEYE, 1e-3);
    assert!(file.notes.iter().any(|n| n.contains("cam0, cam1")), "{:?}", file.notes);
}

#[test]
fn an_assumed_fisheye_is_noted_and_a_stated_one_is_not() {
    let is_told = |text: &str| parsed(text).notes.iter().any(|note| note.contains("fisheye_model: 0"));
    assert!(is_told(OPENCV), "four coefficients");
    assert!(!is_told(&format!("{OPENCV}fisheye_model: 1\n")), "stated");
}

#[test]
fn a_region_of_interest_is_refused_unless_it_is_the_whole_image() {
    let with = |x: u32, width: u32, height: u32| {
        format!("{OPENCV}roi:\n  x_offset: {x}\n  y_offset: 0\n  width: {width}\n  height: {height}\n")
    };
    let (found, _) = refused(&with(100, 320, 240));
    assert!(found.contains("320 x 240 at (100, 0)"), "{found}");
    for whole in [with(0, 0, 0), with(0, 640, 480)] {
        parsed(&whole);
    }
}

#[test]
fn files_without_a_lens_are_refused_by_name() {
    for (text, part) in [
        (String::new(), "empty"),
        ("hello".into(), "camera matrix"),
        ("{".into(), "neither TOML"),
        ("<opencv_storage>".into(), "XML"),
        (OPENCV.replace("image_width: 640\n", ""), "image size"),
        (OPENCV.replace("190.97, 0., 319.5, ", ""), "3 x 3"),
        (OPENCV.replace("0.0034", "x"), "distortion coefficients"),
        (OPENCV.replace("190.97", "-190.97"), "focal"),
        (OPENCV.replace("190.97", ".nan"), "3 x 3"),
        (KALIBR.replace("pinhole", "spherical"), "spherical"),
        (KALIBR.replace("equidistant", "thin_prism"), "thin_prism"),
        (KALIBR.replace("0.0002", "0.0002, 1.0"), "5 distortion"),
        (ROS.replace("equidistant", "mystery"), "mystery"),
        (ROS_2.replace("binning_x: 0", "binning_x: 2"), "binning"),
        (COLMAP.replace("OPENCV_FISHEYE", "THIN_PRISM_FISHEYE"), "THIN_PRISM_FISHEYE"),
        (COLMAP.replace("640 480", "0 0"), "size [0, 0]"),
        ("#polynomial\n1 -2\n".into(), "1 lines"),
        ("[".repeat(100_000), "nesting"),
        ("- ".repeat(100_000), "nesting"),
        ("<a>".repeat(100_000), "XML"),
        (format!("a: &a [1]\nb: [{}]", "*a, ".repeat(100)), "references"),
    ] {
        let (found, expected) = refused(&text);
        assert!(found.contains(part), "{part}: {found}");
        assert!(!expected.is_empty(), "{part}");
    }
}

#[test]
fn converted_files_are_read_back_as_the_same_lens() {
    use crate::recorded::{Target, convert};
    let folder = tempfile::tempdir().expect("a folder");
    let from = folder.path().join("from.yml");
    std::fs::write(&from, OPENCV).expect("a file");
    for target in [Target::Hemilux, Target::Opencv, Target::Ros] {
        let to = folder.path().join(format!("{target:?}"));
        std::fs::write(&to, convert(&from, target).expect("converted").text).expect("a file");
        let back = crate::recorded::read_lens(&to).expect("a lens file");
        assert_eq!(back.size, [640, 480], "{target:?}");
        assert_pixels(&format!("{target:?}"), &back.lens, &FISHEYE, 1e-3);
    }
    let pinhole = folder.path().join("pinhole.toml");
    let lens = "[lens]\nmodel = \"radial\"\nsize = [640, 480]\ncentre = [319.5, 239.5]\nfocal = [460.0, 458.0]\nk = [-0.1, 0.01]\nmax_angle_deg = 30.0\n";
    std::fs::write(&pinhole, lens).expect("a file");
    let told = convert(&pinhole, Target::Ros).expect("converted").text;
    assert!(told.contains("plumb_bob") && told.contains("[-0.1, 0.01, 0.0, 0.0, 0.0]"), "{told}");
    std::fs::write(&pinhole, lens.replace("radial", "equisolid").replace("k = [-0.1, 0.01]\n", ""))
        .expect("a file");
    assert!(
        convert(&pinhole, Target::Opencv).expect_err("refused").to_string().contains("equisolid"),
        "equisolid"
    );
}
