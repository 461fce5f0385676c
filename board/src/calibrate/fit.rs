//! Joint fit of a camera and the poses of all boards to the boards' corners.

use super::camera::Camera;
use super::found::FEWEST;
use super::pose::from_directions;
use super::shape::Shape;
use super::sighting::Sighting;
use super::solve::{Free, Model, View, solve};
use nalgebra::Vector2;

/// Largest distance between an accepted corner and its computed pixel, pixels.
pub(super) const LARGEST_PX: f64 = 1.5;

/// Width of the robust loss, pixels, at which the loss equals that of plain least squares.
const PLAIN: f64 = 1e4;

/// A camera fitted to the boards in several pictures.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// Camera model and shape of the board.
    pub model: Model,
    /// Detected corners and board pose of each picture whose board was used.
    pub views: Vec<View>,
    /// Index of the picture of each element of `views`.
    pub pictures: Vec<usize>,
}

/// Focal lengths at which the fit starts, as the angle from the axis that half the picture's width spans, degrees.
const TRIED_DEGREES: [f64; 14] =
    [20.0, 30.0, 40.0, 48.0, 56.0, 64.0, 72.0, 80.0, 88.0, 96.0, 105.0, 115.0, 125.0, 140.0];

/// Number of initial focal lengths from which the fit is carried to the end.
const CARRIED: usize = 3;

/// Computes the first fit from the detected corners `seen` and the size of the pictures alone.
pub(super) fn first(seen: &[(usize, Vec<Sighting>)], size: [usize; 2], shape: Shape) -> Option<Fit> {
    let middle = Vector2::new(size[0] as f64 - 1.0, size[1] as f64 - 1.0) * 0.5;
    let half = 0.5 * size[0].max(size[1]) as f64;
    let starts = TRIED_DEGREES.iter().map(|degrees| Camera::equidistant(half / degrees.to_radians(), middle));
    let mut tried: Vec<Trial> =
        starts.filter_map(|camera| placed(Model { camera, shape, rich: false }, seen)).collect();
    tried.sort_by(|a, b| a.error.total_cmp(&b.error));
    tried.truncate(CARRIED);
    let carried = tried.into_iter().map(|Trial { mut fit, .. }| {
        solve(&mut fit.model, &mut fit.views, 8.0, Free::All, 15);
        let error = solve(&mut fit.model, &mut fit.views, 2.0, Free::All, 40);
        Trial { error, fit }
    });
    carried.min_by(|a, b| a.error.total_cmp(&b.error)).map(|trial| trial.fit)
}

/// A fit and the error by which it is compared with other fits.
struct Trial {
    error: f64,
    fit: Fit,
}

/// Computes the poses of all boards for a given camera. The error is the sum of the root mean square errors of the boards in pixels, each
/// limited to 50; a board without a pose counts as 50.
fn placed(model: Model, seen: &[(usize, Vec<Sighting>)]) -> Option<Trial> {
    let place = |(picture, seen): &(usize, Vec<Sighting>)| {
        let pose = from_directions(&model.camera, &model.shape, seen)?;
        let view = View { seen: seen.clone(), pose };
        let error = root_mean_square(view.residuals(&model));
        Some((error, *picture, view))
    };
    let placed: Vec<_> = seen.iter().filter_map(place).collect();
    let error: f64 = placed.iter().map(|(error, ..)| error.min(50.0)).sum::<f64>()
        + 50.0 * (seen.len() - placed.len()) as f64;
    let (pictures, views) = placed.into_iter().map(|(_, picture, view)| (picture, view)).unzip();
    error.is_finite().then_some(Trial { error, fit: Fit { model, views, pictures } })
}

/// Returns the root mean square of `values`, over both components of each vector.
pub(super) fn root_mean_square(values: impl Iterator<Item = Vector2<f64>>) -> f64 {
    let (count, sum) = values.fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + v.norm_squared()));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

impl Fit {
    /// Returns the root mean square distance of all corners from their computed pixels, pixels.
    pub fn rms(&self) -> f64 {
        root_mean_square(self.views.iter().flat_map(|view| view.residuals(&self.model)))
    }

    /// Returns the number of accepted corners in all views.
    pub fn corners(&self) -> usize {
        self.views.iter().map(|view| view.seen.len()).sum()
    }

    /// Returns the largest distance of a corner from its computed pixel, pixels.
    pub fn largest(&self) -> f64 {
        self.views.iter().flat_map(|view| view.residuals(&self.model)).map(|r| r.norm()).fold(0.0, f64::max)
    }

    /// Returns the standard deviation of the error of a detected corner's column (or row), pixels. It is computed from the median residual, so
    /// that outliers do not change it.
    pub fn sigma(&self) -> f64 {
        let mut lengths: Vec<f64> =
            self.views.iter().flat_map(|v| v.residuals(&self.model)).map(|r| r.norm()).collect();
        lengths.sort_by(f64::total_cmp);
        // The median of a Rayleigh distribution is 1.1774 standard deviations.
        lengths.get(lengths.len() / 2).copied().unwrap_or(0.0) / 1.1774
    }

    /// Repeats the fit and the rejection of outliers until no corner is rejected; returns the number of rejected corners.
    pub fn settle(&mut self) -> usize {
        let before = self.corners();
        for _ in 0..6 {
            let width = (3.0 * self.sigma()).clamp(0.2, 3.0);
            solve(&mut self.model, &mut self.views, width, Free::All, 40);
            if self.reject() == 0 {
                break;
            }
        }
        self.polish();
        self.reject();
        before.saturating_sub(self.corners())
    }

    /// Fits the camera and the poses by plain least squares.
    pub fn polish(&mut self) {
        solve(&mut self.model, &mut self.views, PLAIN, Free::All, 40);
    }

    /// Rejects corners that are off by more than four standard deviations or [`LARGEST_PX`], and views with too few corners.
    fn reject(&mut self) -> usize {
        let before = self.corners();
        let most = (4.5 * self.sigma()).clamp(0.05, LARGEST_PX);
        for view in &mut self.views {
            let fits: Vec<bool> = view.residuals(&self.model).map(|r| r.norm() <= most).collect();
            let mut fits = fits.iter();
            view.seen.retain(|_| fits.next() == Some(&true));
        }
        let keep: Vec<bool> = self.views.iter().map(|view| view.seen.len() >= FEWEST).collect();
        let mut kept = keep.iter();
        self.views.retain(|_| kept.next() == Some(&true));
        let mut kept = keep.iter();
        self.pictures.retain(|_| kept.next() == Some(&true));
        before - self.corners()
    }
}
