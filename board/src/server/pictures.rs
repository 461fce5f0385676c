//! Pictures: the burst's exposures, a fresh shot and the map. They are rendered on request, one at a time, once per frame for all clients.

use super::access::Allowed;
use super::develop;
use super::lights::{LONGEST_WAIT, no_frame_yet};
use super::{Context, line};
use crate::calibration::{Calibration, Frame};
use crate::clock;
use crate::picture;
use crate::probe::settings::short;
use crate::probe::{BurstView, Link, MapView, Slot};
use axum::body::Bytes;
use axum::extract::{Path, RawQuery, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use std::io::Cursor;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// JPEG quality: artefacts are below the sensor's noise.
const QUALITY: u8 = 90;

/// Largest number of pictures that are kept: the exposures of a burst and the forms of the map.
const MAX_PICTURES: usize = 16;

/// Longest wait for a fresh shot: two bursts, of which the first was under way; exposures of a second each make three-second bursts.
const CAPTURE_WAIT: Duration = Duration::from_secs(8);

/// Part of a shot's samples that may be clipped.
const CLIPPED: f64 = 0.01;

/// The contents of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureKind {
    Exposure(usize),
    Map { marks: bool },
    MapExr,
    MapHdr,
    Mask,
}

/// Renders pictures and keeps the newest of each kind.
#[derive(Debug, Default)]
pub(super) struct PictureCache {
    /// Held while a picture is rendered: that takes tens of milliseconds of a core.
    rendering: tokio::sync::Mutex<()>,
    /// Kind, frame and encoded bytes of each picture, the newest first.
    kept: Mutex<Vec<(PictureKind, u64, Bytes)>>,
}

impl PictureCache {
    /// The picture of `frame`, made by `render` unless it is there.
    pub(super) async fn get_or_render(
        &self,
        kind: PictureKind,
        frame: u64,
        render: impl FnOnce() -> Option<Vec<u8>> + Send + 'static,
    ) -> Option<Bytes> {
        let _alone = self.rendering.lock().await;
        if let Some(bytes) = self.find(kind, frame) {
            return Some(bytes);
        }
        let bytes = Bytes::from(tokio::task::spawn_blocking(render).await.ok()??);
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|(k, ..)| *k != kind);
        kept.truncate(MAX_PICTURES - 1);
        kept.insert(0, (kind, frame, bytes.clone()));
        Some(bytes)
    }

    fn find(&self, kind: PictureKind, frame: u64) -> Option<Bytes> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().find(|(k, f, _)| (*k, *f) == (kind, frame)).map(|(.., bytes)| bytes.clone())
    }
}

/// The next frame's view, or after [`LONGEST_WAIT`] the last one that there was; the second value says which.
pub(super) async fn view<T>(slot: &Slot<T>) -> Option<(Arc<T>, bool)> {
    let (number, mut given) = slot.ask();
    let waited = tokio::time::timeout(LONGEST_WAIT, given.wait_for(|g| g.number >= number)).await;
    let is_fresh = waited.is_ok();
    drop(waited);
    let view = given.borrow().view.clone();
    view.map(|view| (view, is_fresh))
}

/// `image` and `image?N`: exposure N of the next burst, 0 the shortest; the longest without N.
pub(super) async fn image(State(context): State<Context>, _: Allowed, RawQuery(query): RawQuery) -> Response {
    exposure(&context, query.as_deref().filter(|q| !q.is_empty())).await
}

/// `/v1/image/N`.
pub(super) async fn image_at(
    State(context): State<Context>,
    _: Allowed,
    Path(index): Path<String>,
) -> Response {
    exposure(&context, Some(&index)).await
}

async fn exposure(context: &Context, index: Option<&str>) -> Response {
    let number = index.map(str::parse::<usize>);
    let Some((view, is_fresh)) = view(&context.link.views().bursts).await else {
        return no_frame_yet(&context.link);
    };
    let last = view.frames.len().saturating_sub(1);
    let Ok(at) = number.unwrap_or(Ok(last)) else { return no_exposure(index, last) };
    if at > last {
        return no_exposure(index, last);
    }
    jpeg_answer(context, view, at, is_fresh).await
}

fn no_exposure(index: Option<&str>, last: usize) -> Response {
    let found = short(index.unwrap_or_default());
    line(
        StatusCode::BAD_REQUEST,
        &format!("found exposure '{found}'. Accepted: 0 (the shortest) to {last} (the longest)"),
    )
}

/// `capture`: a single shot that was taken after the request: of the first burst whose exposures all began after it, the longest
/// exposure that is hardly clipped.
pub(super) async fn capture(State(context): State<Context>, _: Allowed) -> Response {
    let asked_ns = clock::monotonic_ns();
    let fresh = async {
        loop {
            match view(&context.link.views().bursts).await {
                Some((view, true)) if view.before_ns >= asked_ns => return Some(view),
                // While the source is known to be down, nothing is to be waited for.
                Some((_, false)) | None if context.link.failure().is_some() => return None,
                _ => {}
            }
        }
    };
    let Ok(Some(view)) = tokio::time::timeout(CAPTURE_WAIT, fresh).await else {
        return nothing_fresh(&context.link);
    };
    let seen = Arc::clone(&view);
    let at = tokio::task::spawn_blocking(move || well_exposed(&seen)).await.unwrap_or(0);
    jpeg_answer(&context, view, at, true).await
}

