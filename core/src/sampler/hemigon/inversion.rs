//! Hemigon-R: a continuous map from the unit square to a hemisphere under which equal areas hold equal light.
//!
//! The concentric map of Shirley and Chiu converts the square to a disk. A point of the disk has an area coordinate q (the area of the
//! circle through it, relative to the disk) and a turn s (its angle, relative to 2 pi). q selects theta from the marginal distribution of
//! the rings, s selects phi from the conditional distribution within the ring. With `A(k)` the light of ring k per unit of z and `S(k, x)`
//! the fraction of it before column x:
//!
//! ```text
//! theta:  M(theta) = q        M = light between the zenith and theta + floor
//! phi:    C(phi)   = s        C = (1 - t) A(a) S(a, phi) + t A(a + 1) S(a + 1, phi) + floor, over its value at a whole turn
//! ```
//!
//! where a + t is theta in units of rings, counted from their centres. The conditional distributions of neighbouring rings are
//! interpolated, so phi is continuous across rings. Both ends of a turn are the same meridian on every ring, and the rings shrink to a
//! point at the zenith, so the map has no seam. The floor is a uniform sky with the fraction [`FLOOR`] of the light; it makes both
//! distributions strictly increasing.
//!
//! Only the abstract of \[Havran2003\] was available: this map has the properties that the abstract states and is a reconstruction.

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{luminance, sound};
use crate::healpix::Domain;
use crate::polar::{Grid, LatLongView};
use core::f64::consts::TAU;
use glam::DVec3;

/// Fraction of the light that is distributed uniformly before the inversion.
///
/// A lower value stretches the map over dark regions by up to 1 / `FLOOR`; a higher value places lights in dark regions: at 0.5 %, one
/// light of 200.
pub const FLOOR: f64 = 0.005;

/// One ring of a hemisphere: a row of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ring {
    /// |z| of the lower edge of the ring on the unit sphere.
    z: f64,
    /// Luminance energy of the ring per unit of z.
    radiance: f64,
    /// Luminance energy between the pole of the hemisphere and the lower edge of the ring.
    end: f64,
}

/// Returns the number of rings that [`Inversion::try_new`] needs. On a sphere with an odd number of rows the equator divides one row into
/// two rings.
#[must_use]
pub const fn rings_len(grid: &Grid) -> usize {
    match grid.domain {
        Domain::Hemisphere => grid.height,
        Domain::Sphere => 2 * grid.height.div_ceil(2),
    }
}

/// The image of a point of the unit square: a direction, its texel and its probability density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Direction of the image, a unit vector.
    pub direction: DVec3,
    /// Index of a texel with light in the column of the image, from which the light takes its colour.
    pub texel: usize,
    /// Probability density of the direction over solid angle, per steradian, within the hemisphere.
    pub pdf_sa: f64,
}

/// The cumulative distributions of one map. `C` holds one `f32` per texel, `R` holds [`rings_len`] rings.
#[derive(Clone, Debug)]
pub struct Inversion<C, R> {
    grid: Grid,
    /// Cumulative fraction of the light of each ring up to the end of a column, counted counter-clockwise from phi = 0.
    conditional: C,
    rings: R,
}

/// A point of a ring of the map: its column, and its position in the column.
struct ColumnPoint {
    column: usize,
    /// Position of the point within the column, as a fraction of the column's width, 0..=1.
    across: f64,
    /// Luminance energy of the column in the interpolated distribution.
    light: f64,
}

/// Two neighbouring rings, and a position between their centres.
struct RingPair {
    /// Indices of the upper and of the lower ring.
    rings: [usize; 2],
    /// Position between the centres of the two rings: 0 at the centre of the upper ring, 1 at the centre of the lower ring.
    part: f64,
}

/// The interpolated conditional distribution of two neighbouring rings, including the floor.
struct Blend<'a> {
    rows: [&'a [f32]; 2],
    weights: [f64; 2],
    floor: f64,
}

impl Blend<'_> {
    /// Returns the luminance energy of the distribution before column `j`.
    fn before(&self, j: usize) -> f64 {
        let part = |row: &[f32]| if j == 0 { 0.0 } else { f64::from(row[j - 1]) };
        let [a, b] = self.rows;
        let even = self.floor * j as f64 / a.len() as f64;
        self.weights[0] * part(a) + self.weights[1] * part(b) + even
    }

    /// Returns the point of the ring up to which the luminance energy is `target`.
    fn find(&self, target: f64) -> ColumnPoint {
        let (mut low, mut high) = (0, self.rows[0].len());
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if self.before(middle) <= target { low = middle } else { high = middle }
        }
        let (start, end) = (self.before(low), self.before(high));
        let across = if end > start { ((target - start) / (end - start)).clamp(0.0, 1.0) } else { 0.5 };
        ColumnPoint { column: low, across, light: end - start }
    }
}

