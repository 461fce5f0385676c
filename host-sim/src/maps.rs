//! Inputs of samplers, computed from environment maps: a HEALPix pyramid and a latitude-longitude map, both with the energy of the environment map.

use crate::env::EnvMap;
use crate::metrics::{TexelGrid, luminance};
use hemilux::samplers::{self, Shape};
use hemilux_core::Order;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::polar::{Grid, LatLong};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::sampler::Map;
use std::f64::consts::PI;

/// HEALPix pyramid and latitude-longitude map with the energy of one environment map.
pub struct Maps {
    pyramid: Pyramid<Vec<Quad>>,
    polar: LatLong<Vec<[f32; 3]>>,
    plan: Option<TexelQuads>,
}

/// Returns the grid of the latitude-longitude map that samplers read: the columns of `env`, and its rows or their upper half by `domain`.
#[must_use]
pub fn grid(env: &EnvMap, domain: Domain) -> Grid {
    let rows = match domain {
        Domain::Sphere => env.height(),
        Domain::Hemisphere => env.height().div_ceil(2),
    };
    Grid { width: env.width(), height: rows, domain }
}

/// Returns the texels of `env` that a map with the grid `map` covers, row by row; `None` if the two grids differ in width or rows.
#[must_use]
pub fn radiance(env: &EnvMap, map: Grid) -> Option<&[[f32; 3]]> {
    let rows = match map.domain {
        Domain::Sphere => map.height,
        Domain::Hemisphere => 2 * map.height,
    };
    if (env.width(), env.height()) == (map.width, rows) { env.texels().get(..map.len()) } else { None }
}

impl Maps {
    /// Creates black maps: a pyramid of the HEALPix order `order`, limited to the legal orders, and a latitude-longitude map of `grid`.
    #[must_use]
    pub fn new(domain: Domain, order: u8, grid: Grid) -> Self {
        let quads = vec![Quad::default(); pyramid_len(domain, Order::saturating(order))];
        let pyramid = Pyramid::try_new(quads, domain, Order::saturating(order))
            .expect("the quads have the length that pyramid_len returns");
        let polar =
            LatLong::try_new(grid, vec![[0.0; 3]; grid.len()]).expect("the texels have the grid's length");
        Self { pyramid, polar, plan: None }
    }

    /// Fills the pyramid and the latitude-longitude map with the energy of `env`. The pyramid's quad at a texel's centre receives the whole
    /// energy of the texel; the scores place the energy of a texel at its centre too.
    pub fn fill(&mut self, env: &EnvMap) {
        let view = self.pyramid.view();
        let plan = match self.plan.take() {
            Some(plan) if plan.grid.fits(env) => plan,
            _ => TexelQuads::new(env, view.domain(), view.order().get()),
        };
        let mut sums = vec![[0.0f64; 6]; view.domain().quads(view.order().get())];
        for ((direction, rgb), ipix) in plan.grid.fluxes(env).zip(&plan.quads) {
            let y = luminance(rgb);
            let light = [rgb, direction.map(|v| v * y)];
            sums[*ipix as usize].iter_mut().zip(light.as_flattened()).for_each(|(s, v)| *s += v);
        }
        for (quad, s) in self.pyramid.texels_mut().iter_mut().zip(&sums) {
            let s = s.map(|v| v as f32);
            let y = hemilux_core::color::luminance([s[0], s[1], s[2]]);
            *quad = Quad { energy: [s[0], s[1], s[2], y], moment: [s[3], s[4], s[5], 0.0] };
        }
        self.pyramid.build();
        self.plan = Some(plan);
        resample(env, &mut self.polar);
    }

    /// Returns views of the pyramid and of the latitude-longitude map.
    #[must_use]
    pub fn view(&self) -> Map<'_> {
        Map { pyramid: self.pyramid.view(), polar: self.polar.view() }
    }

    /// Fills each quad and texel with `radiance` at its centre times its solid angle. The quadrature has one point per quad or texel, for
    /// benchmarks.
    pub fn fill_at_centres(&mut self, radiance: impl Fn([f64; 3]) -> [f32; 3]) {
        let order = self.pyramid.view().order().get();
        let sr = healpix::solid_angle(order) as f32;
        for (ipix, quad) in self.pyramid.texels_mut().iter_mut().enumerate() {
            let centre = healpix::centre(order, ipix as u32);
            *quad = Quad::from_light(radiance(centre.to_array()).map(|v| v * sr), centre.as_vec3());
        }
        self.pyramid.build();
        let grid = self.polar.grid();
        let direction = |k: usize| {
            let theta = (grid.theta(k / grid.width) + grid.theta(k / grid.width + 1)) / 2.0;
            let phi = grid.phi(k % grid.width) - PI / grid.width as f64;
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
        };
        for (k, texel) in self.polar.texels_mut().iter_mut().enumerate() {
            *texel = radiance(direction(k)).map(|v| v * grid.solid_angle(k / grid.width) as f32);
        }
    }
}

/// One [`Maps`] for each HEALPix order that samplers of the requested numbers of lights read.
pub struct OrderedMaps {
    /// Shape and maps of each HEALPix order, one entry per order.
    all: Vec<(Shape, Maps)>,
}

