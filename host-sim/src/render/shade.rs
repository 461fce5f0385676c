//! Direct illumination by directional lights: a Lambert term and a normalised Phong lobe.

use super::scene::{Hit, Scene};
use crate::metrics::vector::{add_scaled, dot};
use std::f64::consts::{PI, TAU};

/// A directional light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directional {
    /// Unit vector from the surface towards the light.
    pub direction: [f64; 3],
    /// Perpendicular irradiance of the light, RGB; negative for negative lobes of ambient harmonics.
    pub irradiance: [f64; 3],
}

/// Returns the radiance (red, green, blue) that leaves the point `hit` against the direction `ray`, a unit vector.
///
/// L = sum E (n . l) V (rho / pi + k (s + 2) / (2 pi) (r . l)^s) over the lights with the irradiance E and the direction l; n is the normal, V the
/// visibility, rho the albedo, k and s weight and exponent of the gloss, and r the mirrored ray.
#[must_use]
pub fn radiance(scene: &Scene, hit: &Hit, ray: [f64; 3], lights: &[Directional]) -> [f64; 3] {
    let mut mirrored = ray;
    add_scaled(&mut mirrored, hit.normal, -2.0 * dot(ray, hit.normal));
    let (mut diffuse, mut gloss) = ([0.0; 3], [0.0; 3]);
    for light in lights {
        let cosine = dot(hit.normal, light.direction);
        if cosine <= 0.0 || !scene.sees(hit, light.direction) {
            continue;
        }
        add_scaled(&mut diffuse, light.irradiance, cosine);
        if let Some((share, exponent)) = hit.material.gloss {
            let lobe = dot(mirrored, light.direction).max(0.0).powf(exponent);
            add_scaled(&mut gloss, light.irradiance, cosine * lobe * share * (exponent + 2.0) / TAU);
        }
    }
    std::array::from_fn(|i| (hit.material.albedo[i] * diffuse[i] / PI + gloss[i]).max(0.0))
}
