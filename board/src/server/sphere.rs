//! The map's radiance for programs that display it themselves, and a mask of unseen and clipped directions.

use super::access::Allowed;
use super::develop;
use super::map_form::MapForm;
use super::picture_cache::{PictureKind, Rendered, Told};
use super::pictures::{answer, map, view};
use super::{Context, line};
use crate::calibration::{Calibration, Frame};
use crate::maps::write;
use crate::probe::{BurstView, MapView};
use axum::extract::State;
use axum::http::{StatusCode, Uri};
use axum::response::Response;
use glam::{DVec2, DVec3};
use hemilux_core::color::luminance;
use hemilux_core::polar::Grid;
use image::codecs::hdr::HdrEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::{GrayImage, ImageFormat, Rgb, RgbImage};
use std::f64::consts::PI;
use std::io::Cursor;
use std::sync::Arc;

/// JPEG quality of the map, at which the compression errors are below the noise of a camera.
const QUALITY: u8 = 90;

/// Grey value of the mask's texels outside of the lens's field; [`SEEN`] and [`CLIPPED`] are those of the other
/// texels.
const UNSEEN: u8 = 0;
const SEEN: u8 = 128;
const CLIPPED: u8 = 255;

/// Answers `/v1/map.hdr`: the radiance of the whole sphere, zero below the horizon, or of the hemisphere.
pub(super) async fn map_hdr(State(context): State<Context>, _: Allowed, uri: Uri) -> Response {
    match MapForm::of(&uri, false, false) {
        Ok(form) => {
            map(&context, PictureKind::MapHdr(form), "image/vnd.radiance", move |view| hdr(view, form)).await
        }
        Err(found) => line(StatusCode::BAD_REQUEST, &found),
    }
}

/// Answers `/v1/map.jpg`: the hemisphere in a tenth of the bytes, for pages that display it as it changes. A code c stands for the radiance g (c
/// / (255 - c))^2; the header `hemilux-grey` contains g, the geometric mean.
pub(super) async fn map_jpg(State(context): State<Context>, _: Allowed) -> Response {
    let link = &context.link;
    let look = |_| view(link, &link.views().maps);
    let picture =
        context.answers.pictures.picture(PictureKind::MapJpeg, look, |view: Arc<MapView>| jpg(&view));
    answer(&context, picture.await, "image/jpeg")
}

/// Answers `/v1/mask.png`: the hemisphere on the map's grid, black outside of the lens's field, white where even the shortest exposure is
/// clipped.
pub(super) async fn mask_png(State(context): State<Context>, _: Allowed) -> Response {
    let link = &context.link;
    let grid = link.settings().applied().borrow().config.pipeline.grid;
    let look = |_| view(link, &link.views().bursts);
    let render = move |view: Arc<BurstView>| {
        let mut bytes = Cursor::new(Vec::new());
        mask(&view, &grid)?.write_to(&mut bytes, ImageFormat::Png).ok()?;
        Some(Rendered { bytes: bytes.into_inner(), frame: view.frame, told: Told::Nothing })
    };
    answer(&context, context.answers.pictures.picture(PictureKind::Mask, look, render).await, "image/png")
}

fn hdr(view: &MapView, form: MapForm) -> Option<Vec<u8>> {
    let sized = form.sized(view);
    let (covers, rows) = form.extent(&sized.grid);
    let mut pixels: Vec<_> = radiances(&sized).map(Rgb).collect();
    pixels.resize(rows * sized.grid.width, Rgb([0.0; 3]));
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes).encode(&pixels, sized.grid.width, rows).ok()?;
    write::state_coverage(&mut bytes, covers);
    Some(bytes)
}

fn radiances(view: &MapView) -> impl Iterator<Item = [f32; 3]> {
    let grid = view.grid;
    let omega = move |i: usize| grid.solid_angle(i / grid.width.max(1)) as f32;
    view.texels.iter().enumerate().map(move |(i, texel)| texel.map(|v| v / omega(i)))
}

fn jpg(view: &MapView) -> Option<Rendered> {
    let grey = geometric_mean(radiances(view).map(luminance));
    let code = |radiance: f32| {
        let root = (radiance.max(0.0) / grey).sqrt();
        (255.0 * root / (1.0 + root) + 0.5) as u8
    };
    let codes = radiances(view).flat_map(|rgb| rgb.map(code)).collect();
    let picture = RgbImage::from_raw(view.grid.width as u32, view.grid.height as u32, codes)?;
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY)).ok()?;
    Some(Rendered { bytes, frame: view.frame, told: Told::Grey(grey) })
}

/// Returns the geometric mean of the positive finite numbers in `values`; 1 if there are none.
fn geometric_mean(values: impl Iterator<Item = f32>) -> f32 {
    let lit = values.filter(|v| *v > 0.0 && v.is_finite());
    let (sum, count) = lit.fold((0.0f64, 0usize), |(sum, n), v| (sum + f64::from(v).ln(), n + 1));
    if count == 0 { 1.0 } else { ((sum / count as f64).exp() as f32).max(f32::MIN_POSITIVE) }
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

/// Returns true if the lens images `direction` onto a pixel of the frame.
fn is_seen(c: &Calibration, direction: DVec3) -> bool {
    let within = |v: f64, size: u32| (-0.5..f64::from(size) - 0.5).contains(&v);
    c.lens.project(direction).is_some_and(|p| within(p.x, c.layout.width()) && within(p.y, c.layout.height()))
}

/// Returns the positions of the pixels of `frame` that have a channel at the white level.
fn clipped(frame: &Frame, c: &Calibration) -> Vec<DVec2> {
    let codes = develop::develop(frame, c).unwrap_or_default();
    let (white, width) = (develop::white(c), (c.layout.width() as usize).max(1));
    let full =
        codes.chunks_exact(3).enumerate().filter(|(_, rgb)| rgb.iter().any(|v| f64::from(*v) >= white));
    full.map(|(i, _)| DVec2::new((i % width) as f64, (i / width) as f64)).collect()
}