impl<C: Buffer<f32>, R: Buffer<Ring>> Inversion<C, R> {
    /// Creates the distributions for maps of at most the size of `grid`.
    ///
    /// # Errors
    /// [`TooSmall`] if `conditional` or `rings` has too few elements.
    pub fn try_new(grid: &Grid, conditional: C, rings: R) -> Result<Self, TooSmall> {
        buffer::check(&conditional, grid.len())?;
        buffer::check(&rings, rings_len(grid))?;
        Ok(Self { grid: LatLongView::NONE.grid, conditional, rings })
    }

    /// Computes the distributions of `map`. Returns the luminance energy of its upper and of its lower hemisphere, 0 for a map that does not fit
    /// the buffers.
    pub fn build(&mut self, map: &LatLongView<'_>) -> [f64; 2] {
        let grid = map.grid;
        let whole = !grid.is_empty() && map.texels.len() == grid.len();
        let fits =
            grid.len() <= self.conditional.as_ref().len() && rings_len(&grid) <= self.rings.as_ref().len();
        if !whole || !fits {
            self.grid = LatLongView::NONE.grid;
            return [0.0; 2];
        }
        self.grid = grid;
        let upper = self.stack(map, false);
        let lower = if grid.domain == Domain::Sphere { self.stack(map, true) } else { 0.0 };
        [upper, lower]
    }

    /// Returns the number of rings of one hemisphere of the map.
    fn count(&self) -> usize {
        match self.grid.domain {
            Domain::Hemisphere => self.grid.height,
            Domain::Sphere => self.grid.height.div_ceil(2),
        }
    }

    fn rings(&self, lower: bool) -> &[Ring] {
        let count = self.count();
        let first = if lower { count } else { 0 };
        self.rings.as_ref().get(first..first + count).unwrap_or(&[])
    }

    /// Returns the row of the map that is ring `k`.
    fn row(&self, lower: bool, k: usize) -> usize {
        if lower { self.grid.height - 1 - k } else { k }
    }

    /// Fills the rings of one hemisphere from its pole, and their conditional distributions; returns the luminance energy of the hemisphere.
    fn stack(&mut self, map: &LatLongView<'_>, lower: bool) -> f64 {
        let (count, width) = (self.count(), self.grid.width);
        let first = if lower { count } else { 0 };
        let (mut z, mut total) = (1.0, 0.0);
        for k in 0..count {
            let row = self.row(lower, k);
            let at = row * width..(row + 1) * width;
            let sum = accumulate(&map.texels[at.clone()], &mut self.conditional.as_mut()[at]);
            let below = libm::cos(self.grid.theta(k + 1));
            let radiance = sum / (libm::cos(self.grid.theta(k)) - below);
            let edge = if k + 1 == count { 0.0 } else { below };
            total += radiance * (z - edge);
            z = edge;
            self.rings.as_mut()[first + k] = Ring { z, radiance, end: total };
        }
        total
    }

    /// Maps the point `square` of the unit square to the upper or `lower` hemisphere; `None` if that hemisphere has no light.
    ///
    /// A point that the floor would map to a dark texel is mapped by the distribution without the floor.
    #[must_use]
    pub fn place(&self, map: &LatLongView<'_>, lower: bool, square: [f64; 2]) -> Option<Place> {
        let [q, s] = disk(square);
        let place = |floor| self.invert(map, lower, [q, s], floor);
        place(FLOOR).or_else(|| place(0.0))
    }

