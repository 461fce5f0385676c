//! Renderings of chessboards through lenses of known projection laws, for tests of `hemilux calibrate`.

use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// Projection law of a lens: the radius of an image point in focal lengths, as a function of the angle theta from the axis in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// The radius is theta.
    Equidistant,
    /// The radius is 2 sin(theta / 2).
    Equisolid,
    /// The radius is theta (1 + k1 theta^2 + ... + k4 theta^8).
    KannalaBrandt([f64; 4]),
    /// The double sphere of V. Usenko, N. Demmel, D. Cremers, "The Double Sphere Camera Model", 3DV 2018.
    DoubleSphere {
        /// Distance between the centres of the unit spheres.
        xi: f64,
        /// Position of the pinhole between the second sphere's centre and the image plane: parameter alpha of the paper, 0 to 1.
        alpha: f64,
    },
}

impl Law {
    /// Returns the image radius in focal lengths at the angle `theta` from the axis, radians.
    #[must_use]
    pub fn radius(&self, theta: f64) -> f64 {
        match *self {
            Self::Equidistant => theta,
            Self::Equisolid => 2.0 * (0.5 * theta).sin(),
            Self::KannalaBrandt(k) => {
                let t = theta * theta;
                theta * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))))
            }
            Self::DoubleSphere { xi, alpha } => {
                let depth = xi + theta.cos();
                let second = theta.sin().hypot(depth);
                theta.sin() / (alpha * second + (1.0 - alpha) * depth)
            }
        }
    }
}

/// A simulated camera with a lens of known projection law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCamera {
    /// Projection law of the simulated lens.
    pub law: Law,
    /// Focal lengths along the image's columns and rows, pixels.
    pub focal_px: DVec2,
    /// Principal point of the image, pixels.
    pub centre_px: DVec2,
    /// Columns and rows of the image.
    pub size: [usize; 2],
    /// Angle from the axis at the edge of the field of view, radians.
    pub max_theta: f64,
    /// Fraction of the light that vignetting absorbs at the edge of the field of view, 0 to 1.
    pub falloff: f64,
    /// Standard deviation of the Gaussian blur of the image, pixels.
    pub blur_px: f64,
    /// Standard deviation of the Gaussian noise of the image, 8-bit codes.
    pub noise: f64,
}

/// Number of intervals of the table of a camera's inverse projection law.
const STEPS: usize = 4096;

/// A camera with a table of its inverse projection law, from which the directions of image points are interpolated.
#[derive(Clone, Debug)]
pub struct Directions {
    camera: BoardCamera,
    /// Angles from the axis at equal steps of the radius, radians.
    angles: Vec<f64>,
    /// Image radius of the edge of the field of view, focal lengths.
    max_radius: f64,
}

impl Directions {
    /// Tabulates the inverse projection law of `camera`.
    #[must_use]
    pub fn of(camera: &BoardCamera) -> Self {
        let max_radius = camera.law.radius(camera.max_theta);
        let angle = |i: usize| inverse(camera, max_radius * i as f64 / STEPS as f64);
        Self { camera: *camera, angles: (0..=STEPS).map(angle).collect(), max_radius }
    }

    /// Returns the unit direction, in the camera's axes, of an image point in pixels; `None` outside of the image circle.
    #[must_use]
    pub fn at(&self, pixel: DVec2) -> Option<DVec3> {
        let n = (pixel - self.camera.centre_px) / self.camera.focal_px;
        let radius = n.length();
        let step = radius / self.max_radius * STEPS as f64;
        let (low, high) = (self.angles.get(step as usize)?, self.angles.get(step as usize + 1)?);
        let (sin, cos) = (low + (high - low) * step.fract()).sin_cos();
        let across = if radius > 0.0 { n * (sin / radius) } else { DVec2::ZERO };
        Some(DVec3::new(across.x, across.y, cos))
    }
}

