//! A camera and the poses of all boards from their corners.

use super::camera::Camera;
use super::detect::FEWEST;
use super::pose::{Sighting, from_directions};
use super::shape::Shape;
use super::solve::{Free, Model, View, solve};
use nalgebra::Vector2;

/// Largest residual of a corner that is kept, pixels.
pub(super) const LARGEST_PX: f64 = 1.5;

/// Width of the loss that stands for plain least squares.
const PLAIN: f64 = 1e4;

/// A camera with its views; each view remembers its picture.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// The camera and the board's shape.
    pub model: Model,
    /// Pictures of which the board was used.
    pub views: Vec<View>,
    /// The picture of each view.
    pub pictures: Vec<usize>,
}

/// Focal lengths that are tried, as the angle from the axis that half the picture's width spans, degrees.
const TRIED_DEGREES: [f64; 14] =
    [20.0, 30.0, 40.0, 48.0, 56.0, 64.0, 72.0, 80.0, 88.0, 96.0, 105.0, 115.0, 125.0, 140.0];

/// Fits which are carried on from the start.
const CARRIED: usize = 3;

/// The first fit, without anything known but the size of the pictures.
pub(super) fn first(seen: &[(usize, Vec<Sighting>)], size: [usize; 2], shape: Shape) -> Option<Fit> {
    let middle = Vector2::new(size[0] as f64 - 1.0, size[1] as f64 - 1.0) * 0.5;
    let half = 0.5 * size[0].max(size[1]) as f64;
    let starts = TRIED_DEGREES.iter().map(|degrees| Camera::equidistant(half / degrees.to_radians(), middle));
    let mut tried: Vec<(f64, Fit)> =
        starts.filter_map(|camera| placed(Model { camera, shape, rich: false }, seen)).collect();
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried.truncate(CARRIED);
    let carried = tried.into_iter().map(|(_, mut fit)| {
        solve(&mut fit.model, &mut fit.views, 8.0, Free::All, 15);
        let loss = solve(&mut fit.model, &mut fit.views, 2.0, Free::All, 40);
        (loss, fit)
    });
    carried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, fit)| fit)
}

/// Places all boards before a camera; returns the mean of the robust errors of the boards.
fn placed(model: Model, seen: &[(usize, Vec<Sighting>)]) -> Option<(f64, Fit)> {
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
    error.is_finite().then_some((error, Fit { model, views, pictures }))
}

/// The root of the mean square of vectors, over both components.
pub(super) fn root_mean_square(values: impl Iterator<Item = Vector2<f64>>) -> f64 {
    let (count, sum) = values.fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + v.norm_squared()));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

impl Fit {
    /// The error of all corners: the root of the mean square distance, pixels.
    pub fn rms(&self) -> f64 {
        root_mean_square(self.views.iter().flat_map(|view| view.residuals(&self.model)))
    }

    /// Number of corners.
    pub fn corners(&self) -> usize {
        self.views.iter().map(|view| view.seen.len()).sum()
    }

    /// The largest residual, pixels.
    pub fn largest(&self) -> f64 {
        self.views.iter().flat_map(|view| view.residuals(&self.model)).map(|r| r.norm()).fold(0.0, f64::max)
    }

    /// Standard deviation of one coordinate of a corner, from the median residual: outliers do not count.
    pub fn sigma(&self) -> f64 {
        let mut lengths: Vec<f64> =
            self.views.iter().flat_map(|v| v.residuals(&self.model)).map(|r| r.norm()).collect();
        lengths.sort_by(f64::total_cmp);
        // The median of a Rayleigh distribution is 1.1774 standard deviations.
        lengths.get(lengths.len() / 2).copied().unwrap_or(0.0) / 1.1774
    }

    /// Fits anew, leaves out what does not fit, until nothing more has to go; returns the number of corners left out.
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

    /// Plain least squares.
    pub fn polish(&mut self) {
        solve(&mut self.model, &mut self.views, PLAIN, Free::All, 40);
    }

    /// Leaves out corners beyond four standard deviations or the largest residual, and views with too few corners.
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