    /// Returns the image of area coordinate `q` and turn `s`, with the fraction `part` of the light as floor; `None` for a dark texel.
    fn invert(&self, map: &LatLongView<'_>, lower: bool, [q, s]: [f64; 2], part: f64) -> Option<Place> {
        let rings = self.rings(lower);
        let total = rings.last()?.end;
        // Light and floor per unit of z; their integrals add up to the total.
        let (lit, floor) = (1.0 - part, part * total);
        let end = |ring: &Ring| lit * ring.end + floor * (1.0 - ring.z);
        let target = q.min(BELOW_ONE) * end(rings.last()?);
        let k = rings.partition_point(|ring| end(ring) <= target).min(rings.len() - 1);
        let above = if k == 0 { Ring { z: 1.0, ..Ring::default() } } else { rings[k - 1] };
        let ring = &rings[k];
        let density = lit * ring.radiance + floor;
        let z = (above.z - (target - end(&above)) / density).clamp(ring.z, above.z);

        let RingPair { rings: pair, part: t } = self.neighbours(libm::acos(z), rings.len());
        let rows = pair.map(|k| self.row(lower, k));
        let weights = [lit * (1.0 - t) * rings[pair[0]].radiance, lit * t * rings[pair[1]].radiance];
        let blend = Blend { rows: rows.map(|row| self.conditional_of(row)), weights, floor };
        let whole = weights[0] + weights[1] + floor;
        let ColumnPoint { column, across, light } = blend.find(s.min(BELOW_ONE) * whole);

        let texel = self.lit_texel(map, self.row(lower, k), rows, column)?;
        let width = self.grid.width as f64;
        let phi = self.first_phi() + (column as f64 + across) * TAU / width;
        let sin = libm::sqrt((1.0 - z * z).max(0.0));
        let up = if lower { -z } else { z };
        let direction = DVec3::new(sin * libm::cos(phi), sin * libm::sin(phi), up);
        let pdf_sa = density / (total * TAU) * (light / whole * width);
        (pdf_sa > 0.0).then_some(Place { direction, texel, pdf_sa })
    }

    /// Returns the two of `count` rings between whose centres `theta`, radians, lies.
    fn neighbours(&self, theta: f64, count: usize) -> RingPair {
        let spacing = self.grid.theta(1);
        let at = (theta / spacing - 0.5).clamp(0.0, (count - 1) as f64);
        let first = (at as usize).min(count.saturating_sub(2));
        RingPair { rings: [first, (first + 1).min(count - 1)], part: at - first as f64 }
    }

    fn conditional_of(&self, row: usize) -> &[f32] {
        &self.conditional.as_ref()[row * self.grid.width..(row + 1) * self.grid.width]
    }

    /// Returns the texel in `column` of row `own` or, if it is dark, of a row in `pair`; `None` if all are dark.
    fn lit_texel(&self, map: &LatLongView<'_>, own: usize, pair: [usize; 2], column: usize) -> Option<usize> {
        let at = |row: usize| row * self.grid.width + counted(self.grid.width, column);
        [own, pair[0], pair[1]].map(at).into_iter().find(|i| light_of(map.texels[*i]) > 0.0)
    }

    /// Returns the azimuth, radians, at which the count of columns starts: 0, or half a column off 0 if the number of columns is odd.
    fn first_phi(&self) -> f64 {
        self.grid.phi(self.grid.width / 2)
    }
}

/// Largest number below 1, to which a coordinate of 1 is limited so that it falls into the last bin.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON;

/// Writes to `row` the cumulative fraction of the light up to the end of each column, counter-clockwise from phi = 0; returns the light of
/// the row.
fn accumulate(texels: &[[f32; 3]], row: &mut [f32]) -> f64 {
    let width = texels.len();
    let sum: f64 = texels.iter().map(|t| light_of(*t)).sum();
    let mut before = 0.0;
    for (k, share) in row.iter_mut().enumerate() {
        before += light_of(texels[counted(width, k)]);
        *share = if sum > 0.0 { (before / sum).min(1.0) as f32 } else { 0.0 };
    }
    sum
}

/// Returns the map column at position `k`, counted counter-clockwise from phi = 0.
fn counted(width: usize, k: usize) -> usize {
    (width / 2 + width - 1 - k) % width
}

/// Returns the luminance energy of a texel; 0 for negative or non-finite energy.
pub(super) fn light_of(rgb: [f32; 3]) -> f64 {
    f64::from(luminance(sound(rgb)))
}

/// Returns area coordinate and turn, both 0..1, of the image of a point of the unit square under the concentric map to the disk.
fn disk([u, v]: [f64; 2]) -> [f64; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    let (r, turn) = if a.abs() > b.abs() { (a, b / a / 8.0) } else { (b, 0.25 - a / b / 8.0) };
    let turn = if r < 0.0 { turn + 0.5 } else { turn };
    [r * r, if turn < 0.0 { turn + 1.0 } else { turn }]
}
