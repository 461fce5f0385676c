//! `pharr`: importance sampling of a latitude-longitude map by inversion of its cumulative distribution, as in \[Pharr2004\] and
//! \[Nikodym2012\].
//!
//! Light i uses the same point of the Halton sequence in every frame: the first coordinate selects theta from the marginal distribution
//! over the rows, the second selects phi from the conditional distribution within the row. All lights have equal luminance and the colour
//! of their texel. The result is not filtered over time: a change of one texel moves all lights that follow it in the distribution.

use super::{Map, Request, Sampler, SamplerKind, Timer, halton};
use crate::buffer::{self, Buffer, TooSmall};
use crate::color::{luminance, sound};
use crate::light::{Decomposition, Light};
use crate::polar::{Grid, LatLongView};
use crate::sizes::BufferSize;
use core::f64::consts::TAU;
use glam::DVec3;

/// Largest number below 1, to which a coordinate of 1 is limited so that it falls into the last bin.
const BELOW_ONE: f64 = 1.0 - 1.0 / 16_777_216.0;

/// The buffers of [`Pharr`]; their lengths are in [`Sizes`].
#[derive(Clone, Debug)]
pub struct Memory<C, M, L> {
    /// Cumulative distribution of each row of the map over its columns.
    pub conditional: C,
    /// Cumulative distribution of the map over its rows.
    pub marginal: M,
    /// One [`Light`] per light of the set.
    pub lights: L,
}

/// Number of elements of each buffer in [`Memory`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Number of elements of [`Memory::conditional`]: one per texel.
    pub texels: usize,
    /// Number of elements of [`Memory::marginal`]: one per row.
    pub rows: usize,
    /// Number of elements of [`Memory::lights`].
    pub lights: usize,
}

impl Sizes {
    /// Returns the buffer lengths of the sampler for maps of `grid` and up to `lights` lights.
    #[must_use]
    pub const fn new(grid: &Grid, lights: usize) -> Self {
        Self { texels: grid.len(), rows: grid.height, lights }
    }

    /// Returns name and size of each buffer of the sampler.
    #[must_use]
    pub const fn buffers(&self) -> [BufferSize; 3] {
        [
            BufferSize::of::<f32>("sampler: rows", self.texels),
            BufferSize::of::<f64>("sampler: marginal", self.rows),
            BufferSize::of::<Light>("sampler: lights", self.lights),
        ]
    }
}

/// The sampler `pharr`, over the buffers of [`Memory`].
///
/// ```
/// use hemilux_core::sampler::pharr::{Memory, Pharr, Sizes};
/// use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
/// use hemilux_core::polar::{Grid, LatLongView};
/// use hemilux_core::{Domain, Light, Map, Order, Request, Sampler};
///
/// let grid = Grid { width: 8, height: 4, domain: Domain::Sphere };
/// let sizes = Sizes::new(&grid, 4);
/// let memory = Memory {
///     conditional: vec![0.0; sizes.texels],
///     marginal: vec![0.0; sizes.rows],
///     lights: vec![Light::default(); sizes.lights],
/// };
/// let mut sampler = Pharr::try_new(&grid, memory)?;
// A uniform map whose texels hold radiance times solid angle. `pharr` does not read the pyramid.
/// let texels: Vec<_> = (0..grid.len()).map(|i| [grid.solid_angle(i / 8) as f32; 3]).collect();
/// let quads = vec![Quad::default(); pyramid_len(Domain::Sphere, Order::saturating(0))];
/// let pyramid = Pyramid::try_new(quads, Domain::Sphere, Order::saturating(0))?;
/// let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels: &texels } };
/// let made = sampler.update(&map, &Request::of_lights(4));
/// // Four lights of equal luminance, which add up to 4 pi.
/// assert_eq!(made.lights.len(), 4);
/// assert!((made.lights[0].irradiance[1] - core::f32::consts::PI).abs() < 1e-4);
/// # Ok::<(), hemilux_core::TooSmall>(())
/// ```
#[derive(Clone, Debug)]
pub struct Pharr<C, M, L> {
    conditional: C,
    /// Cumulative luminance up to the end of each row, not normalised.
    marginal: M,
    lights: L,
    count: usize,
}

impl<C: Buffer<f32>, M: Buffer<f64>, L: Buffer<Light>> Pharr<C, M, L> {
    /// Creates the sampler for maps of at most the size of `grid`. [`Sizes`] contains the length of each buffer in `memory`.
    ///
    /// # Errors
    /// [`TooSmall`] for a distribution with too few elements.
    pub fn try_new(grid: &Grid, memory: Memory<C, M, L>) -> Result<Self, TooSmall> {
        let Memory { conditional, marginal, lights } = memory;
        buffer::check(&conditional, grid.len())?;
        buffer::check(&marginal, grid.height)?;
        Ok(Self { conditional, marginal, lights, count: 0 })
    }

