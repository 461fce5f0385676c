//! Latitude-longitude maps of energy: the hemispherical map of \[Nikodym2012\] (360 x 90 texels) and maps of the full sphere.
//!
//! Row i of a map of H rows covers theta from i span / H to (i + 1) span / H, where span is pi / 2 (hemisphere) or pi (sphere). Column j
//! of W columns is centred at phi = pi - (j + 1/2) 2 pi / W: columns run clockwise as seen from above.
//!
//! ```
//! use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
//! use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
//! use hemilux_core::{Domain, Order};
//!
//! let order = Order::try_new(2)?;
//! let grid = Grid { width: 8, height: 4, domain: Domain::Sphere };
//! let table = PolarTable::try_new(&grid, order, vec![Share::default(); shares_len(&grid, order)])?;
//! let mut map = LatLong::try_new(grid, [[0.0; 3]; 32])?;
//! let mut pyramid = Pyramid::try_new(vec![Quad::default(); pyramid_len(grid.domain, order)], grid.domain, order)?;
//! pyramid.texels_mut()[7] = Quad::from_light([1.0; 3], glam::Vec3::Z);
//! pyramid.build();
//! map.fill(&table, &pyramid.view());
//! let energy: f32 = map.view().texels.iter().map(|rgb| rgb[0]).sum();
//! assert!((energy - 1.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::buffer::{self, Buffer, TooSmall};
use crate::healpix::{self, Circle, Domain, FaceCell, Order};
use crate::pyramid::PyramidView;
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::DVec3;

/// Size and domain of a latitude-longitude map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Number of columns of the latitude-longitude map.
    pub width: usize,
    /// Number of rows of the latitude-longitude map.
    pub height: usize,
    /// The part of the sphere that the map covers.
    pub domain: Domain,
}

impl Grid {
    /// The grid with one texel per degree of a hemisphere, as in \[Nikodym2012\].
    pub const POLAR: Self = Self { width: 360, height: 90, domain: Domain::Hemisphere };

    /// Returns the number of texels of the map; `usize::MAX` on overflow.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.width.saturating_mul(self.height)
    }

    /// Returns whether the map has no texels.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns theta, radians, of the upper edge of `row`.
    #[must_use]
    pub fn theta(&self, row: usize) -> f64 {
        let span = if self.domain == Domain::Sphere { PI } else { FRAC_PI_2 };
        row as f64 * span / self.height as f64
    }

    /// Returns whether the map has texels and the indices of its texels fit 32 bits.
    fn is_indexable(&self) -> bool {
        !self.is_empty() && u32::try_from(self.len()).is_ok()
    }

    /// Returns phi, radians, of the left edge of `column`.
    #[must_use]
    pub fn phi(&self, column: usize) -> f64 {
        PI - column as f64 * TAU / self.width as f64
    }

    /// Returns the solid angle, steradians, of a texel in row `row`.
    #[must_use]
    pub fn solid_angle(&self, row: usize) -> f64 {
        (libm::cos(self.theta(row)) - libm::cos(self.theta(row.saturating_add(1)))) * TAU / self.width as f64
    }

    /// Returns the unit vector towards the centre of the texel with index `texel`, counted row by row.
    #[must_use]
    pub fn centre(&self, texel: usize) -> DVec3 {
        let (row, column) = (texel / self.width.max(1), texel % self.width.max(1));
        let (sin, cos) = libm::sincos(self.theta(row) + 0.5 * self.theta(1));
        let phi = self.phi(column) - PI / self.width as f64;
        DVec3::new(sin * libm::cos(phi), sin * libm::sin(phi), cos)
    }

    /// Returns the index of the texel that contains the unit vector `direction`; `None` outside of the domain, and for maps without texels or
    /// with 2^32 texels and more.
    #[must_use]
    pub fn texel(&self, direction: DVec3) -> Option<usize> {
        let theta = libm::atan2(libm::hypot(direction.x, direction.y), direction.z);
        let row = self.row(theta)?;
        Some(row * self.width + self.column(libm::atan2(direction.y, direction.x)))
    }

    /// Returns the row that contains `theta`, radians; `None` outside of the domain, and for maps without texels or with 2^32 texels and more.
    fn row(&self, theta: f64) -> Option<usize> {
        let row = theta / self.theta(self.height) * self.height as f64;
        let outside = row >= self.height as f64 && self.domain == Domain::Hemisphere;
        (!outside && self.is_indexable()).then(|| (row as usize).min(self.height - 1))
    }

    /// Returns the column that contains the azimuth `phi`, -pi to 2 pi.
    fn column(&self, phi: f64) -> usize {
        let turns = (PI - phi) / TAU;
        let column = if turns < 0.0 { turns + 1.0 } else { turns } * self.width as f64;
        (column as usize).min(self.width.saturating_sub(1))
    }
}

