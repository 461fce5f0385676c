//! Lens models: conversion between pixels and directions, and the solid angle of a pixel.
//!
//! Pixel coordinates are (column, row); the centre of a pixel has integer coordinates. A lens is radially symmetric in normalised image
//! coordinates. All computations are in `f64`; they run once per calibration, not per frame.
//!
//! ```
//! use glam::DVec2;
//! use hemilux_core::lens::{Intrinsics, Lens, Model};
//!
//! let lens = Lens::try_new(Intrinsics {
//!     model: Model::KannalaBrandt([-0.012, 0.006, -0.004, 0.0006]),
//!     centre_px: DVec2::new(319.5, 239.5),
//!     focal_px: DVec2::new(196.4, 196.1),
//!     skew_px: 0.0,
//!     max_theta: 80f64.to_radians(),
//!     vignetting: [1.0, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
//! })?;
//! let direction = lens.unproject(DVec2::new(400.0, 100.0)).expect("a pixel inside the image circle");
//! assert!(lens.project(direction).expect("seen").distance(DVec2::new(400.0, 100.0)) < 1e-9);
//! assert_eq!(lens.unproject(DVec2::new(0.0, 0.0)), None);
//! # Ok::<(), hemilux_core::LensError>(())
//! ```

use core::f64::consts::{FRAC_PI_2, PI};
use glam::{DVec2, DVec3};

/// The radial model r(theta) of a lens: r is the distance from the principal point in units of the focal length.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Model {
    /// r = theta, with the angle theta from the axis in radians.
    Equidistant,
    /// r = 2 sin(theta / 2), with the angle theta from the axis in radians.
    Equisolid,
    /// r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), \[KannalaBrandt2006\].
    KannalaBrandt([f64; 4]),
    /// r = x (1 + k0 d + k1 d^2) with x = tan(theta) and d = x^2: \[Nikodym2012\] eq. 4.1.
    Radial([f64; 2]),
}

impl Model {
    /// Returns the name of the model in calibration files.
    ///
    /// ```
    /// use hemilux_core::lens::Model;
    /// assert_eq!(Model::KannalaBrandt([0.0; 4]).name(), "kannala-brandt");
    /// ```
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Equidistant => "equidistant",
            Self::Equisolid => "equisolid",
            Self::KannalaBrandt(_) => "kannala-brandt",
            Self::Radial(_) => "radial",
        }
    }

    /// Returns the coefficients of the model in the order of its formula: none, four (`KannalaBrandt`) or two (`Radial`).
    #[must_use]
    pub const fn coefficients(&self) -> &[f64] {
        match self {
            Self::Equidistant | Self::Equisolid => &[],
            Self::KannalaBrandt(k) => k,
            Self::Radial(k) => k,
        }
    }
}

/// The reason why lens parameters are refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LensError {
    /// A parameter is not finite, or a focal length is not positive.
    BadNumber,
    /// The half-angle of the field of view is not above 0 and at most 180 degrees.
    BadMaxAngle {
        /// Requested half-angle of the field of view, degrees.
        degrees: f64,
    },
    /// r(theta) does not increase up to the edge of the field of view.
    NotMonotone {
        /// Requested half-angle of the field of view, degrees.
        degrees: f64,
        /// Half-angle up to which r(theta) increases, degrees.
        limit_degrees: f64,
    },
    /// The relative illumination is not positive over the whole field of view.
    BadVignetting,
}

impl core::fmt::Display for LensError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::BadNumber => {
                write!(f, "lens parameters that are not finite or a focal length that is not positive")
            }
            Self::BadMaxAngle { degrees } => {
                write!(f, "max_angle_deg {degrees}, expected more than 0 and at most 180")
            }
            Self::NotMonotone { degrees, limit_degrees } => write!(
                f,
                "max_angle_deg {degrees}, expected at most {limit_degrees:.2}, up to where the lens model grows"
            ),
            Self::BadVignetting => {
                write!(f, "a vignetting polynomial that is not positive over the field of view")
            }
        }
    }
}

impl core::error::Error for LensError {}