    /// Returns the largest number of lights: the length of [`Memory::lights`].
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.lights.as_ref().len()
    }

    /// Computes the cumulative distributions of `map`; returns the luminance energy of the map.
    fn distribute(&mut self, map: &LatLongView<'_>) -> f64 {
        let width = map.grid.width;
        let rows = map
            .texels
            .chunks_exact(width.max(1))
            .zip(self.conditional.as_mut().chunks_exact_mut(width.max(1)));
        let mut total = 0.0;
        for ((texels, row), end) in rows.zip(self.marginal.as_mut()) {
            let mut sum = 0.0;
            for (k, upper) in row.iter_mut().enumerate() {
                sum += light_of(texels[column(width, k)]);
                *upper = sum as f32;
            }
            total += sum;
            *end = total;
        }
        total
    }

    /// Returns the point of the distribution at (`u`, `v`) of the unit square, by inversion of the cumulative distributions.
    fn sample(&self, map: &LatLongView<'_>, total: f64, [u, v]: [f64; 2]) -> Sample {
        let (width, height) = (map.grid.width, map.grid.height);
        let marginal = &self.marginal.as_ref()[..height];
        let target = u.min(BELOW_ONE) * total;
        let row = marginal.partition_point(|end| *end <= target).min(marginal.len() - 1);
        let start = if row == 0 { 0.0 } else { marginal[row - 1] };
        let within = (target - start) / (marginal[row] - start);

        let conditional = &self.conditional.as_ref()[row * width..(row + 1) * width];
        let last = conditional[width - 1];
        let target = (v.min(BELOW_ONE) * f64::from(last)) as f32;
        // A target that is rounded up to the end of the row, as subnormal numbers are, belongs to the last texel that is not dark.
        let k = conditional.partition_point(|end| *end <= target && *end < last).min(width - 1);
        let start = if k == 0 { 0.0 } else { conditional[k - 1] };
        let across = f64::from((target - start) / (conditional[k] - start));

        let cos = |i: usize| libm::cos(map.grid.theta(i));
        let z = cos(row) + within.clamp(0.0, 1.0) * (cos(row + 1) - cos(row));
        let phi = seam(width) - (k as f64 + across.clamp(0.0, 1.0)) * TAU / width as f64;
        let sin = libm::sqrt((1.0 - z * z).max(0.0));
        let direction = DVec3::new(sin * libm::cos(phi), sin * libm::sin(phi), z);
        let rgb = sound(map.texels[row * width + column(width, k)]);
        Sample { direction, rgb, solid_angle: map.grid.solid_angle(row) }
    }
}

/// A point drawn from the distribution of a map.
struct Sample {
    direction: DVec3,
    /// Energy of the texel at the point.
    rgb: [f32; 3],
    /// Solid angle of the texel at the point, steradians.
    solid_angle: f64,
}

/// Returns the luminance energy of a texel; 0 for negative or non-finite energy.
fn light_of(rgb: [f32; 3]) -> f64 {
    f64::from(luminance(sound(rgb)))
}

/// Returns the map column at position `k`, counted from phi = 0 in the column order of the map; the distribution starts at phi = 0, as in
/// \[Nikodym2012\].
fn column(width: usize, k: usize) -> usize {
    (width / 2 + k) % width
}

/// Returns the azimuth, radians, at which the count of columns starts: 0, or half a column off 0 if the number of columns is odd.
fn seam(width: usize) -> f64 {
    if width.is_multiple_of(2) { 0.0 } else { TAU / width as f64 / 2.0 }
}

impl<C: Buffer<f32>, M: Buffer<f64>, L: Buffer<Light>> Sampler for Pharr<C, M, L> {
    fn kind(&self) -> SamplerKind {
        SamplerKind::Pharr
    }

    fn needs_polar(&self) -> bool {
        true
    }

    fn update_timed(&mut self, map: &Map<'_>, request: &Request, _: &mut Timer<'_>) -> Decomposition<'_> {
        let texels = map.polar.texels.len();
        let fits = texels == map.polar.grid.len()
            && texels <= self.conditional.as_ref().len()
            && map.polar.grid.height <= self.marginal.as_ref().len();
        let total = if fits { self.distribute(&map.polar) } else { 0.0 };
        let count = if total > 0.0 { request.lights.min(self.capacity()) } else { 0 };
        let each = total / count.max(1) as f64;
        for i in 0..count {
            let Sample { direction, rgb, solid_angle } =
                self.sample(&map.polar, total, halton::point(i as u32 + 1));
            let y = light_of(rgb);
            // The cap has the solid angle that the light represents, 1 / (N pdf).
            let cap = solid_angle * each / y;
            let radius_deg = libm::acos((1.0 - cap / TAU).clamp(-1.0, 1.0)).to_degrees() as f32;
            let light = &mut self.lights.as_mut()[i];
            let age = if i < self.count { light.age.saturating_add(1) } else { 0 };
            let irradiance = rgb.map(|c| (f64::from(c) * each / y) as f32);
            let direction = direction.as_vec3();
            *light = Light { id: i as u32 + 1, direction, irradiance, radius_deg, age, parent: None };
        }
        self.count = count;
        Decomposition::of_lights(&self.lights.as_ref()[..count])
    }

    fn reset(&mut self) {
        self.count = 0;
    }
}
