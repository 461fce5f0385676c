//! Rendered scene: the ground z = 0, a glossy sphere, a box and a torus in probe axes, z up; lengths have no unit.

use crate::metrics::vector::{add_scaled, dot, norm, unit};

/// Distance of a shadow ray's origin from its surface, so that the ray does not hit its own surface.
const OFFSET: f64 = 1e-4;
/// Number of steps of sphere tracing after which the torus counts as missed; forty steps suffice for grazing rays.
const STEPS: usize = 64;

/// A ray: origin and direction.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Origin of the ray.
    pub origin: [f64; 3],
    /// Direction of the ray, a unit vector.
    pub direction: [f64; 3],
}

/// Reflectance of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse albedo (red, green, blue), 0 to 1.
    pub albedo: [f64; 3],
    /// Weight and exponent of a Phong lobe; `None` for a diffuse surface.
    pub gloss: Option<(f64, f64)>,
}

/// Intersection of a ray and a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Point of intersection.
    pub point: [f64; 3],
    /// Unit normal of the surface, outwards.
    pub normal: [f64; 3],
    /// Reflectance of the surface.
    pub material: Material,
    /// Whether the surface is the ground.
    pub ground: bool,
}

/// The ground, with or without the solids: sphere, box and torus.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// Whether the scene contains its solids: sphere, box and torus.
    pub solids: bool,
}

/// Reflectance of the ground of the scene.
const GROUND: Material = Material { albedo: [0.5, 0.5, 0.5], gloss: None };
/// Radius of the drawn ground around the centre of the scene.
const GROUND_RADIUS: f64 = 9.0;
/// Centre and radius of the sphere of the scene.
const SPHERE: ([f64; 3], f64) = ([-1.75, 0.1, 1.0], 1.0);
const SPHERE_MATERIAL: Material = Material { albedo: [0.10, 0.10, 0.12], gloss: Some((0.45, 90.0)) };
/// Least and greatest coordinates of the box.
const BOX: [[f64; 3]; 2] = [[-0.35, 0.5, 0.0], [0.75, 1.6, 1.7]];
/// Radius of a sphere that contains the box, whose half diagonal is 1.153.
const BOX_RADIUS: f64 = 1.16;
const BOX_MATERIAL: Material = Material { albedo: [0.62, 0.36, 0.24], gloss: None };
/// Centre, axis, major and minor radius of the torus.
const TORUS: ([f64; 3], [f64; 3], f64, f64) = ([1.85, -0.35, 0.92], [0.48, -0.6, 0.64], 0.72, 0.27);
const TORUS_MATERIAL: Material = Material { albedo: [0.28, 0.48, 0.40], gloss: None };

impl Scene {
    /// The scene of ground, sphere, box and torus.
    pub const STANDARD: Self = Self { solids: true };
    /// The scene of the ground alone.
    pub const EMPTY: Self = Self { solids: false };

    /// Returns the nearest intersection of `ray` with a surface of the scene; `None` if the ray hits no surface.
    #[must_use]
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        let solids = if self.solids { [sphere(ray), cuboid(ray), torus(ray)] } else { [None; 3] };
        let materials = [SPHERE_MATERIAL, BOX_MATERIAL, TORUS_MATERIAL];
        let solid = solids.into_iter().zip(materials).filter_map(|(hit, m)| Some((hit?, m, false)));
        let all = solid.chain(ground(ray).map(|hit| (hit, GROUND, true)));
        let ((distance, normal), material, ground) = all.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        Some(Hit { point: along(ray, distance), normal, material, ground })
    }

    /// Returns whether light from the direction of the unit vector `d` reaches a point of a surface; the ground occludes directions below the
    /// horizon.
    #[must_use]
    pub fn sees(&self, hit: &Hit, d: [f64; 3]) -> bool {
        if d[2] <= 0.0 {
            return false;
        }
        let mut origin = hit.point;
        add_scaled(&mut origin, hit.normal, OFFSET);
        let ray = Ray { origin, direction: d };
        !self.solids || (sphere(&ray).is_none() && cuboid(&ray).is_none() && torus(&ray).is_none())
    }
}

type Found = Option<(f64, [f64; 3])>;

fn along(ray: &Ray, distance: f64) -> [f64; 3] {
    let mut point = ray.origin;
    add_scaled(&mut point, ray.direction, distance);
    point
}

fn ground(ray: &Ray) -> Found {
    let distance = -ray.origin[2] / ray.direction[2];
    let [x, y, _] = along(ray, distance);
    (distance > 0.0 && x.hypot(y) < GROUND_RADIUS).then_some((distance, [0.0, 0.0, 1.0]))
}

/// Returns the distances along `ray` at which the ray enters and leaves a sphere.
fn ball(ray: &Ray, centre: [f64; 3], radius: f64) -> Option<[f64; 2]> {
    let off: [f64; 3] = std::array::from_fn(|i| ray.origin[i] - centre[i]);
    let along = dot(off, ray.direction);
    let inside = along * along - dot(off, off) + radius * radius;
    (inside > 0.0).then(|| [-along - inside.sqrt(), -along + inside.sqrt()])
}

