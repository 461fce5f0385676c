//! Scores of light sets as defined in `host-sim/METRICS.md`, for charts, stress reports and comparisons.
//!
//! Arithmetic is f64; all scores are dimensionless ratios, and lower is better. [`TexelGrid`] defines the texels, [`receiver`] the receivers;
//! [`Reference`] contains the irradiance of the receivers under a map and scores a [`LitSet`] against the map; [`stability`] scores sequences.
//!
//! # Degenerate maps
//! Errors are relative to the map. On a black map an error is 0 if the set is black and infinite otherwise; no error is NaN.

mod disc;
pub mod grid;
mod irradiance;
pub mod receiver;
mod reference;
pub mod sh;
pub mod stability;
pub(crate) mod vector;

pub use disc::{Disc, Reading};
pub use grid::TexelGrid;
pub use hemilux_core::healpix::Domain;
pub use reference::{Reference, Score};

/// A directional light in the form that the scores read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lit {
    /// Unit vector from the probe towards the light, probe axes.
    pub direction: [f64; 3],
    /// Perpendicular irradiance, RGB: the sum of L dOmega over the light's region.
    pub irradiance: [f64; 3],
    /// Angular radius of the light as a disc, degrees, 0 to 90.
    pub radius_deg: f64,
    /// Identifier of the light, constant from frame to frame.
    pub id: u32,
}

/// Directional lights and ambient light of one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LitSet {
    /// The directional lights of the set.
    pub lights: Vec<Lit>,
    /// Coefficients of ambient radiance for the nine functions of [`sh::basis`], RGB rows, probe axes.
    pub ambient_sh: Option<[[f64; 3]; 9]>,
}

impl From<Vec<Lit>> for LitSet {
    fn from(lights: Vec<Lit>) -> Self {
        Self { lights, ambient_sh: None }
    }
}

/// Returns whether the scores include a light at `direction`: on the hemisphere, a light above or exactly on the horizon.
#[must_use]
pub fn holds(domain: Domain, direction: [f64; 3]) -> bool {
    domain == Domain::Sphere || direction[2] >= 0.0
}

/// Returns the luminance of linear RGB: 0.2126 R + 0.7152 G + 0.0722 B.
#[must_use]
pub fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// Returns `error / scale`; 0 / 0 is 0, and other errors over 0 are infinite.
pub(crate) fn relative(error: f64, scale: f64) -> f64 {
    if error == 0.0 {
        0.0
    } else if scale > 0.0 {
        error / scale
    } else {
        f64::INFINITY
    }
}

/// Returns the root mean square of the values; 0 if there are none.
pub(crate) fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    (values.map(|v| v * v).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests;
