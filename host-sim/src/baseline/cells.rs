//! Cells of a map with exact energy and exact energy centroid: the input of the baselines.

use std::f64::consts::{PI, TAU};
use std::ops::{Add, AddAssign};

use crate::env::EnvMap;
use crate::metrics::vector::{add_scaled, dot, norm, unit};
use crate::metrics::{Domain, Lit, TexelGrid, luminance};

/// Sums of energy, luminous energy and first moment over a set of texels, such as the texels that a light represents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flux {
    /// Energy of the texels: the sum of L dOmega, RGB.
    pub rgb: [f64; 3],
    /// Luminous energy of the texels: the sum of Y dOmega.
    pub luminance: f64,
    /// First moment of the texels: the sum of Y dOmega times the direction.
    pub moment: [f64; 3],
}

impl Flux {
    /// Creates the sums of one texel; `rgb` is its radiance times its solid angle, L dOmega.
    #[must_use]
    pub fn of_texel(direction: [f64; 3], rgb: [f64; 3]) -> Self {
        let luminance = luminance(rgb);
        Self { rgb, luminance, moment: direction.map(|v| v * luminance) }
    }

    /// Returns the direction of the first moment of the texels; `None` if the texels are black or their moments cancel.
    #[must_use]
    pub fn centroid(&self) -> Option<[f64; 3]> {
        // The moments of opposite halves of a sky cancel except for rounding errors.
        (norm(self.moment) > 1e-12 * self.luminance).then(|| unit(self.moment)).flatten()
    }

    /// Returns half the product of luminous energy and angular variance (mean squared chord): S0 - |S1| with the luminous energy S0 and the first
    /// moment S1, at least 0.
    #[must_use]
    pub fn spread(&self) -> f64 {
        (self.luminance - norm(self.moment)).max(0.0)
    }

    /// Returns the angular radius in degrees, at most 90, of a uniform disc with the angular variance of the texels.
    #[must_use]
    pub fn radius_deg(&self) -> f64 {
        let part = if self.luminance > 0.0 { (self.spread() / self.luminance).min(0.5) } else { 0.0 };
        2.0 * part.sqrt().asin().to_degrees()
    }

    /// Returns a light with the energy of the cells and the direction of their centroid; the direction is `fallback` if there is no centroid.
    #[must_use]
    pub fn lit(&self, fallback: [f64; 3], id: u32) -> Lit {
        let direction = self.centroid().unwrap_or(fallback);
        Lit { direction, irradiance: self.rgb, radius_deg: self.radius_deg(), id }
    }
}

impl AddAssign for Flux {
    fn add_assign(&mut self, other: Self) {
        add_scaled(&mut self.rgb, other.rgb, 1.0);
        add_scaled(&mut self.moment, other.moment, 1.0);
        self.luminance += other.luminance;
    }
}

impl Add for Flux {
    type Output = Self;
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

/// Rectangular cells of a map, each the sum over a block of texels; row-major from the zenith.
#[derive(Clone, Debug)]
pub struct Cells {
    width: usize,
    height: usize,
    block: (usize, usize),
    map_size: (usize, usize),
    flux: Vec<Flux>,
    direction: Vec<[f64; 3]>,
    solid_angle: Vec<f64>,
}

/// Angular size of a cell of a map, radians.
#[derive(Clone, Copy, Debug)]
pub struct Pitch {
    /// Size of a cell along the polar angle theta, radians.
    pub theta: f64,
    /// Size of a cell along the azimuth phi at the equator, radians.
    pub phi: f64,
}

impl Cells {
    /// Combines the texels of `domain` in blocks, of which the whole sphere has at most `max_width` x `max_width / 2`.
    #[must_use]
    pub fn new(map: &EnvMap, domain: Domain, max_width: usize) -> Self {
        let grid = TexelGrid::new(map, domain);
        let block = (map.width().div_ceil(max_width.max(1)), map.height().div_ceil((max_width / 2).max(1)));
        let (width, height) = (grid.width().div_ceil(block.0), grid.rows().div_ceil(block.1));
        let mut cells = Self {
            width,
            height,
            block,
            map_size: (map.width(), map.height()),
            flux: vec![Flux::default(); width * height],
            direction: Vec::new(),
            solid_angle: vec![0.0; width * height],
        };
        cells.fill(&grid, map);
        cells
    }

