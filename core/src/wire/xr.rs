//! What a WebXR light estimate holds: one main light, and spherical harmonics of everything else.

use super::{Coordinates, LightSet};
use crate::color::luminance;
use crate::harmonics::basis;
use crate::light::{Light, Sh9};
use glam::Vec3;

/// An `XRLightEstimate`, in WebXR's axes (+Y up). Like everything on the wire, no light is in it twice: the harmonics hold all but the
/// primary light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Unit vector towards the primary light; (0, 1, 0) where there is no light.
    pub direction: Vec3,
    /// Its perpendicular irradiance; 0 where there is no light.
    pub intensity: [f32; 3],
    /// Radiance of the rest, in the basis of `ambient_sh`; WebXR's 27 floats are its rows one after the other.
    pub harmonics: Sh9,
}

/// The estimate of `set`: its brightest light is the primary one.
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