/// Intrinsic parameters of a lens. [`Lens::try_new`] checks them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// The radial model of the lens.
    pub model: Model,
    /// Principal point of the image, pixels: column, row.
    pub centre_px: DVec2,
    /// Focal lengths along columns and rows, pixels.
    pub focal_px: DVec2,
    /// Skew: columns per unit of the normalised row coordinate.
    pub skew_px: f64,
    /// Half-angle of the field of view: the angle between the lens axis and the edge of the field, radians.
    pub max_theta: f64,
    /// Relative illumination as a polynomial in theta (radians), constant first; `[1.0, 0.0, ..]` for a lens without vignetting.
    pub vignetting: [f64; 8],
}

/// A checked lens: r(theta) increases and the illumination is positive over the whole field of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    p: Intrinsics,
    max_r: f64,
}

/// Number of angles of the field of view at which monotonicity is checked: steps of at most a quarter of a degree.
const MONOTONE_STEPS: u32 = 720;

impl Lens {
    /// Creates a lens after checking the parameters.
    ///
    /// # Errors
    /// [`LensError`] for parameters out of range, and for a field of view beyond the range in which the model increases.
    pub fn try_new(p: Intrinsics) -> Result<Self, LensError> {
        let finite = p.centre_px.is_finite() && p.focal_px.is_finite() && p.skew_px.is_finite();
        let sound = p.model.coefficients().iter().chain(&p.vignetting).all(|v| v.is_finite());
        if !finite || !sound || p.focal_px.min_element() <= 0.0 {
            return Err(LensError::BadNumber);
        }
        if !(p.max_theta > 0.0 && p.max_theta <= PI) {
            return Err(LensError::BadMaxAngle { degrees: p.max_theta.to_degrees() });
        }
        let lens = Self { max_r: radius(&p.model, p.max_theta), p };
        lens.check_over_field()?;
        Ok(lens)
    }

    /// Checks that r(theta) increases and the illumination is positive at [`MONOTONE_STEPS`] angles of the field of view.
    fn check_over_field(&self) -> Result<(), LensError> {
        let step = self.p.max_theta / f64::from(MONOTONE_STEPS);
        let limited = matches!(self.p.model, Model::Radial(_));
        for i in 0..=MONOTONE_STEPS {
            let theta = step * f64::from(i);
            let beyond_pole = limited && theta >= FRAC_PI_2;
            if beyond_pole || slope(&self.p.model, theta).is_nan() || slope(&self.p.model, theta) <= 0.0 {
                let limit_degrees = (theta - step).max(0.0).to_degrees();
                return Err(LensError::NotMonotone { degrees: self.p.max_theta.to_degrees(), limit_degrees });
            }
            if self.illumination(theta) <= 0.0 || self.illumination(theta).is_nan() {
                return Err(LensError::BadVignetting);
            }
        }
        Ok(())
    }

