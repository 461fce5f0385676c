//! Full-sphere latitude-longitude environment maps: texel geometry, and maps from files and functions.
//!
//! The centre of texel (row i, column j) of a map of H rows and W columns is at the polar angle theta = (i + 1/2) pi / H from +Z and at the
//! azimuth phi = pi - (j + 1/2) 2 pi / W from +X, so that columns run clockwise as viewed from above.

use hemilux::maps::{self, Covers, DecodedMap, ReadOptions};
use hemilux_core::healpix::Domain;
use std::f64::consts::{PI, TAU};
use std::path::Path;

pub use hemilux::maps::MapError;

/// A latitude-longitude map of RGB radiance over the whole sphere; row 0 is at the zenith.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvMap {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
    domain: Domain,
    /// Number of texels in each row that were clipped to the largest accepted value.
    clipped: Vec<u32>,
    /// Number of texels with a negative value or NaN, which became 0.
    pub negative: usize,
    /// Notes of the file's reader about the map, for the user.
    pub notes: Vec<String>,
}

impl EnvMap {
    /// Creates a map of the whole sphere from row-major texels. Negative values and NaN become 0, values above [`maps::FLOAT_MAX`] become
    /// [`maps::FLOAT_MAX`].
    ///
    /// # Panics
    /// If `rgb.len() != width * height` or a side is zero.
    #[must_use]
    pub fn new(width: usize, height: usize, mut rgb: Vec<[f32; 3]>) -> Self {
        assert!(width > 0 && height > 0, "a map has at least one texel");
        assert_eq!(rgb.len(), width * height, "texels do not fill the map");
        let maps::Changed { negative, clipped } = maps::limit_range(&mut rgb, width, false);
        Self { width, height, rgb, domain: Domain::Sphere, clipped, negative, notes: Vec::new() }
    }

    /// Creates a map by evaluating `radiance(direction)` at every texel's centre.
    #[must_use]
    pub fn from_fn(width: usize, height: usize, radiance: impl Fn([f64; 3]) -> [f32; 3]) -> Self {
        let rgb =
            (0..height * width).map(|k| radiance(direction(width, height, k / width, k % width))).collect();
        Self::new(width, height, rgb)
    }

    /// Reads a map file with the projection and coverage that it states.
    ///
    /// # Errors
    /// [`MapError`] for a file that cannot be read or decoded.
    pub fn read(path: &Path) -> Result<Self, MapError> {
        Self::read_with(path, &ReadOptions::default())
    }

    /// Reads a map file; `options` can replace the projection and the coverage that the file states.
    ///
    /// # Errors
    /// [`MapError`] for a file that cannot be read or decoded.
    pub fn read_with(path: &Path, options: &ReadOptions) -> Result<Self, MapError> {
        maps::read(path, options).map(Self::from)
    }

    /// Returns the number of columns of the map.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows of the map, from zenith to nadir.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the radiance (red, green, blue) of the texels, row-major.
    #[must_use]
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.rgb
    }

    /// Returns the part of the sphere that the map's file covers. The other texels are black.
    #[must_use]
    pub fn domain(&self) -> Domain {
        self.domain
    }

    /// Returns the fraction of the solid angle of `domain` whose texels were clipped to the largest accepted value, 0 to 1.
    #[must_use]
    pub fn clipped_share(&self, domain: Domain) -> f64 {
        let (rows, all) = match domain {
            Domain::Sphere => (self.height, 2.0 * TAU),
            Domain::Hemisphere => (self.height.div_ceil(2), TAU),
        };
        let rows = self.clipped.iter().take(rows).enumerate();
        rows.map(|(row, count)| f64::from(*count) * self.solid_angle(row)).sum::<f64>() / all
    }

    /// Returns the number of texels that were clipped to the largest accepted value.
    #[must_use]
    pub fn clipped(&self) -> usize {
        self.clipped.iter().map(|n| *n as usize).sum()
    }

    /// Returns the unit direction of a texel's centre.
    #[must_use]
    pub fn direction(&self, row: usize, column: usize) -> [f64; 3] {
        direction(self.width, self.height, row, column)
    }

    /// Returns the solid angle of a texel in row `row`, steradians.
    #[must_use]
    pub fn solid_angle(&self, row: usize) -> f64 {
        let edge = |i: usize| (i as f64 * PI / self.height as f64).cos();
        (edge(row) - edge(row + 1)) * TAU / self.width as f64
    }
}

impl From<DecodedMap> for EnvMap {
    /// Converts a decoded map; a map of the hemisphere is extended by black rows below the horizon.
    fn from(map: DecodedMap) -> Self {
        let DecodedMap { width, height, texels: mut rgb, covers, notes, negative, clipped } = map;
        let (height, domain) = match covers {
            Covers::Sphere => (height, Domain::Sphere),
            Covers::Hemisphere => (2 * height, Domain::Hemisphere),
        };
        rgb.resize(width * height, [0.0; 3]);
        Self { width, height, rgb, domain, clipped, negative, notes }
    }
}

/// Returns the unit direction of the centre of texel (`row`, `column`) of a full-sphere map.
#[must_use]
pub fn direction(width: usize, height: usize, row: usize, column: usize) -> [f64; 3] {
    let theta = (row as f64 + 0.5) * PI / height as f64;
    let phi = PI - (column as f64 + 0.5) * TAU / width as f64;
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}
