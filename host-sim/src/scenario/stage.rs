//! Components of scenarios: backgrounds, discs of exact energy, drifting clouds.

use super::Setting;
use crate::env::EnvMap;
use crate::maps;
use crate::metrics::stability::LightSource;
use crate::metrics::vector::{angle_deg, dot, unit};
use crate::metrics::{Domain, TexelGrid, luminance};
use std::f64::consts::{PI, TAU};

/// Number of samples along each side of a texel at a disc's rim. The samples determine the shape of the rim; the energy of the disc is normalised.
const SUBSAMPLES: usize = 6;

/// Setting of a sequence with the background maps that belong to it.
#[derive(Debug)]
pub struct Stage {
    /// Size, length, seed and background of the sequence.
    pub setting: Setting,
    /// Map of the procedural interior, or the background of the setting.
    pub room: EnvMap,
    /// Map of the procedural sky without sun, or the background of the setting.
    pub sky: EnvMap,
}

/// Linear RGB of a lamp, normalised to luminance 1 with four digits.
pub const WARM: [f64; 3] = [1.379, 0.945, 0.428];
/// Linear RGB of daylight, normalised to luminance 1 with four digits.
pub const DAYLIGHT: [f64; 3] = [1.05, 0.99, 0.952];

impl Stage {
    /// Computes the backgrounds for a setting.
    #[must_use]
    pub fn new(setting: &Setting) -> Self {
        let size = (setting.width, setting.width.div_ceil(2));
        let painted = |paint: fn([f64; 3]) -> [f32; 3]| match &setting.background {
            Some(map) if (map.width(), map.height()) == size => map.clone(),
            Some(map) => maps::resized(map, setting.width),
            None => EnvMap::from_fn(size.0, size.1, paint),
        };
        Self { setting: setting.clone(), room: painted(room), sky: painted(sky) }
    }

    /// Returns the number of frames of the sequence.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.setting.frames
    }

    /// Returns the position of frame `t` in the sequence, from 0 for the first to 1 for the last frame.
    #[must_use]
    pub fn progress(&self, t: usize) -> f64 {
        t as f64 / (self.frames() - 1).max(1) as f64
    }

    /// Returns the maps `frame(t)` of all frames t.
    pub fn sequence(&self, frame: impl FnMut(usize) -> EnvMap) -> Vec<EnvMap> {
        (0..self.frames()).map(frame).collect()
    }
}

/// Returns the luminous energy of a map, the sum of Y dOmega over the sphere.
#[must_use]
pub fn energy(map: &EnvMap) -> f64 {
    TexelGrid::new(map, Domain::Sphere).luminous(map).map(|(_, flux)| flux).sum()
}

/// Returns `map` with a uniform disc of `flux` (sum of Y dOmega) and `colour` added at `source`: the map gains exactly this energy, and no
/// texel outside of the disc changes.
#[must_use]
pub fn with_disc(map: &EnvMap, source: LightSource, colour: [f64; 3], flux: f64) -> EnvMap {
    let cover = coverage(map, source);
    let covered: f64 = cover.iter().map(|c| c.part * map.solid_angle(c.texel / map.width())).sum();
    let mut texels = map.texels().to_vec();
    let flux = flux / luminance(colour);
    for Covered { texel, part } in cover {
        let y = flux * part / covered;
        texels[texel].iter_mut().zip(colour).for_each(|(v, c)| *v += (c * y) as f32);
    }
    EnvMap::new(map.width(), map.height(), texels)
}

/// A texel of the map that a disc overlaps.
struct Covered {
    /// Row-major index of the texel in the map.
    texel: usize,
    /// Fraction of the texel's area inside of the disc, 0 to 1.
    part: f64,
}

/// Returns the texels that overlap the disc of `source`; for a disc without any sample inside, the texel that contains the centre.
fn coverage(map: &EnvMap, source: LightSource) -> Vec<Covered> {
    let (width, height) = (map.width(), map.height());
    let reach = source.radius_deg + 180.0 * std::f64::consts::SQRT_2 / height as f64;
    let mut cover = Vec::new();
    let mut nearest = (f64::INFINITY, 0);
    for k in 0..width * height {
        let off = angle_deg(map.direction(k / width, k % width), source.direction);
        if off < nearest.0 {
            nearest = (off, k);
        }
        if off <= reach {
            let part = covered_part(map, k, source);
            if part > 0.0 {
                cover.push(Covered { texel: k, part });
            }
        }
    }
    if cover.is_empty() { vec![Covered { texel: nearest.1, part: 1.0 }] } else { cover }
}