    /// Returns the parameters of the lens.
    #[must_use]
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.p
    }

    /// Creates an equidistant lens, r = theta, with square pixels and without vignetting. `centre_px` is the principal point (column, row),
    /// `focal_px` the focal length in pixels, `max_theta` the half-angle of the field of view in radians.
    ///
    /// # Errors
    /// [`LensError`] for parameters out of range.
    pub fn equidistant(centre_px: [f64; 2], focal_px: f64, max_theta: f64) -> Result<Self, LensError> {
        Self::try_new(Intrinsics {
            model: Model::Equidistant,
            centre_px: DVec2::from_array(centre_px),
            focal_px: DVec2::splat(focal_px),
            skew_px: 0.0,
            max_theta,
            vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        })
    }

    /// Returns the lens in pixels of an image of half the width and height, in which each pixel is the mean of 2 x 2 pixels.
    #[must_use]
    pub fn halved(&self) -> Self {
        let p = self.p;
        let centre_px = (p.centre_px - 0.5) * 0.5;
        let halved = Intrinsics { centre_px, focal_px: p.focal_px * 0.5, skew_px: p.skew_px * 0.5, ..p };
        Self { p: halved, max_r: self.max_r }
    }

    /// Returns the relative illumination at angle `theta` from the axis, radians; 1 without vignetting.
    #[must_use]
    pub fn illumination(&self, theta: f64) -> f64 {
        self.p.vignetting.iter().rev().fold(0.0, |sum, k| sum * theta + k)
    }

    /// Returns the pixel coordinates at which light from the unit vector `direction` is imaged; `None` outside of the field of view.
    ///
    /// # Accuracy
    /// `project(unproject(p))` is within 1e-3 pixels of p (`round_trips_stay_within_a_thousandth_of_a_pixel`).
    #[must_use]
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let across = libm::hypot(direction.x, direction.y);
        let theta = libm::atan2(across, direction.z);
        if !direction.is_finite() || theta > self.p.max_theta {
            return None;
        }
        let r = radius(&self.p.model, theta);
        let n = if across > 0.0 { DVec2::new(direction.x, direction.y) * (r / across) } else { DVec2::ZERO };
        let image = DVec2::new(self.p.focal_px.x * n.x + self.p.skew_px * n.y, self.p.focal_px.y * n.y);
        Some(self.p.centre_px + image)
    }

    /// Returns the unit vector from which light is imaged at `pixel`; `None` outside of the field of view.
    #[must_use]
    pub fn unproject(&self, pixel: DVec2) -> Option<DVec3> {
        let n = self.normalised(pixel);
        let r = n.length();
        let theta = self.theta(r)?;
        let (sin, cos) = libm::sincos(theta);
        let across = if r > 0.0 { n * (sin / r) } else { DVec2::ZERO };
        Some(DVec3::new(across.x, across.y, cos))
    }

    /// Returns the solid angle, steradians, of the pixel centred at `pixel`; `None` outside of the field of view.
    ///
    /// Computed from the Jacobian: dOmega = sin(theta) dtheta dphi and dA = r dr dphi, so dOmega/dA = sin(theta) / (r r'(theta)).
    #[must_use]
    pub fn solid_angle(&self, pixel: DVec2) -> Option<f64> {
        let r = self.normalised(pixel).length();
        let theta = self.theta(r)?;
        let slope = slope(&self.p.model, theta);
        let ratio = if r > 1e-9 { libm::sin(theta) / r } else { 1.0 / slope };
        Some(ratio / slope / (self.p.focal_px.x * self.p.focal_px.y))
    }

    /// Returns the normalised image coordinates of `pixel`: its offset from the principal point in focal lengths.
    fn normalised(&self, pixel: DVec2) -> DVec2 {
        let d = pixel - self.p.centre_px;
        let y = d.y / self.p.focal_px.y;
        DVec2::new((d.x - self.p.skew_px * y) / self.p.focal_px.x, y)
    }

    /// Returns the angle from the axis, radians, whose image lies `r` focal lengths from the principal point; `None` outside of the field of
    /// view. Newton steps within a shrinking bracket invert r(theta).
    fn theta(&self, r: f64) -> Option<f64> {
        if r.is_nan() || r > self.max_r {
            return None;
        }
        let (mut low, mut high) = (0.0, self.p.max_theta);
        let mut theta = (r / self.max_r) * high;
        for _ in 0..60 {
            let off = radius(&self.p.model, theta) - r;
            if off > 0.0 {
                high = theta;
            } else {
                low = theta;
            }
            let newton = theta - off / slope(&self.p.model, theta);
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            if libm::fabs(next - theta) < 1e-15 {
                return Some(next);
            }
            theta = next;
        }
        Some(theta)
    }
}

/// Returns the distance from the principal point, r(theta), of the image of a direction at the angle `theta` from the axis, in focal
/// lengths.
fn radius(model: &Model, theta: f64) -> f64 {
    match *model {
        Model::Equidistant => theta,
        Model::Equisolid => 2.0 * libm::sin(0.5 * theta),
        Model::KannalaBrandt([k1, k2, k3, k4]) => {
            let t = theta * theta;
            theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
        }
        Model::Radial([k0, k1]) => {
            let x = libm::tan(theta);
            let d = x * x;
            x * (1.0 + d * (k0 + d * k1))
        }
    }
}

/// Returns the derivative of [`radius`] with respect to theta.
fn slope(model: &Model, theta: f64) -> f64 {
    match *model {
        Model::Equidistant => 1.0,
        Model::Equisolid => libm::cos(0.5 * theta),
        Model::KannalaBrandt([k1, k2, k3, k4]) => {
            let t = theta * theta;
            1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
        }
        Model::Radial([k0, k1]) => {
            let x = libm::tan(theta);
            let d = x * x;
            (1.0 + d) * (1.0 + d * (3.0 * k0 + d * 5.0 * k1))
        }
    }
}
