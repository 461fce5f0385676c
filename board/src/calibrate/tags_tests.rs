//! Boards with marks, and mirrored boards, in pictures through a known lens.

use super::board::{Board, Charuco, Kind, Printed};
use super::target::{Ink, ink, size};
use super::{Calibrated, Grey, LensRefusal, Picture, Request, calibrate};
use glam::{DMat3, DVec2, DVec3};
use hemilux_core::lens::Lens;
use std::f64::consts::TAU;

const SIDE: usize = 640;

/// Number of samples along the side of a square or tag in a drawing.
const FINE: f64 = 48.0;

/// A board as a bitmap with a margin of one square.
struct Drawing {
    size: [usize; 2],
    black: Vec<bool>,
}

impl Drawing {
    fn of(printed: &Printed) -> Self {
        let size = size(printed).map(|n| ((n + 2.0) * FINE).round() as usize);
        let mut black = vec![false; size[0] * size[1]];
        for part in ink(printed) {
            let range = |axis: usize| {
                let at = part.at[axis] + 1.0;
                ((at * FINE).round() as usize, ((at + part.size[axis]) * FINE).round() as usize)
            };
            let ((left, right), (top, bottom)) = (range(0), range(1));
            (top..bottom).for_each(|y| black[y * size[0] + left..y * size[0] + right].fill(true));
        }
        Self { size, black }
    }

    /// Returns the code of the drawing at `place`, in squares from its centre; `None` outside of it.
    fn at(&self, place: DVec2) -> Option<f64> {
        let at = place * FINE + DVec2::new(self.size[0] as f64, self.size[1] as f64) * 0.5;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then(|| if self.black[at.y as usize * self.size[0] + at.x as usize] { 25.0 } else { 210.0 })
    }
}

fn lens() -> Lens {
    Lens::equidistant([322.3, 316.8], 196.0, 92f64.to_radians()).expect("a lens")
}