/// Returns the fraction of texel `k` inside of the disc of `source`, by [`SUBSAMPLES`] x [`SUBSAMPLES`] samples.
fn covered_part(map: &EnvMap, k: usize, source: LightSource) -> f64 {
    let (width, height) = (map.width(), map.height());
    let n = SUBSAMPLES;
    let at = |i: usize| (i as f64 + 0.5) / n as f64;
    let inside = (0..n * n).filter(|&s| {
        let theta = ((k / width) as f64 + at(s / n)) * PI / height as f64;
        let phi = PI - ((k % width) as f64 + at(s % n)) * TAU / width as f64;
        let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        source.distance_deg(d) == 0.0
    });
    inside.count() as f64 / (n * n) as f64
}

/// Returns `map` with every texel inside of a window set to `paint(u, v, old)`, where u and v are the positions in the window from -1 to 1,
/// right and up, and `old` is the radiance of the texel. The window has the half-sides `half_deg` around `middle`.
#[must_use]
pub fn with_window(
    map: &EnvMap,
    middle: [f64; 3],
    half_deg: [f64; 2],
    paint: impl Fn(f64, f64, [f32; 3]) -> [f32; 3],
) -> EnvMap {
    let right = unit([-middle[1], middle[0], 0.0]).unwrap_or([1.0, 0.0, 0.0]);
    let up = cross(middle, right);
    let half = half_deg.map(|deg| deg.to_radians().tan());
    let mut texels = map.texels().to_vec();
    for (k, texel) in texels.iter_mut().enumerate() {
        let d = map.direction(k / map.width(), k % map.width());
        let depth = dot(d, middle);
        let (u, v) = (dot(d, right) / depth / half[0], dot(d, up) / depth / half[1]);
        if depth > 0.0 && u.abs() <= 1.0 && v.abs() <= 1.0 {
            *texel = paint(u, v, *texel);
        }
    }
    EnvMap::new(map.width(), map.height(), texels)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the unit vector with the angle theta from the zenith and the azimuth phi, degrees.
#[must_use]
pub fn at(theta_deg: f64, phi_deg: f64) -> [f64; 3] {
    let (theta, phi) = (theta_deg.to_radians(), phi_deg.to_radians());
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

/// Returns the radiance of an interior in the direction `d`: grey floor, white ceiling, coloured walls, a window, and a small lamp on the ceiling.
#[must_use]
pub fn room(d: [f64; 3]) -> [f32; 3] {
    let ramp = (0.5 + 0.5 * d[2]).powi(2);
    let wall = [0.30 + 0.10 * d[0], 0.28 + 0.04 * d[1], 0.24 - 0.08 * d[0]];
    let base = wall.map(|v| v * (0.35 + 0.9 * ramp));
    let window = d[1] < -0.72 && d[2] > 0.02 && d[2] < 0.55 && d[0].abs() < 0.42;
    let pane = if window { DAYLIGHT.map(|c| 6.0 * c) } else { [0.0; 3] };
    let lamp = if angle_deg(d, at(28.0, 40.0)) < 5.0 { WARM.map(|c| 60.0 * c) } else { [0.0; 3] };
    std::array::from_fn(|i| (base[i] + pane[i] + lamp[i]) as f32)
}

/// Returns the radiance of a clear sky without sun, over a brown ground, in the direction `d`.
#[must_use]
pub fn sky(d: [f64; 3]) -> [f32; 3] {
    if d[2] < 0.0 {
        return [0.22, 0.20, 0.16].map(|v: f64| (v * (1.0 + 0.3 * d[2])) as f32);
    }
    let haze = (1.0 - d[2]).powi(3);
    [0.35 + 0.75 * haze, 0.55 + 0.55 * haze, 1.0 + 0.1 * haze].map(|v| v as f32)
}

/// Returns the cloud cover, 0 to 1, in the direction `d`, shifted by `drift` radians: a sum of sines of incommensurable lengths with a soft
/// threshold.
#[must_use]
pub fn cloud(d: [f64; 3], drift: f64) -> f64 {
    if d[2] <= 0.02 {
        return 0.0;
    }
    // The clouds are a flat layer, so that clouds near the horizon are far away and small.
    let (x, y) = (d[0] / (d[2] + 0.25) + drift, d[1] / (d[2] + 0.25));
    let waves = [(2.1, 0.7, 0.0), (-1.3, 2.6, 1.0), (4.7, -2.2, 2.0), (3.1, 5.3, 4.0), (8.3, 1.9, 5.0)];
    let sum: f64 = waves.iter().map(|(a, b, c)| (a * x + b * y + c).sin() / f64::hypot(*a, *b)).sum();
    (0.5 + 1.6 * sum).clamp(0.0, 1.0)
}

/// Returns the map with every texel replaced by `paint(direction, old)`, where `old` is the radiance of the texel.
#[must_use]
pub fn repainted(map: &EnvMap, paint: impl Fn([f64; 3], [f32; 3]) -> [f32; 3]) -> EnvMap {
    let texels = map.texels().iter().enumerate();
    let painted = texels.map(|(k, &rgb)| paint(map.direction(k / map.width(), k % map.width()), rgb));
    EnvMap::new(map.width(), map.height(), painted.collect())
}
