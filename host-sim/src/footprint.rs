//! The texels of an environment map that the pixels of a lens see.

use crate::env::EnvMap;
use glam::{DVec2, DVec3};
use hemilux::recorded::LensFile;
use std::f64::consts::{PI, TAU};

/// Returns the positions of the pixels of a lens's image, row by row.
pub(crate) fn pixels(lens: &LensFile) -> impl Iterator<Item = DVec2> {
    let [width, height] = lens.size;
    (0..height).flat_map(move |row| (0..width).map(move |column| DVec2::new(column.into(), row.into())))
}

/// Returns the mean image-side radiance over the footprint of one pixel; `None` outside of the image circle.
pub(crate) fn mean(env: &EnvMap, lens: &LensFile, pixel: DVec2) -> Option<[f64; 3]> {
    let mut sum = [0.0; 3];
    let count = visit([env.width(), env.height()], lens, pixel, |texel, light| {
        for (s, v) in sum.iter_mut().zip(env.texels()[texel]) {
            *s += f64::from(v) * light;
        }
    })?;
    Some(sum.map(|s| s / count))
}

/// Calls `visit` with the texel and the illumination fall-off of the lens for each of the points of a pixel inside of the image circle. Returns the
/// number of these points, at least 1; `None` outside of the image circle.
fn visit(size: [usize; 2], lens: &LensFile, pixel: DVec2, mut visit: impl FnMut(usize, f64)) -> Option<f64> {
    lens.lens.unproject(pixel)?;
    let n = points(size[1], lens);
    let mut count = 0;
    for i in 0..n * n {
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(n) - 0.5;
        let Some(direction) = lens.lens.unproject(pixel + DVec2::new(at(i % n), at(i / n))) else { continue };
        visit(texel(size, direction), lens.lens.illumination(direction.z.clamp(-1.0, 1.0).acos()));
        count += 1;
    }
    Some(f64::from(count.max(1)))
}

/// Returns the number of points along each side of a pixel for a map of `height` rows.
fn points(height: usize, lens: &LensFile) -> u32 {
    let texel = PI / height as f64;
    let pixel = 1.0 / lens.lens.intrinsics().focal_px.min_element();
    ((3.0 * pixel / texel).ceil() as u32).clamp(4, 32)
}

/// Returns the index of the texel that contains `direction`.
fn texel([width, height]: [usize; 2], direction: DVec3) -> usize {
    let theta = direction.z.clamp(-1.0, 1.0).acos();
    let phi = direction.y.atan2(direction.x);
    let row = ((theta / PI * height as f64) as usize).min(height - 1);
    let column = (((PI - phi) / TAU * width as f64) as usize).min(width - 1);
    row * width + column
}

/// The texels that each pixel of a lens sees in maps of one size, for many exposures of such maps.
#[derive(Clone, Debug)]
pub(crate) struct Footprints(Vec<Option<Vec<TexelShare>>>);

/// A texel in the footprint of a pixel.
#[derive(Clone, Copy, Debug)]
struct TexelShare {
    texel: usize,
    /// Factor of the texel's radiance in the image-side radiance of the pixel.
    share: f64,
}

impl Footprints {
    /// Computes the texels of each pixel in maps of `size` columns and rows.
    pub(crate) fn new(size: [usize; 2], lens: &LensFile) -> Self {
        let shares = |pixel| {
            let mut shares: Vec<TexelShare> = Vec::new();
            let count = visit(size, lens, pixel, |texel, share| {
                match shares.iter_mut().find(|known| known.texel == texel) {
                    Some(known) => known.share += share,
                    None => shares.push(TexelShare { texel, share }),
                }
            })?;
            shares.iter_mut().for_each(|own| own.share /= count);
            Some(shares)
        };
        Self(pixels(lens).map(shares).collect())
    }

    /// Returns the mean image-side radiance of `map` over the footprint of every pixel; `None` outside of the image circle.
    pub(crate) fn radiance<'a>(&'a self, map: &'a EnvMap) -> impl Iterator<Item = Option<[f64; 3]>> + 'a {
        let mean = |shares: &Vec<TexelShare>| {
            shares.iter().fold([0.0; 3], |mut sum, own| {
                sum.iter_mut().zip(map.texels()[own.texel]).for_each(|(s, v)| *s += f64::from(v) * own.share);
                sum
            })
        };
        self.0.iter().map(move |shares| shares.as_ref().map(mean))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::stage::room;

    #[test]
    fn stored_footprints_give_the_exposure_of_a_map() {
        let text = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [96, 80]\ncentre = [47.5, 39.5]\nfocal = [30.0, 30.0]\nmax_angle_deg = 85.0\n";
        let lens = hemilux::recorded::parse_lens(std::path::Path::new("lens.toml"), text).expect("a lens");
        let map = EnvMap::from_fn(64, 32, room);
        let footprints = Footprints::new([64, 32], &lens);
        let expected: Vec<_> = pixels(&lens).map(|pixel| mean(&map, &lens, pixel)).collect();
        assert_eq!(expected.len(), 96 * 80);
        for (pixel, (found, expected)) in footprints.radiance(&map).zip(expected).enumerate() {
            assert_eq!(found.is_some(), expected.is_some(), "pixel {pixel}");
            for (found, expected) in found.into_iter().flatten().zip(expected.into_iter().flatten()) {
                assert!((found - expected).abs() <= 1e-12 * expected, "pixel {pixel}: {found}, {expected}");
            }
        }
    }
}
