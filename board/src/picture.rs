//! Pictures of a radiance map: tone-mapped, with the lights drawn on it.

use hemilux_core::color::luminance;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::tonemap;
use image::{Rgb, RgbImage};

/// Least width of a picture of a map, pixels: smaller maps are enlarged by integer factors.
const LEAST_WIDTH: usize = 720;

/// Draws the tone-mapped map with a ring round each light: the size of the ring grows with the light's energy, the disc in it has the
/// light's colour.
#[must_use]
pub fn draw(map: &LatLongView<'_>, lights: &[Light]) -> RgbImage {
    let grid = map.grid;
    let factor = LEAST_WIDTH.div_ceil(grid.width.max(1)).max(1);
    let adaptation = log_average(map);
    let texel = |x: u32, y: u32| {
        let (row, column) = (y as usize / factor, x as usize / factor);
        let omega = grid.solid_angle(row) as f32;
        Rgb(tonemap::sigmoid(map.texels[row * grid.width + column].map(|v| v / omega), adaptation))
    };
    let mut picture = RgbImage::from_fn((grid.width * factor) as u32, (grid.height * factor) as u32, texel);
    let brightest = lights.iter().map(|l| luminance(l.irradiance)).fold(0.0, f32::max);
    for light in lights {
        mark(&mut picture, &grid, factor, light, brightest);
    }
    picture
}

/// Returns the geometric mean of the radiance of the texels above zero, which the tone mapping displays as mid-grey.
fn log_average(map: &LatLongView<'_>) -> f32 {
    let rows = map.texels.chunks(map.grid.width.max(1)).enumerate();
    let radiances = rows.flat_map(|(row, texels)| {
        let omega = map.grid.solid_angle(row) as f32;
        texels.iter().map(move |rgb| luminance(*rgb) / omega)
    });
    let (sum, count) = radiances
        .filter(|y| *y > 0.0)
        .fold((0.0f64, 0usize), |(sum, count), y| (sum + f64::from(y.ln()), count + 1));
    if count == 0 { 1.0 } else { (sum / count as f64).exp() as f32 }
}

/// Draws a white ring round a disc of the light's colour, with a dark rim so that it is visible on any background.
fn mark(picture: &mut RgbImage, grid: &Grid, factor: usize, light: &Light, brightest: f32) {
    let Some(texel) = grid.texel(light.direction.as_dvec3()) else { return };
    let y = luminance(light.irradiance);
    let size = (y / brightest.max(f32::MIN_POSITIVE)).sqrt();
    let radius = 2.5 + 6.0 * size;
    let centre = |k: usize| (k * factor + factor / 2) as i64;
    let (cx, cy) = (centre(texel % grid.width), centre(texel / grid.width));
    let top = light.irradiance.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let colour = light.irradiance.map(|v| tonemap::srgb_code(v / top));
    let reach = radius.ceil() as i64 + 2;
    for (dy, dx) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx))) {
        let distance = ((dx * dx + dy * dy) as f32).sqrt();
        let paint = if distance <= radius {
            colour
        } else if distance <= radius + 1.0 {
            [255; 3]
        } else if distance <= radius + 2.0 {
            [0; 3]
        } else {
            continue;
        };
        let x = (cx + dx).rem_euclid(i64::from(picture.width()));
        let y = cy + dy;
        if (0..i64::from(picture.height())).contains(&y) {
            picture.put_pixel(x as u32, y as u32, Rgb(paint));
        }
    }
}
