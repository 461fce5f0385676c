//! Environment maps as the samplers read them: HEALPix pyramid and latitude-longitude map, the energy kept.

use crate::env::EnvMap;
use glam::DVec3;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::polar::{Grid, LatLong};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::sampler::Map;
use hemilux_core::sampler::pharr::MAX_ROWS;
use std::f64::consts::{PI, TAU};

/// Sub-samples a side per HEALPix texel's width, so that each texel's share of a map texel is right within a few per cent.
const FINENESS: f64 = 6.0;

/// Pyramid and latitude-longitude map of one environment map.
pub struct Maps {
    pyramid: Pyramid<Vec<Quad>>,
    polar: LatLong<Vec<[f32; 3]>>,
}

/// The latitude-longitude map that samplers read for environment maps like `env`.
#[must_use]
pub fn grid(env: &EnvMap, domain: Domain) -> Grid {
    let rows = match domain {
        Domain::Sphere => env.height(),
        Domain::Hemisphere => env.height().div_ceil(2),
    };
    Grid { width: env.width(), height: rows.min(MAX_ROWS), domain }
}

impl Maps {
    /// Makes dark maps.
    #[must_use]
    pub fn new(domain: Domain, order: u8, grid: Grid) -> Self {
        let quads = vec![Quad::default(); pyramid_len(domain, order)];
        let pyramid = Pyramid::try_new(quads, domain, order).expect("as many quads as the pyramid names");
        let polar =
            LatLong::try_new(grid, vec![[0.0; 3]; grid.len()]).expect("as many texels as the grid has");
        Self { pyramid, polar }
    }

    /// Takes the light of `env`.
    pub fn fill(&mut self, env: &EnvMap) {
        self.fill_pyramid(env);
        resample(env, &mut self.polar);
    }

    /// What samplers read.
    #[must_use]
    pub fn view(&self) -> Map<'_> {
        Map { pyramid: self.pyramid.view(), polar: self.polar.view() }
    }

    /// Takes the light of `env`, whose shape is that of `plan`.
    ///
    /// # Panics
    /// If the plan was made for maps of another shape.
    pub fn fill_by(&mut self, plan: &Plan, env: &EnvMap) {
        assert_eq!(plan.size, (env.width(), env.height()), "the plan is for maps of another size");
        let view = self.pyramid.view();
        assert_eq!((plan.domain, plan.order), (view.domain(), view.order()), "the plan is for other maps");
        let mut sums = vec![[0.0f64; 6]; view.domain().quads(view.order())];
        for (rgb, share) in plan.shares.iter().map(|s| (env.texels()[s.texel as usize], s)) {
            let [r, g, b] = rgb.map(f64::from);
            let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            let [x, y_axis, z] = share.moment.map(|m| y * m);
            let light = [r * share.sr, g * share.sr, b * share.sr, x, y_axis, z];
            sums[share.ipix as usize].iter_mut().zip(light).for_each(|(s, v)| *s += v);
        }
        self.store(&sums);
        resample(env, &mut self.polar);
    }

    /// Takes each quad's and each texel's radiance at its centre: quick, for work that only has to be done, not judged.
    pub fn fill_at_centres(&mut self, radiance: impl Fn([f64; 3]) -> [f32; 3]) {
        let order = self.pyramid.view().order();
        let sr = healpix::solid_angle(order) as f32;
        for (ipix, quad) in self.pyramid.texels_mut().iter_mut().enumerate() {
            let centre = healpix::centre(order, ipix as u32);
            *quad = Quad::from_light(radiance(centre.to_array()).map(|v| v * sr), centre.as_vec3());
        }
        self.pyramid.build();
        let grid = self.polar.grid;
        let direction = |k: usize| {
            let theta = (grid.theta(k / grid.width) + grid.theta(k / grid.width + 1)) / 2.0;
            let phi = grid.phi(k % grid.width) - PI / grid.width as f64;
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
        };
        for (k, texel) in self.polar.texels_mut().iter_mut().enumerate() {
            *texel = radiance(direction(k)).map(|v| v * grid.solid_angle(k / grid.width) as f32);
        }
    }

    fn fill_pyramid(&mut self, env: &EnvMap) {
        let view = self.pyramid.view();
        let (order, domain) = (view.order(), view.domain());
        let mut sums = vec![[0.0f64; 6]; domain.quads(order)];
        cut((env.width(), env.height()), domain, order, |texel, direction, sr| {
            let rgb = env.texels()[texel].map(|v| f64::from(v) * sr);
            deposit(&mut sums, order, direction, rgb);
        });
        self.store(&sums);
    }

    fn store(&mut self, sums: &[[f64; 6]]) {
        for (quad, s) in self.pyramid.texels_mut().iter_mut().zip(sums) {
            let s = s.map(|v| v as f32);
            let y = hemilux_core::color::luminance([s[0], s[1], s[2]]);
            *quad = Quad { energy: [s[0], s[1], s[2], y], moment: [s[3], s[4], s[5], 0.0] };
        }
        self.pyramid.build();
    }
}

/// Which texel gives how much to which quad: worked out once for the maps of a sequence.
#[derive(Clone, Debug)]
pub struct Plan {
    size: (usize, usize),
    domain: Domain,
    order: u8,
    shares: Vec<Share>,
}

/// The common part of a texel and a quad.
#[derive(Clone, Copy, Debug)]
struct Share {
    texel: u32,
    ipix: u32,
    /// Its solid angle.
    sr: f64,
    /// Integral of the direction over it.
    moment: [f64; 3],
}

