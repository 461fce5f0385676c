//! Camera models of other programs, as projections of directions to normalised image coordinates.

use glam::{DVec2, DVec3};

/// A camera as another program describes it; the centres of pixels have integer coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ForeignCamera {
    pub model: Model,
    pub size: [u32; 2],
    pub focal: [f64; 2],
    pub centre: [f64; 2],
    pub skew: f64,
}

/// Radial and tangential distortion of OpenCV: k1, k2, p1, p2, k3 and the denominator's k4, k5, k6.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Distortion {
    pub radial: [f64; 3],
    pub tangential: [f64; 2],
    pub denominator: [f64; 3],
}

impl Distortion {
    /// Creates the distortion from k1, k2, p1, p2, then optionally k3, then optionally k4, k5, k6; `None` for other lengths.
    pub fn from_opencv(k: &[f64]) -> Option<Self> {
        let at = |i: usize| k.get(i).copied().unwrap_or(0.0);
        // Terms of sensor tilt and thin prisms may follow, which are not supported.
        let known =
            matches!(k.len(), 0 | 4 | 5 | 8) || k.get(8..).is_some_and(|rest| rest.iter().all(|v| *v == 0.0));
        known.then(|| Self {
            radial: [at(0), at(1), at(4)],
            tangential: [at(2), at(3)],
            denominator: [at(5), at(6), at(7)],
        })
    }

    /// Returns true if the distortion is r = x (1 + k1 x^2 + k2 x^4).
    pub fn is_two_radial(&self) -> bool {
        self.radial[2] == 0.0 && self.tangential == [0.0; 2] && self.denominator == [0.0; 3]
    }

    fn apply(&self, n: DVec2) -> DVec2 {
        let d = n.length_squared();
        let series = |k: [f64; 3]| 1.0 + d * (k[0] + d * (k[1] + d * k[2]));
        let [p1, p2] = self.tangential;
        let shift = DVec2::new(
            2.0 * p1 * n.x * n.y + p2 * (d + 2.0 * n.x * n.x),
            p1 * (d + 2.0 * n.y * n.y) + 2.0 * p2 * n.x * n.y,
        );
        n * (series(self.radial) / series(self.denominator)) + shift
    }
}

/// Projection of a camera, with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Model {
    /// Pinhole with the distortion of OpenCV.
    Pinhole(Distortion),
    /// Kannala-Brandt: OpenCV's fisheye, Kalibr's and ROS's `equidistant`.
    KannalaBrandt([f64; 4]),
    /// The field-of-view model; the parameter is its angle, radians.
    FieldOfView(f64),
    /// The unified model of Mei: the parameter xi and the distortion.
    Omni(f64, Distortion),
    /// The extended unified model: the parameters alpha and beta.
    Eucm(f64, f64),
    /// The double-sphere model: the parameters xi and alpha.
    DoubleSphere(f64, f64),
    /// OCamCalib: the coefficients, constant first, of the depth as a polynomial of the radius in pixels; coordinates are divided by the
    /// negated constant.
    Ocam(Vec<f64>),
}

impl Model {
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pinhole(_) => "a pinhole model with distortion",
            Self::KannalaBrandt(_) => "kannala-brandt",
            Self::FieldOfView(_) => "the field-of-view model",
            Self::Omni(..) => "the omni model",
            Self::Eucm(..) => "the eucm model",
            Self::DoubleSphere(..) => "the double-sphere model",
            Self::Ocam(_) => "the OCamCalib model",
        }
    }

    /// Returns the normalised image coordinates of a unit direction, z along the axis; `None` where the model is not defined.
    pub fn project(&self, d: DVec3) -> Option<DVec2> {
        let across = DVec2::new(d.x, d.y);
        let over = |depth: f64| (depth > 1e-9).then(|| across / depth);
        let n = match self {
            Self::Pinhole(distortion) => distortion.apply(over(d.z)?),
            Self::KannalaBrandt(k) => {
                let theta = across.length().atan2(d.z);
                let t = theta * theta;
                let r = theta * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))));
                radial(across, r)
            }
            Self::FieldOfView(w) => {
                let undistorted = over(d.z)?.length();
                radial(across, (2.0 * undistorted * (w / 2.0).tan()).atan() / w)
            }
            Self::Omni(xi, distortion) => distortion.apply(over(d.z + xi)?),
            Self::Eucm(alpha, beta) => {
                let distance = (beta * across.length_squared() + d.z * d.z).sqrt();
                over(alpha * distance + (1.0 - alpha) * d.z)?
            }
            Self::DoubleSphere(xi, alpha) => {
                let z = xi + d.z;
                over(alpha * across.length().hypot(z) + (1.0 - alpha) * z)?
            }
            Self::Ocam(polynomial) => radial(across, ocam_radius(polynomial, across.length().atan2(d.z))?),
        };
        n.is_finite().then_some(n)
    }
}

fn radial(across: DVec2, radius: f64) -> DVec2 {
    let length = across.length();
    if length > 0.0 { across * (radius / length) } else { DVec2::ZERO }
}

/// Returns the first radius, in units of the negated constant, whose ray (r, -polynomial(r)) is `theta` radians off axis.
fn ocam_radius(polynomial: &[f64], theta: f64) -> Option<f64> {
    let focal = -polynomial.first()?;
    let depth = |r: f64| -polynomial.iter().rev().fold(0.0, |sum, k| sum * r + k);
    let off = |r: f64| r.atan2(depth(r)) - theta;
    // The angle increases with the radius: the radius is increased in steps until the angle is exceeded, then bisected.
    let mut high = 0.0;
    let mut steps = 0;
    while off(high) < 0.0 {
        high += focal / 64.0;
        steps += 1;
        if steps > 64 * 16 {
            return None;
        }
    }
    let mut low = (high - focal / 64.0).max(0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if off(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high) / focal)
}

impl ForeignCamera {
    /// Returns the pixel at which the camera images a direction; `None` where the model is not defined.
    pub fn pixel(&self, d: DVec3) -> Option<DVec2> {
        let n = self.model.project(d)?;
        let [fx, fy] = self.focal;
        Some(DVec2::new(fx * n.x + self.skew * n.y, fy * n.y) + DVec2::from_array(self.centre))
    }
}
