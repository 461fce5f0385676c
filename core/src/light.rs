//! Directional lights, and the result of a sampler.

use crate::pyramid::Quad;
use glam::Vec3;

/// Coefficients of the nine real spherical harmonics of degree 0 to 2, one RGB triple each, in the order of `board/FORMATS.md`.
pub type Sh9 = [[f32; 3]; 9];

/// A directional light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light {
    /// Number of the light, never 0; it stays the same from frame to frame for as long as the light exists.
    pub id: u32,
    /// Unit vector from the probe towards the light.
    pub direction: Vec3,
    /// Perpendicular irradiance, linear RGB: the sum of radiance times solid angle over the region that the light represents.
    pub irradiance: [f32; 3],
    /// Angular radius, degrees, of the uniform spherical cap that has the angular variance of the region that the light represents.
    pub radius_deg: f32,
    /// Number of frames since the frame in which the light appeared.
    pub age: u32,
    /// Id of the light from which this light was split off; `None` for a light of the first frame.
    pub parent: Option<u32>,
}

/// Returns the angular radius a in degrees of the uniform cap whose angular variance (1 - cos a) / 2 is `variance`.
#[must_use]
pub fn cap_radius_deg(variance: f32) -> f32 {
    2.0 * libm::asinf(libm::sqrtf(variance.clamp(0.0, 1.0))).to_degrees()
}

/// Least squared length of a mean direction that is not a rounding error: sums of opposite directions in `f32` cancel to about 1e-7.
const LEAST_MEAN2: f32 = 1e-12;

impl Light {
    /// Creates a light at the energy centroid of `quad`; `fallback` computes the direction if the first moment vanishes.
    #[must_use]
    pub fn at_centroid(id: u32, quad: &Quad, fallback: impl FnOnce() -> Vec3) -> Self {
        let mean = Some(quad.mean_direction()).filter(|m| m.length_squared() > LEAST_MEAN2);
        Self {
            id,
            direction: mean.and_then(Vec3::try_normalize).unwrap_or_else(fallback),
            irradiance: quad.rgb(),
            radius_deg: cap_radius_deg(quad.variance()),
            age: 0,
            parent: None,
        }
    }
}

/// The result of a sampler for one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Decomposition<'a> {
    /// The lights of the frame, at most as many as were requested.
    pub lights: &'a [Light],
    /// Radiance that the directional lights do not represent, as spherical harmonics; `None` where it was not requested.
    pub ambient: Option<Sh9>,
    /// Estimate of the shadowed error of the lights, a ratio; `None` for samplers without an estimate.
    pub estimated_error: Option<f32>,
}

impl<'a> Decomposition<'a> {
    /// Creates a result of lights alone, without ambient light or an estimate.
    #[must_use]
    pub fn of_lights(lights: &'a [Light]) -> Self {
        Self { lights, ambient: None, estimated_error: None }
    }
}

/// Formats id, direction, irradiance and radius of a light.
#[cfg(feature = "defmt")]
impl defmt::Format for Light {
    fn format(&self, f: defmt::Formatter<'_>) {
        let (d, e) = (self.direction, self.irradiance);
        defmt::write!(f, "light {} to {} of {}, {} degrees", self.id, [d.x, d.y, d.z], e, self.radius_deg);
    }
}
