//! The Kannala-Brandt camera model with its derivatives.

use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2, Vector3};

/// Number of intrinsic parameters of a camera.
pub(super) const INTRINSICS: usize = 10;

/// Derivatives of the image of a point, pixels, with respect to the intrinsic parameters.
pub(super) type ByIntrinsics = SMatrix<f64, 2, INTRINSICS>;

/// Number of intrinsic parameters that a lens file stores; the other coefficients of the radial law are 0, except in the check that the law
/// has enough terms.
pub(super) const KEPT: usize = 8;

/// Parameters of a camera: focal lengths and centre in pixels, then the coefficients of \[KannalaBrandt2006\], two more than in a lens file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Camera(pub SVector<f64, INTRINSICS>);

/// The image of a point with derivatives.
pub(super) struct Projection {
    /// Image of the point in the picture, pixels.
    pub pixel: Vector2<f64>,
    /// Derivatives of `pixel` with respect to the point in the camera's axes.
    pub by_point: Matrix2x3<f64>,
    /// Derivatives of `pixel` with respect to the intrinsic parameters.
    pub by_intrinsics: ByIntrinsics,
}

impl Camera {
    /// Returns an equidistant camera with the focal length `focal` and the principal point `centre`, pixels.
    pub fn equidistant(focal: f64, centre: Vector2<f64>) -> Self {
        Self(SVector::from([focal, focal, centre.x, centre.y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    }

    /// Returns the focal lengths along columns and rows, pixels.
    pub fn focal(&self) -> Vector2<f64> {
        Vector2::new(self.0[0], self.0[1])
    }

    /// Returns the principal point of the camera, pixels.
    pub fn centre(&self) -> Vector2<f64> {
        Vector2::new(self.0[2], self.0[3])
    }

    /// Returns the distance from the principal point of the image of a direction at the angle `theta` from the axis, in focal lengths.
    pub fn radius(&self, theta: f64) -> f64 {
        let t = theta * theta;
        theta * (1.0 + (4..INTRINSICS).rev().fold(0.0, |sum, i| t * (self.0[i] + sum)))
    }

    /// Returns the derivative of [`Camera::radius`] with respect to the angle.
    pub fn slope(&self, theta: f64) -> f64 {
        let t = theta * theta;
        let factor = |i: usize| (2 * i - 5) as f64;
        1.0 + (4..INTRINSICS).rev().fold(0.0, |sum, i| t * (factor(i) * self.0[i] + sum))
    }

    /// Returns the angle from the axis up to which [`Camera::radius`] increases, radians, at most pi.
    pub fn limit(&self) -> f64 {
        let steps = (1..=720).map(|i| f64::from(i) * std::f64::consts::PI / 720.0);
        steps.take_while(|theta| self.slope(*theta) > 1e-3).last().unwrap_or(0.0)
    }

    /// Returns the angle from the axis, radians, whose image has the distance `radius` from the principal point; beyond the largest
    /// distance, the angle of [`Camera::limit`].
    pub fn angle(&self, radius: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.limit());
        for _ in 0..52 {
            let middle = 0.5 * (low + high);
            if self.radius(middle) < radius { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Returns the unit direction that is imaged at `pixel`.
    pub fn direction(&self, pixel: Vector2<f64>) -> Vector3<f64> {
        let n = (pixel - self.centre()).component_div(&self.focal());
        let radius = n.norm();
        let (sin, cos) = self.angle(radius).sin_cos();
        let across = if radius > 0.0 { n * (sin / radius) } else { Vector2::zeros() };
        Vector3::new(across.x, across.y, cos)
    }

    /// Returns the image of `point` in the camera's picture, pixels.
    pub fn pixel(&self, point: &Vector3<f64>) -> Vector2<f64> {
        let across = point.xy();
        let theta = across.norm().atan2(point.z);
        let n = if across.norm() > 0.0 { across * (self.radius(theta) / across.norm()) } else { across };
        self.centre() + n.component_mul(&self.focal())
    }

    /// Returns the image of `point`, pixels, with its derivatives.
    pub fn project(&self, point: &Vector3<f64>) -> Projection {
        let across = point.xy();
        let rho = across.norm().max(1e-12);
        let theta = rho.atan2(point.z);
        let (radius, slope) = (self.radius(theta), self.slope(theta));
        let unit = if across.norm() > 1e-12 { across / rho } else { Vector2::x() };
        let distance2 = rho * rho + point.z * point.z;
        let theta_by_point = Vector3::new(unit.x * point.z, unit.y * point.z, -rho) / distance2;
        let mut by_point = unit * (theta_by_point * slope).transpose();
        let tangent = Vector2::new(-unit.y, unit.x);
        let ratio = if rho > 1e-9 { radius / rho } else { 1.0 / point.z };
        let turned = tangent * tangent.transpose() * ratio;
        by_point.fixed_view_mut::<2, 2>(0, 0).add_assign(&turned);
        by_point.row_mut(0).scale_mut(self.0[0]);
        by_point.row_mut(1).scale_mut(self.0[1]);
        let n = unit * radius;
        Projection {
            pixel: self.centre() + n.component_mul(&self.focal()),
            by_point,
            by_intrinsics: self.by_intrinsics(n, unit, theta),
        }
    }

    fn by_intrinsics(&self, n: Vector2<f64>, unit: Vector2<f64>, theta: f64) -> ByIntrinsics {
        let mut d = ByIntrinsics::zeros();
        d[(0, 0)] = n.x;
        d[(1, 1)] = n.y;
        d[(0, 2)] = 1.0;
        d[(1, 3)] = 1.0;
        for power in 0..6 {
            let by_k = unit.component_mul(&self.focal()) * theta.powi(3 + 2 * power);
            d.set_column(4 + power as usize, &by_k);
        }
        d
    }
}

use std::ops::AddAssign;