impl OrderedMaps {
    /// Creates black maps of the size of `env` for samplers with `counts` lights.
    #[must_use]
    pub fn new(env: &EnvMap, domain: Domain, counts: &[usize]) -> Self {
        let mut orders: Vec<u8> = counts.iter().map(|&lights| samplers::order_for(lights)).collect();
        orders.sort_unstable();
        orders.dedup();
        let grid = grid(env, domain);
        let made = orders.into_iter().map(|order| Shape { domain, order, grid });
        Self { all: made.map(|shape| (shape, Maps::new(domain, shape.order, grid))).collect() }
    }

    /// Fills the maps of all orders with the energy of `env`.
    pub fn fill(&mut self, env: &EnvMap) {
        self.all.iter_mut().for_each(|(_, maps)| maps.fill(env));
    }

    /// Returns the shape and the maps for a sampler of `lights` lights.
    ///
    /// # Panics
    /// If no entry of `counts` in [`OrderedMaps::new`] has the HEALPix order of `lights` lights.
    #[must_use]
    pub fn of(&self, lights: usize) -> (&Shape, Map<'_>) {
        let order = samplers::order_for(lights);
        let of = self.all.iter().find(|(shape, _)| shape.order == order);
        let (shape, maps) = of.expect("the number of lights has an order of OrderedMaps::new");
        (shape, maps.view())
    }
}

/// Index of the HEALPix quad at each texel's centre, for environment maps of one size; computed once for a sequence.
struct TexelQuads {
    grid: TexelGrid,
    quads: Vec<u32>,
}

impl TexelQuads {
    fn new(env: &EnvMap, domain: Domain, order: u8) -> Self {
        let grid = TexelGrid::new(env, domain);
        let quads = grid.directions().map(|d| healpix::ipix(order, d.into())).collect();
        Self { grid, quads }
    }
}

/// Overlap of a source cell and a target cell along one axis of a map.
struct Overlap {
    from: usize,
    to: usize,
    /// Width of the overlap divided by the width of the source cell, 0 to 1.
    share: f64,
}

/// Returns the overlaps of the cells between the edges `from` with the cells between the edges `to`.
fn overlaps(from: &[f64], to: &[f64]) -> Vec<Overlap> {
    let mut shares = Vec::new();
    let mut first = 0;
    for (i, source) in from.windows(2).enumerate() {
        let width = source[1] - source[0];
        // The edges in both lists ascend: later source cells do not overlap the target cells that end before this source cell.
        first += to[first..].windows(2).take_while(|target| target[1] <= source[0]).count();
        let near = to.windows(2).enumerate().skip(first).take_while(|(_, target)| target[0] < source[1]);
        for (j, target) in near {
            let common = source[1].min(target[1]) - source[0].max(target[0]);
            if common > 1e-12 * width && width > 0.0 {
                shares.push(Overlap { from: i, to: j, share: common / width });
            }
        }
    }
    shares
}

/// Fills a latitude-longitude map of energy from a map of radiance; the energy of each source texel is distributed by overlap along both
/// axes.
fn resample(env: &EnvMap, polar: &mut LatLong<Vec<[f32; 3]>>) {
    let grid = polar.grid();
    // Edges along -cos(theta), where equal steps are equal solid angles.
    let rows_from: Vec<f64> =
        (0..=env.height()).map(|i| -(i as f64 * PI / env.height() as f64).cos()).collect();
    let rows_to: Vec<f64> = (0..=grid.height).map(|i| -grid.theta(i).cos()).collect();
    let steps = |n: usize| (0..=n).map(|j| j as f64 / n as f64).collect::<Vec<_>>();
    let (columns_from, columns_to) = (steps(env.width()), steps(grid.width));
    let columns = overlaps(&columns_from, &columns_to);
    if (env.width(), env.height()) == (grid.width, grid.height) && grid.domain == Domain::Sphere {
        // With equal grids, the energy of a texel is its radiance times its solid angle.
        for (k, (texel, rgb)) in polar.texels_mut().iter_mut().zip(env.texels()).enumerate() {
            *texel = rgb.map(|v| (f64::from(v) * env.solid_angle(k / grid.width)) as f32);
        }
        return;
    }
    let mut sums = vec![[0.0f64; 3]; grid.len()];
    for row in overlaps(&rows_from, &rows_to) {
        let omega = env.solid_angle(row.from) * row.share;
        for column in &columns {
            let rgb = env.texels()[row.from * env.width() + column.from];
            for (s, v) in sums[row.to * grid.width + column.to].iter_mut().zip(rgb) {
                *s += f64::from(v) * omega * column.share;
            }
        }
    }
    for (texel, sum) in polar.texels_mut().iter_mut().zip(sums) {
        *texel = sum.map(|v| v as f32);
    }
}

/// Returns `env` resampled to `width` columns and half as many rows; the energy is preserved.
#[must_use]
pub fn resized(env: &EnvMap, width: usize) -> EnvMap {
    let grid = Grid { width, height: width.div_ceil(2), domain: Domain::Sphere };
    let mut energy =
        LatLong::try_new(grid, vec![[0.0; 3]; grid.len()]).expect("the texels have the grid's length");
    resample(env, &mut energy);
    let texels = energy.texels_mut().iter().enumerate();
    let radiance = texels.map(|(k, rgb)| rgb.map(|v| (f64::from(v) / grid.solid_angle(k / width)) as f32));
    EnvMap::new(width, grid.height, radiance.collect())
}