/// Returns the angle from the axis, radians, whose image radius is `radius` focal lengths, by bisection.
fn inverse(camera: &BoardCamera, radius: f64) -> f64 {
    let (mut low, mut high) = (0.0, camera.max_theta);
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if camera.law.radius(middle) < radius { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Pose of a chessboard in the axes of the camera; the unit of length is the side of a square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Unit vectors along the board's columns, along its rows and along its normal, in the camera's axes.
    pub axes: DMat3,
    /// Centre of the board in the camera's axes, sides of a square.
    pub middle: DVec3,
}

/// Returns `count` poses of rotated and tilted boards, whose centres are spread over the field of view up to 92 % of its angle; `squares` is
/// the board's columns and rows.
#[must_use]
pub fn poses(camera: &BoardCamera, squares: [u32; 2], count: usize, seed: u64) -> Vec<Pose> {
    let mut random = Pcg64::seed_from_u64(seed);
    let pose = |i: usize| {
        // The golden angle spreads the azimuths evenly, the square root the areas.
        let theta = (0.92 * camera.max_theta) * ((i as f64 + 0.5) / count as f64).sqrt();
        let phi = 2.399_963 * i as f64;
        let out = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let distance = random.random_range(0.5..0.9) * f64::from(squares[0]);
        let tilt = random.random_range(0.15..0.6);
        let facing = DMat3::from_axis_angle(out.any_orthonormal_vector(), tilt);
        let facing = DMat3::from_axis_angle(out, random.random_range(0.0..TAU)) * facing;
        let normal = facing * out;
        let columns = normal.any_orthonormal_vector();
        let spin = DMat3::from_axis_angle(normal, random.random_range(0.0..TAU));
        let columns = spin * columns;
        Pose { axes: DMat3::from_cols(columns, normal.cross(columns), normal), middle: out * distance }
    };
    (0..count).map(pose).collect()
}

/// 8-bit code of the printed board's paper.
const WHITE: f64 = 210.0;
/// 8-bit code of the printed board's ink.
const BLACK: f64 = 25.0;

/// Renders the board of `squares` columns and rows, with a white margin of one square, before a background; returns 8-bit codes row by row.
#[must_use]
pub fn picture(directions: &Directions, squares: [u32; 2], pose: &Pose, seed: u64) -> Vec<u8> {
    let camera = &directions.camera;
    let [width, height] = camera.size;
    let light =
        |i: usize| pixel(directions, squares, pose, DVec2::new((i % width) as f64, (i / width) as f64));
    let sharp: Vec<f64> = (0..width * height).map(light).collect();
    let blurred = blurred(&sharp, width, camera.blur_px);
    let mut random = Pcg64::seed_from_u64(seed);
    let noisy = |v: &f64| {
        let noise: f64 = StandardNormal.sample(&mut random);
        (v + noise * camera.noise).round().clamp(0.0, 255.0) as u8
    };
    blurred.iter().map(noisy).collect()
}

/// Number of samples of an image pixel along each axis.
const SAMPLES: usize = 3;

/// Returns the mean code of [`SAMPLES`] x [`SAMPLES`] points of the pixel with the centre `at`, with vignetting.
fn pixel(directions: &Directions, squares: [u32; 2], pose: &Pose, at: DVec2) -> f64 {
    let offset = |i: usize| (i as f64 + 0.5) / SAMPLES as f64 - 0.5;
    let samples = (0..SAMPLES * SAMPLES).map(|i| at + DVec2::new(offset(i % SAMPLES), offset(i / SAMPLES)));
    let light = samples.filter_map(|at| directions.at(at)).map(|direction| {
        let theta = direction.z.clamp(-1.0, 1.0).acos() / directions.camera.max_theta;
        (1.0 - directions.camera.falloff * theta * theta) * seen(squares, pose, direction)
    });
    light.sum::<f64>() / (SAMPLES * SAMPLES) as f64
}

/// Returns the code of the board, or of the background beside the board, in a direction.
fn seen(squares: [u32; 2], pose: &Pose, direction: DVec3) -> f64 {
    let along = direction.dot(pose.axes.z_axis);
    let distance = pose.middle.dot(pose.axes.z_axis) / along;
    let point = direction * distance - pose.middle;
    let place = DVec2::new(point.dot(pose.axes.x_axis), point.dot(pose.axes.y_axis));
    let place = place + DVec2::new(f64::from(squares[0]), f64::from(squares[1])) * 0.5;
    let inside = |margin: f64| {
        let within = |v: f64, n: u32| v >= -margin && v < f64::from(n) + margin;
        within(place.x, squares[0]) && within(place.y, squares[1])
    };
    if !(along.abs() > 1e-9 && distance > 0.0 && inside(1.0)) {
        return room(direction);
    }
    let black = inside(0.0) && (place.x.floor() + place.y.floor()).rem_euclid(2.0) < 0.5;
    if black { BLACK } else { WHITE }
}

/// Returns the code of the background in a direction: a smooth pattern of sines.
fn room(d: DVec3) -> f64 {
    100.0
        + 35.0 * (7.0 * d.x + 2.0 * d.z).sin() * (5.0 * d.y - 3.0 * d.x).cos()
        + 20.0 * (PI * 3.0 * d.z).sin()
}

/// Returns the codes after a Gaussian blur of standard deviation `sigma`, pixels; the border pixels are repeated.
fn blurred(codes: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as isize;
    let weight = |d: isize| if sigma > 0.0 { (-0.5 * (d as f64 / sigma).powi(2)).exp() } else { 1.0 };
    let total: f64 = (-reach..=reach).map(weight).sum();
    let height = codes.len() / width;
    let row = |i: usize| {
        let at = |d: isize| (i % width).saturating_add_signed(d).min(width - 1) + i / width * width;
        (-reach..=reach).map(|d| weight(d) * codes[at(d)]).sum::<f64>() / total
    };
    let rows: Vec<f64> = (0..codes.len()).map(row).collect();
    let column = |i: usize| {
        let at = |d: isize| (i / width).saturating_add_signed(d).min(height - 1) * width + i % width;
        (-reach..=reach).map(|d| weight(d) * rows[at(d)]).sum::<f64>() / total
    };
    (0..codes.len()).map(column).collect()
}
