//! Differential rendering [Debevec1998]: inserts the objects of the scene into a photograph.
//!
//! Pixels of objects show the rendering; to the other pixels of the photograph the difference between the renderings with and without objects is
//! added. Since the albedo of the photograph's ground is unknown, the renderings are scaled so that the empty ground has the photograph's mean
//! luminance.

use super::picture;
use super::scene::{PinholeCamera, Scene};
use super::shade::{self, Directional};
use crate::error::SimError;
use crate::metrics::luminance;
use crate::progress;
use image::RgbImage;
use std::path::Path;

/// Largest side of the composite, pixels; larger photographs are reduced to it.
const LARGEST: u32 = 1600;
/// Largest accepted side of a photograph, pixels.
const LIMIT: u32 = 20_000;

/// Reads the photograph `path`; a photograph with a side of more than 1,600 pixels is reduced.
///
/// # Errors
/// [`SimError`] with the path if the photograph cannot be read or is too large.
pub fn read(path: &Path) -> Result<RgbImage, SimError> {
    let refused = |e: &dyn std::fmt::Display| {
        let line = e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        SimError::at(path, line, "a PNG or JPEG photograph")
    };
    let mut reader = image::ImageReader::open(path)
        .and_then(image::ImageReader::with_guessed_format)
        .map_err(|e| refused(&e))?;
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(LIMIT), Some(LIMIT));
    reader.limits(limits);
    let photo = reader.decode().map_err(|e| refused(&e))?;
    let photo =
        if photo.width().max(photo.height()) > LARGEST { photo.thumbnail(LARGEST, LARGEST) } else { photo };
    Ok(photo.into_rgb8())
}

/// One pixel of the renderings with and without objects.
struct CompositePixel {
    with: [f64; 3],
    without: [f64; 3],
    /// Whether the pixel of the photograph shows an inserted object.
    object: bool,
    /// Whether the pixel shows the ground, or an object in front of the ground.
    ground: bool,
}

/// Returns `photo` with the objects under `lights` inserted.
#[must_use]
pub fn composite(photo: &RgbImage, lights: &[Directional]) -> RgbImage {
    let camera = PinholeCamera::new([photo.width() as usize, photo.height() as usize]);
    let bar = progress::bar("composite", camera.size[1]);
    let rows = progress::on_all_cores(camera.size[1], |row| {
        let pixels: Vec<CompositePixel> =
            (0..camera.size[0]).map(|column| trace(&camera, column, row, lights)).collect();
        bar.inc(1);
        pixels
    });
    bar.finish_and_clear();
    let pixels: Vec<CompositePixel> = rows.into_iter().flatten().collect();
    let linear: Vec<[f64; 3]> = photo.pixels().map(|p| p.0.map(from_srgb)).collect();
    let scale = ground_scale(&pixels, &linear);
    RgbImage::from_fn(photo.width(), photo.height(), |x, y| {
        let k = (y * photo.width() + x) as usize;
        let (p, seen) = (&pixels[k], linear[k]);
        let changed = |i: usize| seen[i] + scale * (p.with[i] - p.without[i]);
        if p.object {
            picture::display(p.with.map(|v| v * scale))
        } else if p.with == p.without {
            *photo.get_pixel(x, y)
        } else {
            picture::display(std::array::from_fn(changed))
        }
    })
}

fn trace(camera: &PinholeCamera, column: usize, row: usize, lights: &[Directional]) -> CompositePixel {
    let ray = camera.ray(column, row);
    let shaded = |scene: &Scene| {
        let hit = scene.hit(&ray)?;
        Some((shade::radiance(scene, &hit, ray.direction, lights), hit.ground))
    };
    let (with, without) = (shaded(&Scene::STANDARD), shaded(&Scene::EMPTY));
    CompositePixel {
        object: with.is_some_and(|(_, ground)| !ground),
        ground: without.is_some(),
        with: with.map_or([0.0; 3], |(rgb, _)| rgb),
        without: without.map_or([0.0; 3], |(rgb, _)| rgb),
    }
}

/// Returns the mean luminance of the photograph on the ground divided by the mean luminance of the rendered empty ground; 1 if the rendered ground
/// is black.
fn ground_scale(pixels: &[CompositePixel], photo: &[[f64; 3]]) -> f64 {
    let ground = || pixels.iter().zip(photo).filter(|(p, _)| p.ground && !p.object);
    let rendered: f64 = ground().map(|(p, _)| luminance(p.without)).sum();
    let seen: f64 = ground().map(|(_, rgb)| luminance(*rgb)).sum();
    if rendered > 0.0 { seen / rendered } else { 1.0 }
}

fn from_srgb(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}
