//! Computation of a lens from pictures of a board.

use super::Printed;
use super::camera::Camera;
use super::check::{self, LensRefusal};
use super::detect;
use super::fit::{Fit, first, root_mean_square};
use super::found::Found;
use super::request::{Picture, Request};
use super::shape::Shape;
use super::sighting::Sighting;
use super::uncertainty::{self, Deviations, Spread};
use glam::DVec2;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use nalgebra::Vector2;

/// Largest accepted root mean square error of a fit, pixels.
const MOST_RMS_PX: f64 = 1.2;

/// Angle beyond the outermost corner of all boards up to which the fitted law is used, radians.
const BEYOND: f64 = 0.14;

/// A detected corner and its distance from the computed pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Pixel at which the corner was detected.
    pub at: DVec2,
    /// Detected pixel minus the pixel that the fitted lens predicts.
    pub off: DVec2,
}

/// The contribution of one picture to a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Used {
    /// Name of the picture in which the corner was detected.
    pub name: String,
    /// Number of accepted corners; 0 if no board was detected or used.
    pub corners: usize,
    /// Root mean square error of the accepted corners, pixels.
    pub rms_px: f64,
}

/// A lens computed from pictures, with its accuracy.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Lens model with its field of view.
    pub lens: Lens,
    /// Columns and rows of the pictures of the calibration.
    pub size: [usize; 2],
    /// Board that the pictures show.
    pub board: Printed,
    /// The contribution of each picture to the lens.
    pub used: Vec<Used>,
    /// Number of corners that were detected and rejected as outliers.
    pub left_out: usize,
    /// Root mean square distance between detected and computed corners, pixels.
    pub rms_px: f64,
    /// Largest distance between a detected and a computed corner, pixels.
    pub largest_px: f64,
    /// Angle from the axis of the outermost accepted corner, degrees.
    pub covered_deg: f64,
    /// Standard deviations of the focal lengths and the centre, pixels, and of k1 to k4.
    pub deviations: Deviations,
    /// Uncertainty of directions by angle from the axis.
    pub spread: Vec<Spread>,
    /// Residuals of all accepted corners of all pictures.
    pub residuals: Vec<Residual>,
    /// Largest distance of the board from a plane, in squares.
    pub bulge: f64,
}

impl Calibrated {
    /// Returns the number of pictures whose board was used.
    #[must_use]
    pub fn boards(&self) -> usize {
        self.used.iter().filter(|used| used.corners > 0).count()
    }

    /// Returns the number of accepted corners of all pictures.
    #[must_use]
    pub fn corners(&self) -> usize {
        self.residuals.len()
    }
}

/// Computes the lens from `pictures` of a board.
///
/// # Errors
/// [`LensRefusal`] if the pictures determine no lens.
pub fn calibrate(pictures: &[Picture], request: &Request) -> Result<Calibrated, LensRefusal> {
    let (size, board) = (check::pictures(pictures)?, request.board);
    let found = pictures.iter().map(|picture| detect(picture, &board)).collect::<Result<Vec<_>, _>>()?;
    fitted(pictures, &found, request, size)
}

/// Computes the lens from `pictures`, in which the corners `found` have been detected.
pub(super) fn fitted(
    pictures: &[Picture],
    found: &[Found],
    request: &Request,
    size: [usize; 2],
) -> Result<Calibrated, LensRefusal> {
    let board = request.board;
    check::found(pictures, found, request, size)?;
    let seen: Vec<(usize, Vec<Sighting>)> =
        found.iter().map(|f| f.seen.clone()).enumerate().filter(|(_, seen)| !seen.is_empty()).collect();
    let mut fit = first(&seen, size, Shape::new(board)).ok_or_else(|| no_fit(f64::INFINITY))?;
    let mut left_out = fit.settle();
    if !board.is_marked() {
        check::mirrored(pictures, found, &fit, board.corners, size[0])?;
    }
    for _ in 0..2 {
        complete(pictures, &mut fit, &board);
        left_out = fit.settle();
    }
    if !board.is_marked() {
        check::larger(pictures, &fit, board.corners)?;
    }
    if fit.views.len() < check::FEWEST_BOARDS || fit.rms() > MOST_RMS_PX {
        return Err(no_fit(fit.rms()));
    }
    result(pictures, &fit, board, size, left_out)
}

