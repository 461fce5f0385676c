//! Hemigon-R: a continuous map from the unit square to a hemisphere under which equal areas hold equal light.
//!
//! The square becomes a disk (Shirley and Chiu's concentric map), the disk the hemisphere: the area inside a circle picks theta from
//! the marginal distribution of the rings, the angle picks phi from the ring's conditional one. With q the area coordinate, s the
//! turn, `A(k)` the light of ring k per unit of z and `S(k, x)` the part of it before column x:
//!
//! ```text
//! theta:  M(theta) = q        M = light between the zenith and theta + floor
//! phi:    C(phi)   = s        C = (1 - t) A(a) S(a, phi) + t A(a + 1) S(a + 1, phi) + floor, over its value at a whole turn
//! ```
//!
//! where a + t is theta in rings, counted from their centres. Blended conditionals have no jumps between rings; both ends of the turn
//! are the same meridian on every ring, and rings shrink to a point at the zenith: no seam. The floor is a uniform sky of [`FLOOR`] of
//! the light; with it both directions are continuous wherever the map is lit.
//!
//! The published map is known from its abstract alone (\[Havran2003\]): this one has the properties claimed there and is a reconstruction.

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{luminance, sound};
use crate::healpix::Domain;
use crate::polar::{Grid, LatLongView};
use core::f64::consts::TAU;
use glam::DVec3;

/// Part of the light that is spread evenly before the inversion.
///
/// Less stretches the map over dark parts by up to 1 / `FLOOR`, more puts lights where there is no light: 0.5 % is one of 200.
pub const FLOOR: f64 = 0.005;

/// One ring of a hemisphere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ring {
    /// |z| of its lower edge.
    z: f64,
    /// Light per unit of z.
    radiance: f64,
    /// Light between the zenith (or nadir) and the lower edge.
    end: f64,
}

/// Rings that [`Inversion::try_new`] needs: a sphere's equator may cut one in two.
#[must_use]
pub const fn rings_len(grid: &Grid) -> usize {
    match grid.domain {
        Domain::Hemisphere => grid.height,
        Domain::Sphere => 2 * grid.height.div_ceil(2),
    }
}

/// Image of a point of the square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Unit vector.
    pub direction: DVec3,
    /// The texel whose light it is drawn from.
    pub texel: usize,
    /// Density over solid angle, per steradian, within its hemisphere.
    pub pdf_sa: f64,
}

/// The distribution of one map. `C` holds one `f32` per texel, `R` [`rings_len`] rings.
#[derive(Clone, Debug)]
pub struct Inversion<C, R> {
    grid: Grid,
    /// Each ring's light up to the end of a column, over the ring's; columns counted against the clock from phi = 0.
    conditional: C,
    rings: R,
}

/// A point of a ring.
struct ColumnPoint {
    column: usize,
    /// Part of the column's width before the point, 0..=1.
    across: f64,
    /// Light of the column.
    light: f64,
}

/// Two neighbouring rings and the position between their centres.
struct RingPair {
    /// The upper and the lower ring's index.
    rings: [usize; 2],
    /// 0 at the centre of the upper ring, 1 at that of the lower.
    part: f64,
}

/// Two neighbouring rings' conditional distributions, blended; the floor's light included.
struct Blend<'a> {
    rows: [&'a [f32]; 2],
    weights: [f64; 2],
    floor: f64,
}

impl Blend<'_> {
    /// Light before column `j`.
    fn before(&self, j: usize) -> f64 {
        let part = |row: &[f32]| if j == 0 { 0.0 } else { f64::from(row[j - 1]) };
        let [a, b] = self.rows;
        let even = self.floor * j as f64 / a.len() as f64;
        self.weights[0] * part(a) + self.weights[1] * part(b) + even
    }

    /// The point of the turn up to which the light is `target`.
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
    /// Takes the memory for maps with at most the texels of `grid`.
    ///
    /// # Errors
    /// [`TooSmall`].
    pub fn try_new(grid: &Grid, conditional: C, rings: R) -> Result<Self, TooSmall> {
        buffer::check(&conditional, grid.len())?;
        buffer::check(&rings, rings_len(grid))?;
        Ok(Self { grid: LatLongView::NONE.grid, conditional, rings })
    }

    /// Takes a map; returns the luminance of its upper and of its lower hemisphere, 0 for a map that does not fit.
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

    /// Rings of one hemisphere.
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

    /// Row of the map that is ring `k`.
    fn row(&self, lower: bool, k: usize) -> usize {
        if lower { self.grid.height - 1 - k } else { k }
    }

    /// Fills the rings of one hemisphere, from its pole on, and their conditional distributions; returns its luminance.
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

    /// Where the point (`u`, `v`) of the unit square lands in a hemisphere; `None` where that holds no light.
    ///
    /// A point that the floor would put where there is no light is placed by the distribution without it.
    #[must_use]
    pub fn place(&self, map: &LatLongView<'_>, lower: bool, square: [f64; 2]) -> Option<Place> {
        let [q, s] = disk(square);
        let place = |floor| self.invert(map, lower, [q, s], floor);
        place(FLOOR).or_else(|| place(0.0))
    }

    fn invert(&self, map: &LatLongView<'_>, lower: bool, [q, s]: [f64; 2], part: f64) -> Option<Place> {
        let rings = self.rings(lower);
        let total = rings.last()?.end;
        // Light and floor per unit of z; together they add up to the total.
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

    /// The two of `count` rings between whose centres `theta` lies.
    fn neighbours(&self, theta: f64, count: usize) -> RingPair {
        let spacing = self.grid.theta(1);
        let at = (theta / spacing - 0.5).clamp(0.0, (count - 1) as f64);
        let first = (at as usize).min(count.saturating_sub(2));
        RingPair { rings: [first, (first + 1).min(count - 1)], part: at - first as f64 }
    }

    fn conditional_of(&self, row: usize) -> &[f32] {
        &self.conditional.as_ref()[row * self.grid.width..(row + 1) * self.grid.width]
    }

    /// The texel of `own` row in a column or, if that is dark, of the other row of a pair; `None` if both are.
    fn lit_texel(&self, map: &LatLongView<'_>, own: usize, pair: [usize; 2], column: usize) -> Option<usize> {
        let at = |row: usize| row * self.grid.width + counted(self.grid.width, column);
        [own, pair[0], pair[1]].map(at).into_iter().find(|i| light_of(map.texels[*i]) > 0.0)
    }

    /// Phi where columns are counted from: 0, or half a column off it where their number is odd.
    fn first_phi(&self) -> f64 {
        self.grid.phi(self.grid.width / 2)
    }
}

/// Largest number below 1, so that a coordinate never points beyond the last bin.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON;

/// Writes each column's share of the light up to its end, against the clock from phi = 0; returns the light.
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

/// The column that is number `k` counted against the clock from phi = 0.
fn counted(width: usize, k: usize) -> usize {
    (width / 2 + width - 1 - k) % width
}

/// Luminance of a texel, whatever is in it.
pub(super) fn light_of(rgb: [f32; 3]) -> f64 {
    f64::from(luminance(sound(rgb)))
}

/// The concentric map of the unit square to the disk: area inside the point's circle over the disk's, and the point's turn, 0..1.
fn disk([u, v]: [f64; 2]) -> [f64; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    let (r, turn) = if a.abs() > b.abs() { (a, b / a / 8.0) } else { (b, 0.25 - a / b / 8.0) };
    let turn = if r < 0.0 { turn + 0.5 } else { turn };
    [r * r, if turn < 0.0 { turn + 1.0 } else { turn }]
}