/// A latitude-longitude map: the energy (radiance times solid angle, RGB) of each texel, row by row, in a lent buffer.
#[derive(Clone, Debug)]
pub struct LatLong<B> {
    grid: Grid,
    texels: B,
}

/// A borrowed latitude-longitude map: the input of samplers.
#[derive(Clone, Copy, Debug)]
pub struct LatLongView<'a> {
    /// Size of the map and part of the sphere that it covers.
    pub grid: Grid,
    /// Energy of each texel, row by row; empty in a map for samplers that do not read it.
    pub texels: &'a [[f32; 3]],
}

impl LatLongView<'_> {
    /// A map without texels, for samplers that do not read it.
    pub const NONE: Self = Self { grid: Grid { width: 0, height: 0, domain: Domain::Sphere }, texels: &[] };
}

impl<B: Buffer<[f32; 3]>> LatLong<B> {
    /// Creates a map in `texels`, which needs `grid.len()` elements.
    ///
    /// # Errors
    /// [`TooSmall`] if `texels` has too few elements.
    pub fn try_new(grid: Grid, texels: B) -> Result<Self, TooSmall> {
        buffer::check(&texels, grid.len())?;
        Ok(Self { grid, texels })
    }

    /// Returns all texels of the map, row by row.
    pub fn texels_mut(&mut self) -> &mut [[f32; 3]] {
        self.texels.as_mut().get_mut(..self.grid.len()).unwrap_or_default()
    }

    /// Returns the size of the map and the part of the sphere that it covers.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Borrows the map for samplers.
    #[must_use]
    pub fn view(&self) -> LatLongView<'_> {
        LatLongView {
            grid: self.grid,
            texels: self.texels.as_ref().get(..self.grid.len()).unwrap_or_default(),
        }
    }

    /// Replaces the map by the energy of `pyramid`, resampled with `table`. The total energy equals that of the quads of the table's order.
    pub fn fill<E: Buffer<Share>>(&mut self, table: &PolarTable<E>, pyramid: &PyramidView<'_>) {
        let texels = self.texels_mut();
        texels.fill([0.0; 3]);
        let quads = pyramid.quads_of(table.order);
        for share in table.shares() {
            let (Some(to), Some(quad)) = (texels.get_mut(share.to as usize), quads.get(share.from as usize))
            else {
                continue;
            };
            crate::color::add(to, quad.rgb().map(|v| v * share.part));
        }
    }
}

/// The fraction of a HEALPix quad's energy that is assigned to one texel of a latitude-longitude map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// Index of the HEALPix quad whose light the share is of.
    pub from: u32,
    /// Index of the texel of the latitude-longitude map.
    pub to: u32,
    /// Fraction of the quad's energy that the texel gets, 0..=1; the fractions of one quad add up to 1.
    pub part: f32,
}

/// The resampling table from HEALPix quads to a latitude-longitude map, computed once per grid and order.
#[derive(Clone, Debug)]
pub struct PolarTable<E> {
    shares: E,
    count: usize,
    order: u8,
}

/// Largest number of sub-samples along a side of a quad: near the zenith a quad spans a quarter turn of columns.
const MAX_SIDE: u32 = 64;

/// Number of sub-samples per column or row of the map that a quad crosses: with 5, a uniform sky is uniform within a few per cent; a larger
/// number takes longer to compute.
const FINENESS: f64 = 5.0;

/// Returns the number of sub-samples along a side of a quad, so that each column that the quad crosses gets sub-samples.
fn side(grid: &Grid, order: u8, sin_theta: f64) -> u32 {
    let extent = libm::sqrt(healpix::solid_angle(order));
    let column = sin_theta.max(1e-6) * TAU / grid.width.max(1) as f64;
    let row = grid.theta(1);
    (libm::ceil(FINENESS * extent / column.min(row)) as u32).clamp(4, MAX_SIDE)
}

