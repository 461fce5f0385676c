//! Directions and solid angles of the texels of a map, for quadrature over the map.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::OnceLock;

use super::irradiance::{AmbientResponse, Texel};
use super::{Domain, luminance};
use crate::env::EnvMap;

/// Directions and solid angles of a map's texels inside a [`Domain`], row-major from the zenith.
///
/// On the hemisphere, the upper part of the middle row of a map of odd height belongs to the grid: solid angle and direction of the row's texels
/// are those of the upper part.
#[derive(Debug)]
pub struct TexelGrid {
    size: (usize, usize),
    rows: usize,
    domain: Domain,
    /// Pairs (sin, cos) of each row's theta and of each column's phi, from which directions are computed.
    rows_sin_cos: Vec<(f64, f64)>,
    columns_sin_cos: Vec<(f64, f64)>,
    solid_angle_of_row: Vec<f64>,
    ambient: OnceLock<AmbientResponse>,
}

impl TexelGrid {
    /// Creates the grid for maps of the size of `map`.
    #[must_use]
    pub fn new(map: &EnvMap, domain: Domain) -> Self {
        let (width, height) = (map.width(), map.height());
        let rows = match domain {
            Domain::Sphere => height,
            Domain::Hemisphere => height.div_ceil(2),
        };
        let mut rows_sin_cos = Vec::with_capacity(rows);
        let mut solid_angle_of_row = Vec::with_capacity(rows);
        for row in 0..rows {
            if domain == Domain::Hemisphere && 2 * row + 1 == height {
                let top = row as f64 * PI / height as f64;
                solid_angle_of_row.push(top.cos() * TAU / width as f64);
                rows_sin_cos.push(((top + FRAC_PI_2) / 2.0).sin_cos());
            } else {
                solid_angle_of_row.push(map.solid_angle(row));
                rows_sin_cos.push(((row as f64 + 0.5) * PI / height as f64).sin_cos());
            }
        }
        let phi = |column: usize| PI - (column as f64 + 0.5) * TAU / width as f64;
        let columns_sin_cos = (0..width).map(|column| phi(column).sin_cos()).collect();
        let (size, ambient) = ((width, height), OnceLock::new());
        Self { size, rows, domain, rows_sin_cos, columns_sin_cos, solid_angle_of_row, ambient }
    }

    /// Returns whether `map` has the size for which the grid was created.
    #[must_use]
    pub fn fits(&self, map: &EnvMap) -> bool {
        self.size == (map.width(), map.height())
    }

    /// Returns the part of the sphere that the grid covers.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Returns the number of columns of the grid.
    #[must_use]
    pub fn width(&self) -> usize {
        self.size.0
    }

    /// Returns the number of rows of the grid inside of the domain.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the unit directions of the texels inside of the domain, row-major.
    pub fn directions(&self) -> impl Iterator<Item = [f64; 3]> + Clone + '_ {
        self.rows_sin_cos
            .iter()
            .flat_map(|&(sin, cos)| self.columns_sin_cos.iter().map(move |&(y, x)| [sin * x, sin * y, cos]))
    }

    /// Returns the solid angle of texel `k`, steradians.
    #[must_use]
    pub fn solid_angle(&self, k: usize) -> f64 {
        self.solid_angle_of_row[k / self.size.0]
    }

    /// Returns (direction, L dOmega in RGB) of every texel of `map` inside of the domain.
    pub fn fluxes<'a>(&'a self, map: &'a EnvMap) -> impl Iterator<Item = ([f64; 3], [f64; 3])> + 'a {
        debug_assert!(self.fits(map), "the map's size differs from the grid's");
        let texels = self.directions().zip(map.texels()).enumerate();
        texels.map(|(k, (d, rgb))| (d, rgb.map(|v| f64::from(v) * self.solid_angle(k))))
    }

    /// Returns (direction, Y dOmega) of every texel of `map` inside of the domain that is not black.
    pub fn luminous<'a>(&'a self, map: &'a EnvMap) -> impl Iterator<Item = ([f64; 3], f64)> + 'a {
        self.fluxes(map).map(|(d, flux)| (d, luminance(flux))).filter(|&(_, flux)| flux > 0.0)
    }

    /// Returns the irradiance of the receivers under the functions of the ambient basis; the first call computes it.
    pub(super) fn ambient(&self) -> &AmbientResponse {
        let texel = |(k, direction)| Texel { direction, solid_angle: self.solid_angle(k) };
        self.ambient.get_or_init(|| AmbientResponse::new(self.directions().enumerate().map(texel)))
    }
}