impl Plan {
    /// For maps of `width` x `height` texels.
    #[must_use]
    pub fn new((width, height): (usize, usize), domain: Domain, order: u8) -> Self {
        let mut shares: Vec<Share> = Vec::new();
        let mut first = 0;
        cut((width, height), domain, order, |texel, direction, sr| {
            let (texel, ipix) = (texel as u32, healpix::ipix(order, direction));
            if shares.get(first).is_none_or(|share| share.texel != texel) {
                first = shares.len();
            }
            let part = direction * sr;
            match shares[first..].iter_mut().find(|share| share.ipix == ipix) {
                Some(share) => {
                    share.sr += sr;
                    share.moment.iter_mut().zip(part.to_array()).for_each(|(m, v)| *m += v);
                }
                None => shares.push(Share { texel, ipix, sr, moment: part.to_array() }),
            }
        });
        Self { size: (width, height), domain, order, shares }
    }
}

/// Cuts every texel into equal parts and calls `part(texel, direction, steradians)` for each, texel by texel.
fn cut((width, height): (usize, usize), domain: Domain, order: u8, mut part: impl FnMut(usize, DVec3, f64)) {
    let quad_width = healpix::solid_angle(order).sqrt();
    for row in 0..height {
        let (top, bottom) = edges(height, row, domain);
        if bottom <= top {
            continue;
        }
        let across = ((top + bottom) * 0.5).sin() * TAU / width as f64;
        let parts = |extent: f64| ((FINENESS * extent / quad_width).ceil() as usize).clamp(1, 64);
        let (m, n) = (parts(bottom - top), parts(across));
        let sr = (top.cos() - bottom.cos()) * TAU / (width * m * n) as f64;
        for column in 0..width {
            for k in 0..m * n {
                let share = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
                let z = top.cos() + share(k / n, m) * (bottom.cos() - top.cos());
                let phi = PI - (column as f64 + share(k % n, n)) * TAU / width as f64;
                let sin = (1.0 - z * z).max(0.0).sqrt();
                part(row * width + column, DVec3::new(sin * phi.cos(), sin * phi.sin(), z), sr);
            }
        }
    }
}

/// Theta of the upper and the lower edge of a map's row, inside the domain.
fn edges(height: usize, row: usize, domain: Domain) -> (f64, f64) {
    let limit = if domain == Domain::Sphere { PI } else { PI / 2.0 };
    let edge = |i: usize| (i as f64 * PI / height as f64).min(limit);
    (edge(row), edge(row + 1))
}

fn deposit(sums: &mut [[f64; 6]], order: u8, direction: DVec3, rgb: [f64; 3]) {
    let y = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    let sum = &mut sums[healpix::ipix(order, direction) as usize];
    for (s, v) in
        sum.iter_mut().zip([rgb[0], rgb[1], rgb[2], y * direction.x, y * direction.y, y * direction.z])
    {
        *s += v;
    }
}

/// Shares of an axis' cells: (from, to, part of the source cell).
fn overlaps(from: &[f64], to: &[f64]) -> Vec<(usize, usize, f64)> {
    let mut shares = Vec::new();
    for (i, source) in from.windows(2).enumerate() {
        let width = source[1] - source[0];
        for (j, target) in to.windows(2).enumerate() {
            let common = source[1].min(target[1]) - source[0].max(target[0]);
            if common > 1e-12 * width && width > 0.0 {
                shares.push((i, j, common / width));
            }
        }
    }
    shares
}

/// Fills a latitude-longitude map of energy from one of radiance, both axes by overlap.
fn resample(env: &EnvMap, polar: &mut LatLong<Vec<[f32; 3]>>) {
    let grid = polar.grid;
    // Along -cos(theta), where equal steps are equal solid angles.
    let rows_from: Vec<f64> =
        (0..=env.height()).map(|i| -(i as f64 * PI / env.height() as f64).cos()).collect();
    let rows_to: Vec<f64> = (0..=grid.height).map(|i| -grid.theta(i).cos()).collect();
    let steps = |n: usize| (0..=n).map(|j| j as f64 / n as f64).collect::<Vec<_>>();
    let (columns_from, columns_to) = (steps(env.width()), steps(grid.width));
    let columns = overlaps(&columns_from, &columns_to);
    let mut sums = vec![[0.0f64; 3]; grid.len()];
    for (i, to_row, part) in overlaps(&rows_from, &rows_to) {
        let omega = env.solid_angle(i) * part;
        for &(j, to_column, share) in &columns {
            let rgb = env.texels()[i * env.width() + j];
            for (s, v) in sums[to_row * grid.width + to_column].iter_mut().zip(rgb) {
                *s += f64::from(v) * omega * share;
            }
        }
    }
    for (texel, sum) in polar.texels_mut().iter_mut().zip(sums) {
        *texel = sum.map(|v| v as f32);
    }
}

/// The map with `width` columns and half as many rows that has the same energy everywhere.
#[must_use]
pub fn resized(env: &EnvMap, width: usize) -> EnvMap {
    let grid = Grid { width, height: width.div_ceil(2), domain: Domain::Sphere };
    let mut energy =
        LatLong::try_new(grid, vec![[0.0; 3]; grid.len()]).expect("as many texels as the grid has");
    resample(env, &mut energy);
    let texels = energy.texels_mut().iter().enumerate();
    let radiance = texels.map(|(k, rgb)| rgb.map(|v| (f64::from(v) / grid.solid_angle(k / width)) as f32));
    EnvMap::new(width, grid.height, radiance.collect())
}
