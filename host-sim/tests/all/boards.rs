//! Calibration of lenses by rendered pictures of boards, against the true lens.

use glam::{DVec2, DVec3};
use hemilux::calibrate::{Board, Calibrated, Grey, Picture, calibrate};
use hemilux_sim::boards::{BoardCamera, Directions, Law, picture, poses};

/// Number of pictures with which each lens is calibrated.
const PICTURES: usize = 24;

/// Returns a camera with a lens of 186 degrees and the projection law `law`.
fn camera(law: Law) -> BoardCamera {
    let max_theta = 93f64.to_radians();
    let focal = 345.0 / law.radius(max_theta);
    BoardCamera {
        law,
        focal_px: DVec2::new(focal, 1.003 * focal),
        centre_px: DVec2::new(371.3, 358.8),
        size: [736, 720],
        max_theta,
        falloff: 0.6,
        blur_px: 0.7,
        noise: 3.0,
    }
}

fn calibrated(camera: &BoardCamera, seed: u64) -> Calibrated {
    let squares = [9, 7];
    let directions = Directions::of(camera);
    let pictures: Vec<Picture> = poses(camera, squares, PICTURES, seed)
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let codes = picture(&directions, squares, pose, seed + 1000 + i as u64);
            Picture { name: format!("view {i}"), grey: Grey::new(camera.size[0], codes).expect("whole rows") }
        })
        .collect();
    calibrate(&pictures, &Board { columns: 8, rows: 6 }.into()).expect("a lens")
}

/// Returns the uncertainty that the calibration states at an angle from the axis, degrees.
fn stated(calibrated: &Calibrated, angle_deg: f64) -> f64 {
    let spread = &calibrated.spread;
    let next = spread.iter().position(|s| s.angle_deg >= angle_deg).unwrap_or(spread.len() - 1).max(1);
    let (a, b) = (&spread[next - 1], &spread[next]);
    let t = (angle_deg - a.angle_deg) / (b.angle_deg - a.angle_deg);
    a.uncertainty_deg + t * (b.uncertainty_deg - a.uncertainty_deg)
}

/// Errors of the calibrated directions of pixels over the whole field of view.
struct Errors {
    /// RMS error of the directions, degrees.
    rms_deg: f64,
    /// Largest error of a direction within two degrees of the rim, degrees.
    rim_deg: f64,
    /// Fraction of the pixels whose direction has an error of at most twice the stated uncertainty.
    within: f64,
}

fn errors(camera: &BoardCamera, calibrated: &Calibrated) -> Errors {
    let pixels =
        (0..camera.size[1]).step_by(6).flat_map(|y| (0..camera.size[0]).step_by(6).map(move |x| [x, y]));
    let directions = Directions::of(camera);
    let (mut sum, mut count, mut rim_deg, mut within) = (0.0, 0.0, 0f64, 0.0);
    for [x, y] in pixels {
        let pixel = DVec2::new(x as f64, y as f64);
        let Some(truth) = directions.at(pixel) else { continue };
        let found = calibrated.lens.unproject(pixel).unwrap_or(DVec3::NEG_Z);
        let error = truth.angle_between(found).to_degrees();
        let angle = DVec3::Z.angle_between(truth).to_degrees();
        sum += error * error;
        count += 1.0;
        if angle > 91.0 {
            rim_deg = rim_deg.max(error);
        }
        if error <= 2.0 * stated(calibrated, angle) {
            within += 1.0;
        }
    }
    Errors { rms_deg: f64::sqrt(sum / count), rim_deg, within: within / count }
}

fn check(law: Law, seed: u64) {
    let camera = camera(law);
    let calibrated = calibrated(&camera, seed);
    let Errors { rms_deg, rim_deg, within } = errors(&camera, &calibrated);
    let text = format!(
        "{law:?}: {} boards, {} corners, {:.3} px, covered {:.1}; error {rms_deg:.4}, at the rim {rim_deg:.4} degrees; within twice the \
         stated on {within:.3}; {:?}",
        calibrated.boards(),
        calibrated.corners(),
        calibrated.rms_px,
        calibrated.covered_deg,
        calibrated.spread
    );
    println!("{text}");
    assert!(calibrated.boards() >= 20, "{text}");
    assert!(rms_deg <= 0.1 && rim_deg <= 0.3, "{text}");
    assert!(within >= 0.95, "{text}");
}

#[test]
fn equidistant_lens_of_186_degrees_is_found() {
    check(Law::Equidistant, 1);
}

#[test]
fn kannala_brandt_lens_of_186_degrees_is_found() {
    check(Law::KannalaBrandt([-0.03, 0.012, -0.006, 0.0009]), 2);
}

#[test]
fn equisolid_lens_of_186_degrees_is_found() {
    check(Law::Equisolid, 3);
}

#[test]
fn double_sphere_lens_of_186_degrees_is_found() {
    check(Law::DoubleSphere { xi: -0.2, alpha: 0.6 }, 4);
}

/// The pictures have the size of a machine-vision camera, 748 x 480 pixels; the image circle is cut above and below, and all boards are far off the
/// axis.
#[test]
fn boards_far_off_the_axis_are_found_and_fit() {
    for (law, seed) in [
        (Law::KannalaBrandt([-0.02, 0.004, -0.001, 0.0]), 5),
        (Law::DoubleSphere { xi: -0.15, alpha: 0.58 }, 6),
    ] {
        let max_theta = 95f64.to_radians();
        let focal = 300.0 / law.radius(max_theta);
        let camera = BoardCamera {
            law,
            focal_px: DVec2::splat(focal),
            centre_px: DVec2::new(376.4, 236.9),
            size: [748, 480],
            max_theta,
            falloff: 0.5,
            blur_px: 0.8,
            noise: 3.0,
        };
        let squares = [9, 7];
        let off_axis = |pose: &hemilux_sim::boards::Pose| {
            let direction = pose.middle.normalize();
            let theta = DVec3::Z.angle_between(direction);
            let pixel = camera.centre_px + direction.truncate().normalize() * law.radius(theta) * focal;
            let inside = pixel.cmpge(DVec2::splat(70.0)).all() && pixel.cmple(DVec2::new(677.0, 409.0)).all();
            inside && theta > 35f64.to_radians()
        };
        let directions = Directions::of(&camera);
        let pictures: Vec<Picture> = poses(&camera, squares, 80, seed)
            .iter()
            .filter(|pose| off_axis(pose))
            .take(16)
            .enumerate()
            .map(|(i, pose)| {
                let codes = picture(&directions, squares, pose, seed + 2000 + i as u64);
                Picture { name: format!("view {i}"), grey: Grey::new(748, codes).expect("whole rows") }
            })
            .collect();
        assert_eq!(pictures.len(), 16, "enough poses");
        let calibrated = calibrate(&pictures, &Board { columns: 8, rows: 6 }.into()).expect("a lens");
        let text = format!(
            "{law:?}: {} boards, {} corners, {:.3} px, largest {:.3} px",
            calibrated.boards(),
            calibrated.corners(),
            calibrated.rms_px,
            calibrated.largest_px
        );
        println!("{text}");
        assert!(
            calibrated.boards() >= 15 && calibrated.rms_px <= 0.26 && calibrated.largest_px <= 1.5,
            "{text}"
        );
    }
}
