//! Renders environment maps through a lens; the energy of every texel in the lens's field is kept.

use crate::maps::{Covers, DecodedMap};
use glam::{DVec2, DVec3};
use hemilux_core::Calibration;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Largest number of samples along the side of a pixel: it resolves texels of a sixth of a pixel, and scaling keeps the energy of smaller
/// texels.
const MOST_SAMPLES: usize = 6;

/// Number of samples in a texel from which on their total solid angle is accurate without scaling.
const MANY: u32 = 16;

/// Texel index of a sample outside of the lens circle or of the map.
const NONE: u32 = u32::MAX;

/// Size of a map and the part of the sphere that it covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SourceShape {
    width: usize,
    height: usize,
    covers: Covers,
}

impl SourceShape {
    fn of(map: &DecodedMap) -> Self {
        Self { width: map.width, height: map.height, covers: map.covers }
    }

    /// Returns the polar angle of the map's lower edge, radians.
    fn lowest(&self) -> f64 {
        match self.covers {
            Covers::Sphere => PI,
            Covers::Hemisphere => FRAC_PI_2,
        }
    }

    /// Returns the index of the map's texel in a unit direction; `None` below a hemisphere.
    fn texel(&self, d: DVec3) -> Option<usize> {
        let row = d.z.clamp(-1.0, 1.0).acos() / self.lowest() * self.height as f64;
        let column = (PI - d.y.atan2(d.x)) / TAU * self.width as f64;
        let row = row as usize;
        (row < self.height).then(|| row * self.width + (column as usize).min(self.width - 1))
    }

    fn direction(&self, texel: usize) -> DVec3 {
        let theta = (((texel / self.width) as f64) + 0.5) * self.lowest() / self.height as f64;
        let phi = PI - (((texel % self.width) as f64) + 0.5) * TAU / self.width as f64;
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    fn solid_angle(&self, row: usize) -> f64 {
        let edge = |i: usize| (i as f64 * self.lowest() / self.height as f64).cos();
        (edge(row) - edge(row + 1)) * TAU / self.width as f64
    }
}

/// Table from the pixels of a camera to the texels of maps of one shape.
pub(super) struct Raster {
    shape: SourceShape,
    /// Number of samples of each pixel.
    samples: usize,
    /// Texel index of each sample, in the order of the pixels.
    texels: Vec<u32>,
    /// Solid angle of each pixel, steradians; 0 outside of the lens circle.
    solid_angles: Vec<f32>,
}

impl Raster {
    /// Creates the table for maps of the shape of `map`.
    pub fn new(map: &DecodedMap, camera: &Calibration) -> Self {
        let (shape, lens) = (SourceShape::of(map), &camera.lens);
        let (width, height) = (camera.layout.width() as usize, camera.layout.height() as usize);
        let texel = shape.lowest() / shape.height as f64;
        let pixel = 1.0 / lens.intrinsics().focal_px.max_element();
        let side = ((pixel / texel).ceil() as usize).clamp(2, MOST_SAMPLES);
        let at = |k: usize| (k as f64 + 0.5) / side as f64 - 0.5;
        let (mut texels, mut solid_angles) = (Vec::new(), Vec::new());
        texels.reserve_exact(width * height * side * side);
        for i in 0..width * height {
            let middle = DVec2::new((i % width) as f64, (i / width) as f64);
            solid_angles.push(lens.solid_angle(middle).unwrap_or(0.0) as f32);
            for k in 0..side * side {
                let seen = lens.unproject(middle + DVec2::new(at(k % side), at(k / side)));
                texels.push(seen.and_then(|d| shape.texel(d)).map_or(NONE, |t| t as u32));
            }
        }
        Self { shape, samples: side * side, texels, solid_angles }
    }

    /// Returns true if `map` has the size and the coverage for which the table was created.
    pub fn fits(&self, map: &DecodedMap) -> bool {
        self.shape == SourceShape::of(map)
    }

    /// Returns the radiance of each pixel of the camera under `map`, three channels per pixel.
    pub fn radiance(&self, map: &DecodedMap, camera: &Calibration) -> Vec<f32> {
        let mut pixels = vec![0.0; 3 * self.solid_angles.len()];
        let scales = self.scales(map.texels.len());
        for (i, pixel) in pixels.chunks_exact_mut(3).enumerate() {
            let part = 1.0 / self.of_pixel(i).count() as f32;
            for texel in self.of_pixel(i) {
                let share = scales[texel] * part;
                pixel.iter_mut().zip(map.texels[texel]).for_each(|(sum, v)| *sum += v * share);
            }
        }
        let missed = (0..scales.len()).filter(|t| scales[*t] == 0.0);
        missed.for_each(|texel| self.add(texel, map, camera, &mut pixels));
        pixels
    }

    /// Returns the texel indices of the samples of a pixel.
    fn of_pixel(&self, pixel: usize) -> impl Iterator<Item = usize> {
        let all = &self.texels[pixel * self.samples..(pixel + 1) * self.samples];
        all.iter().filter(|texel| **texel != NONE).map(|texel| *texel as usize)
    }

    /// Returns, for each of `count` texels, the factor by which its samples together have the texel's energy; 0 for a texel without
    /// samples.
    fn scales(&self, count: usize) -> Vec<f32> {
        let mut hits = vec![(0u32, 0.0f32); count];
        for (i, omega) in self.solid_angles.iter().enumerate() {
            let part = omega / self.of_pixel(i).count() as f32;
            for texel in self.of_pixel(i) {
                let (hits, sum) = &mut hits[texel];
                *hits += 1;
                *sum += part;
            }
        }
        let scale = |(i, (hits, sum)): (usize, &(u32, f32))| match *hits {
            0 => 0.0,
            1..MANY if *sum > 0.0 => self.shape.solid_angle(i / self.shape.width) as f32 / sum,
            _ => 1.0,
        };
        hits.iter().enumerate().map(scale).collect()
    }

    /// Adds the energy of a texel that contains no sample to the pixel at which the texel's centre is imaged.
    fn add(&self, texel: usize, map: &DecodedMap, camera: &Calibration, pixels: &mut [f32]) {
        let Some(at) = camera.lens.project(self.shape.direction(texel)).map(DVec2::round) else { return };
        let (width, height) = (f64::from(camera.layout.width()), f64::from(camera.layout.height()));
        if !((0.0..width).contains(&at.x) && (0.0..height).contains(&at.y)) {
            return;
        }
        let pixel = at.y as usize * camera.layout.width() as usize + at.x as usize;
        let omega = self.solid_angles[pixel];
        if omega > 0.0 {
            let share = self.shape.solid_angle(texel / self.shape.width) as f32 / omega;
            let sums = pixels[3 * pixel..3 * pixel + 3].iter_mut();
            sums.zip(map.texels[texel]).for_each(|(sum, v)| *sum += v * share);
        }
    }
}