fn nothing_fresh(link: &Link) -> Response {
    let within = format!("no burst began within {} s of the request", CAPTURE_WAIT.as_secs());
    let mut response = line(
        StatusCode::SERVICE_UNAVAILABLE,
        &format!("no fresh shot: {}", link.failure().unwrap_or(within)),
    );
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

async fn jpeg_answer(context: &Context, view: Arc<BurstView>, at: usize, is_fresh: bool) -> Response {
    let frame = view.frame;
    let count = view.frames.len();
    let exposure = view.frames.get(at).map_or(0.0, |f| f.exposure.seconds * f.exposure.gain);
    let render = move || jpeg(view.frames.get(at)?, &view.calibration);
    let bytes = context.pictures.get_or_render(PictureKind::Exposure(at), frame, render).await;
    let mut response = answer(bytes, "image/jpeg", frame, is_fresh);
    let exposure = HeaderValue::from_str(&exposure.to_string());
    response.headers_mut().insert(HeaderName::from_static("hemilux-exposures"), count.into());
    response.headers_mut().extend(exposure.map(|e| (HeaderName::from_static("hemilux-exposure-s"), e)));
    response
}

/// `/v1/map.png`: the tone-mapped polar map; with `?marks=1` the lights are drawn on it.
pub(super) async fn map_png(
    State(context): State<Context>,
    _: Allowed,
    RawQuery(query): RawQuery,
) -> Response {
    let marks = match query.as_deref() {
        None | Some("" | "marks=0") => false,
        Some("marks=1") => true,
        Some(other) => {
            return line(StatusCode::BAD_REQUEST, &format!("found '{}'. Accepted: marks=0|1", short(other)));
        }
    };
    let Some((view, is_fresh)) = view(&context.link.views().maps).await else {
        return no_frame_yet(&context.link);
    };
    let frame = view.frame;
    let render = move || png(&view, marks);
    answer(
        context.pictures.get_or_render(PictureKind::Map { marks }, frame, render).await,
        "image/png",
        frame,
        is_fresh,
    )
}

/// `/v1/map.exr`: the whole sphere's radiance, dark below the horizon.
pub(super) async fn map_exr(State(context): State<Context>, _: Allowed) -> Response {
    let Some((view, is_fresh)) = view(&context.link.views().maps).await else {
        return no_frame_yet(&context.link);
    };
    let frame = view.frame;
    let render = move || exr(&view);
    answer(
        context.pictures.get_or_render(PictureKind::MapExr, frame, render).await,
        "image/x-exr",
        frame,
        is_fresh,
    )
}

pub(super) fn answer(bytes: Option<Bytes>, kind: &'static str, frame: u64, is_fresh: bool) -> Response {
    let Some(bytes) = bytes else {
        return line(StatusCode::INTERNAL_SERVER_ERROR, "the picture could not be made");
    };
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(HeaderName::from_static("hemilux-frame"), frame.into());
    if !is_fresh {
        headers.insert(HeaderName::from_static("hemilux-stale"), HeaderValue::from_static("true"));
    }
    (headers, bytes).into_response()
}

fn well_exposed(view: &BurstView) -> usize {
    let white = develop::white(&view.calibration);
    let clipped = |frame: &Frame| {
        let codes = develop::develop(frame, &view.calibration).unwrap_or_default();
        codes.iter().filter(|v| f64::from(**v) >= white).count() as f64 / codes.len().max(1) as f64
    };
    view.frames.iter().rposition(|frame| clipped(frame) < CLIPPED).unwrap_or(0)
}

fn jpeg(frame: &Frame, c: &Calibration) -> Option<Vec<u8>> {
    let codes = develop::develop(frame, c)?;
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .encode(&codes, c.layout.width(), c.layout.height(), ExtendedColorType::Rgb8)
        .ok()?;
    Some(bytes)
}

/// The tone-mapped map, with the lights if `marks`.
pub(super) fn png(view: &MapView, marks: bool) -> Option<Vec<u8>> {
    let lights = if marks { view.lights.as_slice() } else { &[] };
    let mut bytes = Cursor::new(Vec::new());
    picture::draw(&view.map(), lights).write_to(&mut bytes, ImageFormat::Png).ok()?;
    Some(bytes.into_inner())
}

fn exr(view: &MapView) -> Option<Vec<u8>> {
    use exr::meta::attribute::EnvironmentMap;
    use exr::prelude::{Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage};
    let grid = view.grid;
    let pixel = |at: exr::math::Vec2<usize>| {
        let energy = view.texels.get(at.y() * grid.width + at.x()).copied().unwrap_or_default();
        let [r, g, b] = energy.map(|v| v / grid.solid_angle(at.y()) as f32);
        if at.y() < grid.height { (r, g, b) } else { (0.0, 0.0, 0.0) }
    };
    let layer = Layer::new(
        (grid.width, 2 * grid.height),
        LayerAttributes {
            software_name: Some("hemilux".into()),
            environment_map: Some(EnvironmentMap::LatitudeLongitude),
            ..LayerAttributes::default()
        },
        Encoding::FAST_LOSSLESS,
        SpecificChannels::rgb(pixel),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).ok()?;
    Some(bytes.into_inner())
}