fn no_fit(rms_px: f64) -> LensRefusal {
    LensRefusal::NoFit { rms_px, most_px: MOST_RMS_PX }
}

fn detect(picture: &Picture, board: &Printed) -> Result<Found, LensRefusal> {
    let found = detect::board(&picture.grey, board);
    found.map_err(|e| LensRefusal::Detector { name: picture.name.clone(), found: e.to_string() })
}

/// Searches all pictures for missing corners at the positions that the fit predicts.
fn complete(pictures: &[Picture], fit: &mut Fit, board: &Printed) {
    for (view, picture) in fit.views.iter_mut().zip(&fit.pictures) {
        detect::complete(&pictures[*picture].grey, &fit.model, view, board);
    }
}

fn result(
    pictures: &[Picture],
    fit: &Fit,
    board: Printed,
    size: [usize; 2],
    left_out: usize,
) -> Result<Calibrated, LensRefusal> {
    let refused = || no_fit(fit.rms());
    let covered = covered(fit);
    let covariances = uncertainty::of_parameters(fit).ok_or_else(refused)?;
    Ok(Calibrated {
        lens: lens(&fit.model.camera, covered, size).ok_or_else(refused)?,
        size,
        board,
        used: used(pictures, fit),
        left_out,
        rms_px: fit.rms(),
        largest_px: fit.largest(),
        covered_deg: covered.to_degrees(),
        deviations: uncertainty::deviations(&covariances),
        spread: uncertainty::by_angle(fit, &covariances, covered),
        residuals: residuals(fit),
        bulge: fit.model.shape.bulge(),
    })
}

fn used(pictures: &[Picture], fit: &Fit) -> Vec<Used> {
    let one = |(i, picture): (usize, &Picture)| {
        let view = fit.pictures.iter().position(|p| *p == i).map(|k| &fit.views[k]);
        let rms_px = view.map_or(0.0, |view| root_mean_square(view.residuals(&fit.model)));
        Used { name: picture.name.clone(), corners: view.map_or(0, |view| view.seen.len()), rms_px }
    };
    pictures.iter().enumerate().map(one).collect()
}

fn residuals(fit: &Fit) -> Vec<Residual> {
    let vector = |v: Vector2<f64>| DVec2::new(v.x, v.y);
    let of_view = |view| {
        let view: &super::solve::View = view;
        let pairs = view.seen.iter().zip(view.residuals(&fit.model));
        pairs.map(|(s, off)| Residual { at: vector(s.at), off: vector(off) }).collect::<Vec<_>>()
    };
    fit.views.iter().flat_map(of_view).collect()
}

/// Returns the angle from the axis of the outermost accepted corner, radians.
fn covered(fit: &Fit) -> f64 {
    let seen = fit.views.iter().flat_map(|view| &view.seen);
    seen.map(|s| fit.model.camera.direction(s.at)).map(|d| d.xy().norm().atan2(d.z)).fold(0.0, f64::max)
}

/// Returns the lens for directions up to [`BEYOND`] the outermost corner, further limited by the angle up to which the law increases and by
/// the picture's edge.
fn lens(camera: &Camera, covered: f64, size: [usize; 2]) -> Option<Lens> {
    let (focal, centre) = (camera.focal(), camera.centre());
    let farthest = [[0, 0], [size[0] - 1, 0], [0, size[1] - 1], [size[0] - 1, size[1] - 1]]
        .map(|[x, y]| (Vector2::new(x as f64, y as f64) - centre).component_div(&focal).norm());
    let rim = camera.angle(farthest.into_iter().fold(0.0, f64::max));
    let max_theta = (covered + BEYOND).min(camera.limit() - 0.01).min(rim);
    let k = std::array::from_fn(|i| camera.0[4 + i]);
    let intrinsics = Intrinsics {
        model: Model::KannalaBrandt(k),
        centre_px: DVec2::new(centre.x, centre.y),
        focal_px: DVec2::new(focal.x, focal.y),
        skew_px: 0.0,
        max_theta,
        vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    };
    Lens::try_new(intrinsics).ok()
}