    /// Creates cells of which each is one texel of `map`.
    #[must_use]
    pub fn texels(map: &EnvMap, domain: Domain) -> Self {
        Self::new(map, domain, map.width().max(2 * map.height()))
    }

    fn fill(&mut self, grid: &TexelGrid, map: &EnvMap) {
        let mut middle = vec![[0.0; 3]; self.flux.len()];
        for (k, (direction, rgb)) in grid.fluxes(map).enumerate() {
            let at = (k / grid.width() / self.block.1) * self.width + k % grid.width() / self.block.0;
            self.flux[at] += Flux::of_texel(direction, rgb);
            self.solid_angle[at] += grid.solid_angle(k);
            add_scaled(&mut middle[at], direction, grid.solid_angle(k));
        }
        let directions = self.flux.iter().zip(middle);
        self.direction = directions
            .map(|(flux, middle)| flux.centroid().or_else(|| unit(middle)).unwrap_or([0.0, 0.0, 1.0]))
            .collect();
    }

    /// Returns the number of columns of cells.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows of cells.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the number of cells of the map.
    #[must_use]
    pub fn len(&self) -> usize {
        self.flux.len()
    }

    /// Returns whether the number of cells is 0, which no map has.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.flux.is_empty()
    }

    /// Returns the sum of the fluxes of the texels of cell `k`.
    #[must_use]
    pub fn flux(&self, k: usize) -> &Flux {
        &self.flux[k]
    }

    /// Returns the energy centroid of cell `k`; the centre of the cell if it is black.
    #[must_use]
    pub fn direction(&self, k: usize) -> [f64; 3] {
        self.direction[k]
    }

    /// Returns the solid angle of cell `k`, steradians.
    #[must_use]
    pub fn solid_angle(&self, k: usize) -> f64 {
        self.solid_angle[k]
    }

    /// Returns the mean luminance of cell `k`.
    #[must_use]
    pub fn radiance(&self, k: usize) -> f64 {
        self.flux[k].luminance / self.solid_angle[k]
    }

    /// Returns the indices of the cells that are not black.
    pub fn lit(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|&k| self.flux[k].luminance > 0.0)
    }

    /// Returns the flux of the whole map: the sum of the fluxes of all cells.
    #[must_use]
    pub fn total(&self) -> Flux {
        self.flux.iter().fold(Flux::default(), |sum, &flux| sum + flux)
    }

    /// Returns the angular size of a cell.
    #[must_use]
    pub fn pitch(&self) -> Pitch {
        let (width, height) = self.map_size;
        let theta = self.block.1 as f64 * PI / height as f64;
        Pitch { theta, phi: self.block.0 as f64 * TAU / width as f64 }
    }

    /// Returns the index of the cell that contains the unit vector `d`; below the last row, of the last cell of the column.
    #[must_use]
    pub fn at(&self, d: [f64; 3]) -> usize {
        let pitch = self.pitch();
        let row = (d[2].clamp(-1.0, 1.0).acos() / pitch.theta) as usize;
        let column = ((PI - d[1].atan2(d[0])) / pitch.phi) as usize;
        row.min(self.height - 1) * self.width + column.min(self.width - 1)
    }
}

/// Returns the index of the centre nearest to `d`, the least index of equally near centres; 0 for no centres.
#[must_use]
pub fn nearest(centres: &[[f64; 3]], d: [f64; 3]) -> usize {
    let mut best = (0, f64::NEG_INFINITY);
    for (k, &centre) in centres.iter().enumerate() {
        let cosine = dot(centre, d);
        if cosine > best.1 {
            best = (k, cosine);
        }
    }
    best.0
}

/// Returns the sum of the fluxes of the cells in the Voronoi cell of each of `centres`.
#[must_use]
pub fn voronoi(cells: &Cells, centres: &[[f64; 3]]) -> Vec<Flux> {
    let mut sums = vec![Flux::default(); centres.len()];
    if !centres.is_empty() {
        cells.lit().for_each(|k| sums[nearest(centres, cells.direction(k))] += *cells.flux(k));
    }
    sums
}
