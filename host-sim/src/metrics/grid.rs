//! The texels that a sum over a map runs over: directions and solid angles.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::OnceLock;

use super::probes::AmbientResponse;
use super::{Domain, luminance};
use crate::env::EnvMap;

/// Directions and solid angles of a map's texels inside a [`Domain`], row-major from the zenith.
///
/// Over the hemisphere the row that straddles the equator of a map of odd height counts with its upper
/// part: that part's solid angle, at the middle of its range of theta.
#[derive(Debug)]
pub struct Grid {
    size: (usize, usize),
    rows: usize,
    domain: Domain,
    directions: Vec<[f64; 3]>,
    solid_angle_of_row: Vec<f64>,
    ambient: OnceLock<AmbientResponse>,
}

impl Grid {
    /// The texels of maps of this one's size.
    #[must_use]
    pub fn new(map: &EnvMap, domain: Domain) -> Self {
        let (width, height) = (map.width(), map.height());
        let rows = match domain {
            Domain::Sphere => height,
            Domain::Hemisphere => height.div_ceil(2),
        };
        let mut directions = Vec::with_capacity(rows * width);
        let mut solid_angle_of_row = Vec::with_capacity(rows);
        for row in 0..rows {
            if domain == Domain::Hemisphere && 2 * row + 1 == height {
                let top = row as f64 * PI / height as f64;
                solid_angle_of_row.push(top.cos() * TAU / width as f64);
                directions.extend((0..width).map(|column| at_theta((top + FRAC_PI_2) / 2.0, width, column)));
            } else {
                solid_angle_of_row.push(map.solid_angle(row));
                directions.extend((0..width).map(|column| map.direction(row, column)));
            }
        }
        Self { size: (width, height), rows, domain, directions, solid_angle_of_row, ambient: OnceLock::new() }
    }

    /// Whether a map has this grid's size.
    #[must_use]
    pub fn fits(&self, map: &EnvMap) -> bool {
        self.size == (map.width(), map.height())
    }

    /// The part of the map that the grid covers.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.size.0
    }

    /// Rows that count.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Unit directions of the texels that count.
    #[must_use]
    pub fn directions(&self) -> &[[f64; 3]] {
        &self.directions
    }

    /// Solid angle of texel `k`, steradians.
    #[must_use]
    pub fn solid_angle(&self, k: usize) -> f64 {
        self.solid_angle_of_row[k / self.size.0]
    }

    /// (direction, L dOmega in RGB) of every texel of `map` that counts.
    pub fn fluxes<'a>(&'a self, map: &'a EnvMap) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + 'a {
        debug_assert!(self.fits(map), "the grid was made for maps of another size");
        let texels = self.directions.iter().zip(map.texels()).enumerate();
        texels.map(|(k, (&d, rgb))| (d, rgb.map(|v| f64::from(v) * self.solid_angle(k))))
    }

    /// (direction, Y dOmega) of every texel of `map` that counts and is not black.
    pub fn luminous<'a>(&'a self, map: &'a EnvMap) -> impl Iterator<Item = ([f64; 3], f64)> + 'a {
        self.fluxes(map).map(|(d, flux)| (d, luminance(flux))).filter(|&(_, flux)| flux > 0.0)
    }

    /// Irradiance of the probes under the ambient basis, computed at the first use.
    pub(super) fn ambient(&self) -> &AmbientResponse {
        self.ambient.get_or_init(|| AmbientResponse::new(self))
    }
}

fn at_theta(theta: f64, width: usize, column: usize) -> [f64; 3] {
    let phi = PI - (column as f64 + 0.5) * TAU / width as f64;
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}