/// Returns a pseudo-random number from 0 to 1.
fn random(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Returns a picture, number `i` of `count`, of a board whose centre is at `distance` and at an angle from the axis, rotated and tilted.
fn picture(drawing: &Drawing, i: u64, count: u64, distance: f64) -> Grey {
    let lens = lens();
    let theta = 1.25 * ((i as f64 + 0.3) / count as f64).sqrt();
    let phi = 2.399_963 * i as f64;
    let out = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
    let tilt = DMat3::from_axis_angle(out.any_orthonormal_vector(), 0.2 + 0.4 * random(2 * i));
    let normal = DMat3::from_axis_angle(out, TAU * random(2 * i + 1)) * tilt * out;
    let columns = DMat3::from_axis_angle(normal, TAU * random(3 * i + 70)) * normal.any_orthonormal_vector();
    let axes = [columns, normal.cross(columns)];
    let seen = |at: DVec2| {
        let Some(direction) = lens.unproject(at) else { return 0.0 };
        let reach = (out * distance).dot(normal) / direction.dot(normal);
        let place = direction * reach - out * distance;
        let place = DVec2::new(place.dot(axes[0]), place.dot(axes[1]));
        drawing.at(place).filter(|_| reach > 0.0).unwrap_or(95.0 + 30.0 * (3.0 * direction.x).sin())
    };
    let code = |pixel: usize| {
        let at = DVec2::new((pixel % SIDE) as f64, (pixel / SIDE) as f64);
        let steps = [-0.4, -0.2, 0.0, 0.2, 0.4];
        let sum: f64 = steps
            .iter()
            .flat_map(|x| steps.iter().map(move |y| DVec2::new(*x, *y)))
            .map(|d| seen(at + 1.2 * d))
            .sum();
        (sum / 25.0 + 4.0 * (random(i << 32 | pixel as u64) - 0.5)).round().clamp(0.0, 255.0) as u8
    };
    Grey::new(SIDE, (0..SIDE * SIDE).map(code).collect()).expect("whole rows")
}

fn pictures(printed: &Printed, count: u64) -> Vec<Picture> {
    let drawing = Drawing::of(printed);
    let distance = 0.62 * size(printed)[0];
    let one = |i| Picture { name: format!("view {i}"), grey: picture(&drawing, i, count, distance) };
    (0..count).map(one).collect()
}

/// Returns the root mean square error of the calibrated directions over the covered field, degrees.
fn error(calibrated: &Calibrated) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for i in 0..40 {
        for j in 0..24 {
            let (theta, phi) =
                (f64::from(i) / 40.0 * calibrated.covered_deg.to_radians(), TAU * f64::from(j) / 24.0);
            let truth = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let Some(pixel) = lens().project(truth) else { continue };
            let found = calibrated.lens.unproject(pixel).unwrap_or(DVec3::NEG_Z);
            sum += truth.angle_between(found).to_degrees().powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / count)
}

fn assert_found(printed: Printed) {
    let request = Request { board: printed, any_colours: false };
    let calibrated = calibrate(&pictures(&printed, 14), &request).expect("a lens");
    let text = format!(
        "{printed}: {} boards, {} corners, {:.3} px, covered {:.1}, error {:.4}",
        calibrated.boards(),
        calibrated.corners(),
        calibrated.rms_px,
        calibrated.covered_deg,
        error(&calibrated)
    );
    println!("{text}");
    assert!(calibrated.boards() >= 12 && calibrated.rms_px < 0.3 && calibrated.largest_px <= 1.5, "{text}");
    assert!(calibrated.covered_deg > 75.0 && error(&calibrated) < 0.1, "{text}");
}

fn charuco() -> Printed {
    let kind = Kind::Charuco(Charuco::new("DICT_4X4_50", 0.75).expect("a dictionary"));
    Printed { corners: Board { columns: 8, rows: 6 }, kind }
}

#[test]
fn charuco_boards_determine_the_lens() {
    assert_found(charuco());
}

#[test]
fn april_grids_determine_the_lens() {
    assert_found(Printed::april_grid(Board { columns: 6, rows: 5 }, 0.3).expect("a board"));
}

fn mirrored(pictures: &[Picture]) -> Vec<Picture> {
    pictures.iter().map(|p| Picture { name: p.name.clone(), grey: p.grey.mirrored() }).collect()
}

#[test]
fn sets_of_mirrored_pictures_are_refused_if_the_board_is_asymmetric() {
    let odd = Printed::from(Board { columns: 9, rows: 7 });
    assert!(odd.tells_mirror() && !Printed::from(Board { columns: 8, rows: 6 }).tells_mirror());
    for board in [odd, charuco()] {
        let request = Request { board, any_colours: false };
        let straight = pictures(&board, 7);
        calibrate(&straight, &request).expect("a lens");
        let all = mirrored(&straight);
        let refused = calibrate(&all, &request).expect_err("mirrored");
        assert!(
            matches!(refused, LensRefusal::AllMirrored { found, .. } if found >= 3),
            "{board}: {refused}"
        );
        let one = [&straight[..3], &all[3..4], &straight[4..]].concat();
        let refused = calibrate(&one, &request).expect_err("one mirrored");
        assert_eq!(refused, LensRefusal::Mirrored { name: "view 3".into() }, "{board}");
    }
    let request = Request { board: odd, any_colours: true };
    calibrate(&mirrored(&pictures(&odd, 7)), &request).expect("a board of the other colours");
}

/// Returns the hash (FNV-1a, row by row) of a board's bits, sampled at their centres; a square or tag has `fine` bits in a row.
fn digest(printed: &Printed, fine: f64) -> u64 {
    let [columns, rows] = size(printed).map(|n| (fine * n).round() as usize);
    let ink = ink(printed);
    let is_black = |i: usize| {
        let at = [(i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5].map(|v| v / fine);
        let holds = |part: &Ink, axis: usize| (0.0..part.size[axis]).contains(&(at[axis] - part.at[axis]));
        ink.iter().any(|part| holds(part, 0) && holds(part, 1))
    };
    (0..columns * rows).fold(0xcbf2_9ce4_8422_2325u64, |hash, i| {
        (hash ^ u64::from(is_black(i))).wrapping_mul(0x0100_0000_01b3)
    })
}

/// A bit is an eighth of a square: markers have 6 x 6 bits and a margin of one bit.
#[test]
fn charuco_target_equals_that_of_opencv() {
    let digest = digest(&charuco(), 8.0);
    assert_eq!(digest, OPENCV, "{digest:x}");
}

/// A bit is a tenth of a tag: 6 x 6 bits with a border of two on each side; the gap has the width of three bits.
#[test]
fn april_grid_target_equals_that_of_kalibr() {
    let digest = digest(&Printed::april_grid(Board { columns: 6, rows: 5 }, 0.3).expect("a board"), 10.0);
    assert_eq!(digest, KALIBR, "{digest:x}");
}

/// Digest of `cv2.aruco.CharucoBoard((9, 7), 8, 6, DICT_4X4_50).generateImage((72, 56))` of OpenCV 5.0.0.
const OPENCV: u64 = 0x932e_1ef1_9d39_56cb;

/// Digest of the board of `kalibr_create_target_pdf --type apriltag --nx 6 --ny 5 --tspace 0.3`, drawn with its codes, its order of tags and
/// its rotation.
const KALIBR: u64 = 0xcedb_a56d_5b04_c499;
