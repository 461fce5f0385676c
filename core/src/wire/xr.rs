//! The WebXR light estimate of a light set: one primary light, and spherical harmonics of all other light.

use super::{Coordinates, LightSet};
use crate::color::luminance;
use crate::harmonics::basis;
use crate::light::{Light, Sh9};
use glam::Vec3;

/// The values of an `XRLightEstimate`, in the axes of WebXR (+Y up). The harmonics contain all light except the primary light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Unit vector towards the primary light; (0, 1, 0) without lights.
    pub direction: Vec3,
    /// Perpendicular irradiance of the primary light; 0 without lights.
    pub intensity: [f32; 3],
    /// Radiance of all light except the primary light, in the basis of `ambient_sh`; the 27 floats of WebXR are the coefficients row by
    /// row.
    pub harmonics: Sh9,
}

/// Computes the estimate of `set`; the primary light is the brightest.
///
/// ```
/// use hemilux_core::Light;
/// use hemilux_core::wire::{LightSet, estimate};
///
/// let lamp = Light { id: 1, direction: glam::Vec3::Z, irradiance: [5.0; 3], ..Light::default() };
/// let sky = Light { id: 2, direction: glam::Vec3::X, irradiance: [1.0; 3], ..Light::default() };
/// let xr = estimate(&LightSet { lights: &[sky, lamp], ..LightSet::EMPTY });
/// assert_eq!((xr.direction, xr.intensity), (glam::Vec3::Y, [5.0; 3]));
/// assert!(xr.harmonics[0][0] > 0.0);
/// ```
#[must_use]
pub fn estimate(set: &LightSet<'_>) -> Estimate {
    let brightness = |l: &Light| luminance(l.irradiance);
    let by_brightness =
        |(_, a): &(usize, &Light), (_, b): &(usize, &Light)| brightness(a).total_cmp(&brightness(b));
    let primary = set.lights.iter().enumerate().max_by(by_brightness);
    let mut rest = set.ambient_sh.copied().unwrap_or_default();
    for (_, light) in set.lights.iter().enumerate().filter(|(i, _)| primary.is_none_or(|(p, _)| p != *i)) {
        for (row, y) in rest.iter_mut().zip(basis(light.direction)) {
            crate::color::add(row, light.irradiance.map(|v| v * y));
        }
    }
    let axes = Coordinates::YUp;
    Estimate {
        direction: primary.map_or(Vec3::Y, |(_, l)| axes.direction(l.direction)),
        intensity: primary.map_or([0.0; 3], |(_, l)| l.irradiance),
        harmonics: axes.harmonics(&rest),
    }
}