fn sphere(ray: &Ray) -> Found {
    let (centre, radius) = SPHERE;
    let [near, _] = ball(ray, centre, radius)?;
    let point = along(ray, near);
    (near > 0.0).then(|| (near, std::array::from_fn(|i| (point[i] - centre[i]) / radius)))
}

/// Intersects `ray` with the box by its slabs, after a test with the bounding sphere of the box, which most shadow rays miss.
fn cuboid(ray: &Ray) -> Found {
    let middle = std::array::from_fn(|i| (BOX[0][i] + BOX[1][i]) / 2.0);
    let [_, leave] = ball(ray, middle, BOX_RADIUS)?;
    if leave < 0.0 {
        return None;
    }
    let (mut near, mut far, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for (i, (low, high)) in BOX[0].into_iter().zip(BOX[1]).enumerate() {
        let bounds = [low, high].map(|side| (side - ray.origin[i]) / ray.direction[i]);
        let (enter, leave) = (bounds[0].min(bounds[1]), bounds[0].max(bounds[1]));
        if enter > near {
            (near, axis) = (enter, i);
        }
        far = far.min(leave);
    }
    let mut normal = [0.0; 3];
    normal[axis] = -ray.direction[axis].signum();
    (near < far && near > 0.0).then_some((near, normal))
}

/// Returns the distance of a point from the surface of the torus, negative inside.
fn torus_distance(point: [f64; 3]) -> f64 {
    let (centre, axis, large, small) = TORUS;
    let off: [f64; 3] = std::array::from_fn(|i| point[i] - centre[i]);
    let height = dot(off, axis);
    let mut flat = off;
    add_scaled(&mut flat, axis, -height);
    (norm(flat) - large).hypot(height) - small
}

/// Intersects `ray` with the torus by sphere tracing inside of the torus's bounding sphere.
fn torus(ray: &Ray) -> Found {
    let (centre, _, large, small) = TORUS;
    let [enter, leave] = ball(ray, centre, large + small)?;
    if leave < 0.0 {
        return None;
    }
    let mut distance = enter.max(0.0);
    for _ in 0..STEPS {
        if distance > leave {
            return None;
        }
        let point = along(ray, distance);
        let gap = torus_distance(point);
        if gap < 0.3 * OFFSET {
            return Some((distance, torus_normal(point)));
        }
        distance += gap;
    }
    None
}

/// Returns the unit normal of the torus: the gradient of the distance, by central differences.
fn torus_normal(point: [f64; 3]) -> [f64; 3] {
    let slope = |axis: usize| {
        let shifted = |by: f64| {
            let mut p = point;
            p[axis] += by;
            torus_distance(p)
        };
        shifted(1e-5) - shifted(-1e-5)
    };
    unit([slope(0), slope(1), slope(2)]).unwrap_or([0.0, 0.0, 1.0])
}

/// A pinhole camera above the scene, directed downwards.
#[derive(Clone, Copy, Debug)]
pub struct PinholeCamera {
    /// Columns and rows of the rendered picture.
    pub size: [usize; 2],
    forward: [f64; 3],
    up: [f64; 3],
}

/// Position of the camera in the scene.
const EYE: [f64; 3] = [0.1, -6.6, 3.1];
/// Point at which the camera is directed.
const TARGET: [f64; 3] = [0.05, 0.0, 0.75];
/// Half the height of the picture at distance 1 from the camera, for a vertical field of view of 37 degrees.
const HALF_HEIGHT: f64 = 0.335;

impl PinholeCamera {
    /// Creates the camera for a picture of `size` pixels, columns and rows.
    #[must_use]
    pub fn new(size: [usize; 2]) -> Self {
        let forward = unit(std::array::from_fn(|i| TARGET[i] - EYE[i])).unwrap_or([0.0, 1.0, 0.0]);
        let mut up = [0.0, 0.0, 1.0];
        add_scaled(&mut up, forward, -forward[2]);
        Self { size, forward, up: unit(up).unwrap_or([0.0, 0.0, 1.0]) }
    }

    /// Returns the ray from the camera through the centre of a pixel.
    #[must_use]
    pub fn ray(&self, column: usize, row: usize) -> Ray {
        let (f, u) = (self.forward, self.up);
        let right = [f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2], f[0] * u[1] - f[1] * u[0]];
        let [width, height] = self.size.map(|n| n as f64);
        let x = ((column as f64 + 0.5) - width / 2.0) / (height / 2.0) * HALF_HEIGHT;
        let y = (height / 2.0 - (row as f64 + 0.5)) / (height / 2.0) * HALF_HEIGHT;
        let mut direction = f;
        add_scaled(&mut direction, right, x);
        add_scaled(&mut direction, u, y);
        Ray { origin: EYE, direction: unit(direction).unwrap_or(f) }
    }
}