/// Calls `f` with every share of the quads of `face`, in NESTED order.
fn visit(grid: &Grid, order: u8, face: u32, mut f: impl FnMut(Share)) {
    let nside = f64::from(1u32 << order);
    let mut targets = [0u32; (MAX_SIDE * MAX_SIDE) as usize];
    for from in face << (2 * order)..(face + 1) << (2 * order) {
        if grid.domain.share(order, from) == 0.0 {
            continue;
        }
        let FaceCell { x, y, .. } = healpix::split(order, from);
        let along = |sum: f64| Circle::new(face, (f64::from(x + y) + sum) / nside);
        let n = side(grid, order, along(1.0).sin_theta);
        let step = 1.0 / f64::from(n);
        let mut count = 0;
        // Sub-samples (i, j) with equal i + j have equal theta.
        for sum in 0..2 * n - 1 {
            let circle = along(f64::from(sum + 1) * step);
            let Some(row) = grid.row(libm::atan2(circle.sin_theta, circle.z)) else { continue };
            for i in sum.saturating_sub(n - 1)..=sum.min(n - 1) {
                let across = f64::from(2 * i) - f64::from(sum);
                let phi = circle.phi(face, (f64::from(x) - f64::from(y) + across * step) / nside);
                if let Some(target) = targets.get_mut(count) {
                    *target = (row * grid.width + grid.column(phi)) as u32;
                    count += 1;
                }
            }
        }
        let targets = &mut targets[..count];
        targets.sort_unstable();
        for same in targets.chunk_by(|a, b| a == b) {
            f(Share { from, to: same[0], part: same.len() as f32 / count as f32 });
        }
    }
}

/// Returns the number of adjacent base faces whose shares differ only by a rotation: four if a quarter turn is a whole number of columns.
fn alike(grid: &Grid) -> u32 {
    if grid.width.is_multiple_of(4) { 4 } else { 1 }
}

/// Returns the first base face of each group of [`alike`] faces.
fn faces(grid: &Grid) -> impl Iterator<Item = u32> {
    (0..grid.domain.faces() as u32).step_by(alike(grid) as usize)
}

/// Returns the number of shares that [`PolarTable::try_new`] needs for `grid` and quads of `order`. Takes as long as building the table.
#[must_use]
pub fn shares_len(grid: &Grid, order: Order) -> usize {
    let order = order.get();
    let mut count = 0;
    for face in faces(grid) {
        visit(grid, order, face, |_| count += alike(grid) as usize);
    }
    count
}

impl Share {
    /// Returns this share rotated by `quarters` quarter turns: the azimuth increases with the face and decreases with the column.
    fn turned(self, grid: &Grid, order: u8, quarters: u32) -> Self {
        let width = (grid.width as u64).max(1);
        let (row, column) = (u64::from(self.to) / width, u64::from(self.to) % width);
        let column = (column + width - width / 4 * u64::from(quarters)) % width;
        let to = (row * width + column) as u32;
        Self { from: self.from + (quarters << (2 * order)), to, part: self.part }
    }
}

impl<E: Buffer<Share>> PolarTable<E> {
    /// Computes the table from quads of `order`, at most the order of the pyramid, to `grid`. [`shares_len`] returns the length of `shares`.
    ///
    /// # Errors
    /// [`TooSmall`] if `shares` has too few elements.
    pub fn try_new(grid: &Grid, order: Order, mut shares: E) -> Result<Self, TooSmall> {
        let order = order.get();
        let (slots, mut needed) = (shares.as_mut(), 0);
        for face in faces(grid) {
            let first = needed;
            visit(grid, order, face, |share| {
                if let Some(slot) = slots.get_mut(needed) {
                    *slot = share;
                }
                needed += 1;
            });
            let len = needed - first;
            for quarters in 1..alike(grid) {
                for i in first..first + len {
                    if let Some(share) = slots.get(i).copied()
                        && let Some(slot) = slots.get_mut(needed)
                    {
                        *slot = share.turned(grid, order, quarters);
                    }
                    needed += 1;
                }
            }
        }
        buffer::check(&shares, needed)?;
        Ok(Self { shares, count: needed, order })
    }

    fn shares(&self) -> &[Share] {
        self.shares.as_ref().get(..self.count).unwrap_or_default()
    }
}
