//! Environment maps as the samplers read them: HEALPix pyramid and latitude-longitude map, the energy kept.

use crate::env::EnvMap;
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

    /// Cuts every texel into equal parts and gives each part's energy, from its own direction, to the quad that holds it.
    fn fill_pyramid(&mut self, env: &EnvMap) {
        let view = self.pyramid.view();
        let (order, domain) = (view.order(), view.domain());
        let mut sums = vec![[0.0f64; 6]; domain.quads(order)];
        let quad_width = healpix::solid_angle(order).sqrt();
        for row in 0..env.height() {
            let (top, bottom) = edges(env.height(), row, domain);
            if bottom <= top {
                continue;
            }
            let across = (top + bottom).mul_add(0.5, 0.0).sin() * TAU / env.width() as f64;
            let parts = |extent: f64| ((FINENESS * extent / quad_width).ceil() as usize).clamp(1, 64);
            let (m, n) = (parts(bottom - top), parts(across));
            for column in 0..env.width() {
                let rgb = env.texels()[row * env.width() + column];
                for k in 0..m * n {
                    let part = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
                    let z = top.cos() + part(k / n, m) * (bottom.cos() - top.cos());
                    let phi = PI - (column as f64 + part(k % n, n)) * TAU / env.width() as f64;
                    let omega = (top.cos() - bottom.cos()) * TAU / (env.width() * m * n) as f64;
                    deposit(&mut sums, order, z, phi, rgb.map(|v| f64::from(v) * omega));
                }
            }
        }
        for (quad, s) in self.pyramid.texels_mut().iter_mut().zip(&sums) {
            let s = s.map(|v| v as f32);
            let y = hemilux_core::color::luminance([s[0], s[1], s[2]]);
            *quad = Quad { energy: [s[0], s[1], s[2], y], moment: [s[3], s[4], s[5], 0.0] };
        }
        self.pyramid.build();
    }
}

/// Theta of the upper and the lower edge of a map's row, inside the domain.
fn edges(height: usize, row: usize, domain: Domain) -> (f64, f64) {
    let limit = if domain == Domain::Sphere { PI } else { PI / 2.0 };
    let edge = |i: usize| (i as f64 * PI / height as f64).min(limit);
    (edge(row), edge(row + 1))
}

fn deposit(sums: &mut [[f64; 6]], order: u8, z: f64, phi: f64, rgb: [f64; 3]) {
    let sin = (1.0 - z * z).max(0.0).sqrt();
    let direction = glam::DVec3::new(sin * phi.cos(), sin * phi.sin(), z);
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
