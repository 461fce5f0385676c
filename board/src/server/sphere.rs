//! The map for programs that show it themselves: radiance, and a mask of what the lens does not see and what is clipped.

use super::Context;
use super::access::Allowed;
use super::develop;
use super::picture_cache::{PictureKind, Rendered};
use super::pictures::{answer, map, view};
use crate::calibration::{Calibration, Frame};
use crate::maps::{Covers, write};
use crate::probe::{BurstView, MapView};
use axum::extract::State;
use axum::response::Response;
use glam::{DVec2, DVec3};
use hemilux_core::polar::Grid;
use image::codecs::hdr::HdrEncoder;
use image::{GrayImage, ImageFormat, Rgb};
use std::f64::consts::PI;
use std::io::Cursor;
use std::sync::Arc;

/// Grey values of the mask.
const UNSEEN: u8 = 0;
const SEEN: u8 = 128;
const CLIPPED: u8 = 255;

/// `/v1/map.hdr`: the whole sphere's radiance, dark below the horizon.
pub(super) async fn map_hdr(State(context): State<Context>, _: Allowed) -> Response {
    map(&context, PictureKind::MapHdr, "image/vnd.radiance", hdr).await
}

/// `/v1/mask.png`: the hemisphere in the map's shape, black where the lens does not see, white where even the shortest exposure clips.
pub(super) async fn mask_png(State(context): State<Context>, _: Allowed) -> Response {
    let link = &context.link;
    let grid = link.settings().applied().borrow().config.pipeline.grid;
    let look = |_| view(link, &link.views().bursts);
    let render = move |view: Arc<BurstView>| {
        let mut bytes = Cursor::new(Vec::new());
        mask(&view, &grid)?.write_to(&mut bytes, ImageFormat::Png).ok()?;
        Some(Rendered { bytes: bytes.into_inner(), frame: view.frame, shot: None })
    };
    answer(&context, context.answers.pictures.picture(PictureKind::Mask, look, render).await, "image/png")
}

fn hdr(view: &MapView) -> Option<Vec<u8>> {
    let grid = view.grid;
    let radiance = |(i, texel): (usize, &[f32; 3])| {
        let omega = grid.solid_angle(i / grid.width.max(1)) as f32;
        Rgb(texel.map(|v| v / omega))
    };
    let mut pixels: Vec<_> = view.texels.iter().enumerate().map(radiance).collect();
    pixels.resize(2 * grid.len(), Rgb([0.0; 3]));
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&pixels, grid.width, 2 * grid.height).ok()?;
    write::state_coverage(&mut bytes, Covers::Sphere);
    Some(bytes)
}

fn mask(view: &BurstView, grid: &Grid) -> Option<GrayImage> {
    let c = &view.calibration;
    let middle = |i: usize| {
        let (row, column) = (i / grid.width, i % grid.width);
        let theta = (grid.theta(row) + grid.theta(row + 1)) / 2.0;
        let phi = PI - (PI - grid.phi(1)) * (column as f64 + 0.5);
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    };
    let mut codes: Vec<_> =
        (0..grid.len()).map(|i| if is_seen(c, middle(i)) { SEEN } else { UNSEEN }).collect();
    let clipped = view.frames.first().map(|shortest| clipped(shortest, c)).unwrap_or_default();
    let texel = |pixel: DVec2| grid.texel(c.lens.unproject(pixel)?);
    clipped.into_iter().filter_map(texel).for_each(|texel| codes[texel] = CLIPPED);
    GrayImage::from_raw(grid.width as u32, grid.height as u32, codes)
}

/// Whether `direction` is imaged on a pixel.
fn is_seen(c: &Calibration, direction: DVec3) -> bool {
    let within = |v: f64, size: u32| (-0.5..f64::from(size) - 0.5).contains(&v);
    c.lens.project(direction).is_some_and(|p| within(p.x, c.layout.width()) && within(p.y, c.layout.height()))
}

/// Pixels of which a channel is at the white level.
fn clipped(frame: &Frame, c: &Calibration) -> Vec<DVec2> {
    let codes = develop::develop(frame, c).unwrap_or_default();
    let (white, width) = (develop::white(c), (c.layout.width() as usize).max(1));
    let full =
        codes.chunks_exact(3).enumerate().filter(|(_, rgb)| rgb.iter().any(|v| f64::from(*v) >= white));
    full.map(|(i, _)| DVec2::new((i % width) as f64, (i / width) as f64)).collect()
}
