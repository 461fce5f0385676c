//! Pictures: the exposures of a burst, a fresh shot, and the map. They are rendered on request, one at a time, once per frame for all clients.

use super::access::Allowed;
use super::answer::LONGEST_WAIT;
use super::develop;
use super::lights::{no_frame_yet, too_much};
use super::map_form::MapForm;
use super::picture_cache::{NoPicture, Picture, PictureKind, Rendered, Shot, Told, View};
use super::{Context, line};
use crate::calibration::{Calibration, Frame};
use crate::clock;
use crate::maps::write;
use crate::picture;
use crate::probe::settings::short;
use crate::probe::{BurstView, Link, MapView, RETRY_PAUSE, Slot, ViewRequest};
use axum::extract::{Path, RawQuery, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, RgbImage, imageops};
use std::io::Cursor;
use std::sync::Arc;
use std::time::Duration;

/// JPEG quality of exposures, at which artefacts are below the sensor's noise.
const QUALITY: u8 = 90;

/// Widths of reduced exposures that a request can choose, pixels.
const WIDTHS: [u16; 3] = [160, 320, 640];

/// Longest wait for a frame or map while the source has failed: the processing thread answers after each attempt to read the source, with
/// a pause between attempts.
const FAILED_WAIT: Duration = RETRY_PAUSE.saturating_mul(4);

/// Longest wait for a picture that is taken after the request: two bursts, of which the first began before the request; exposures of a
/// second each make bursts of three seconds.
const CAPTURE_WAIT: Duration = Duration::from_secs(8);

/// Largest fraction of the samples of a picture on `/capture` that may be clipped.
const CLIPPED: f64 = 0.01;

/// Returns the view of the next frame, or after [`LONGEST_WAIT`] the last view; while the source has failed, the last view at
/// once.
pub(super) async fn view<T>(link: &Link, slot: &Slot<T>) -> View<Arc<T>> {
    let since_ns = clock::monotonic_ns();
    let ViewRequest { number, mut given } = slot.request();
    let longest = if link.status().failure().is_some() { FAILED_WAIT } else { LONGEST_WAIT };
    let waited = tokio::time::timeout(longest, given.wait_for(|g| g.number >= number)).await;
    let is_in_time = waited.is_ok();
    drop(waited);
    let newest = given.borrow();
    let is_fresh = is_in_time && newest.is_new;
    let view = newest.view.clone();
    drop(newest);
    view.map_or(View::None, |view| View::Of { view, since_ns, is_fresh })
}

/// Answers `image` and `image?N` with exposure N of the next burst, 0 the shortest; the longest without N.
pub(super) async fn image(State(context): State<Context>, _: Allowed, RawQuery(query): RawQuery) -> Response {
    exposure(&context, query.as_deref().filter(|q| !q.is_empty()), None).await
}

/// Answers `/v1/image/N` with exposure N of the next burst; `?width=` reduces the picture.
pub(super) async fn image_at(
    State(context): State<Context>,
    _: Allowed,
    Path(index): Path<String>,
    RawQuery(query): RawQuery,
) -> Response {
    let width = match query.as_deref().filter(|q| !q.is_empty()) {
        None => None,
        Some(query) => {
            let wanted = query.strip_prefix("width=").and_then(|w| w.parse().ok());
            let Some(width) = wanted.filter(|w| WIDTHS.contains(w)) else {
                let found = short(query);
                return line(
                    StatusCode::BAD_REQUEST,
                    &format!("found '{found}'. Accepted: width=160|320|640"),
                );
            };
            Some(width)
        }
    };
    exposure(&context, Some(&index), width).await
}

async fn exposure(context: &Context, index: Option<&str>, width: Option<u16>) -> Response {
    let last = context.link.settings().exposures().seconds.len().saturating_sub(1);
    let number = index.map_or(Some(last), |text| text.parse::<usize>().ok().filter(|at| *at <= last));
    let Some(at) = number else { return no_exposure(index, last) };
    let link = &context.link;
    let look = |_| view(link, &link.views().bursts);
    let render = move |view: Arc<BurstView>| shot(&view, at.min(view.frames.len().saturating_sub(1)), width);
    let kind = PictureKind::Exposure(at, width);
    answer(context, context.answers.pictures.picture(kind, look, render).await, "image/jpeg")
}

fn no_exposure(index: Option<&str>, last: usize) -> Response {
    let found = short(index.unwrap_or_default());
    line(
        StatusCode::BAD_REQUEST,
        &format!("found exposure '{found}'. Accepted: 0 (the shortest) to {last} (the longest)"),
    )
}

/// Answers `capture` with a picture that was taken after the request: of the first burst whose exposures all began after the request, the longest
/// exposure with at most 1 % of clipped samples.
pub(super) async fn capture(State(context): State<Context>, _: Allowed) -> Response {
    let link = &context.link;
    let look = |asked_ns| async move {
        match view(link, &link.views().bursts).await {
            View::Of { view, is_fresh: true, .. } if view.before_ns >= asked_ns => {
                View::Of { since_ns: view.before_ns, view, is_fresh: true }
            }
            // While the source has failed, no burst is waited for.
            View::Of { is_fresh: false, .. } | View::None if link.status().failure().is_some() => View::None,
            _ => View::TooOld,
        }
    };
    let render = |view: Arc<BurstView>| shot(&view, well_exposed(&view), None);
    let picture = context.answers.pictures.picture(PictureKind::Capture, look, render);
    match tokio::time::timeout(CAPTURE_WAIT, picture).await {
        Ok(Err(NoPicture::NoView)) | Err(_) => nothing_fresh(link),
        Ok(picture) => answer(&context, picture, "image/jpeg"),
    }
}

fn nothing_fresh(link: &Link) -> Response {
    let within = format!("no burst began within {} s of the request", CAPTURE_WAIT.as_secs());
    let mut response = line(
        StatusCode::SERVICE_UNAVAILABLE,
        &format!("no fresh shot: {}", link.status().failure().unwrap_or(within)),
    );
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("1"));
    response
}

/// Answers `/v1/map.png`: the tone-mapped map of the hemisphere, or of the sphere; with `?marks=1` the lights are drawn on it.
pub(super) async fn map_png(State(context): State<Context>, _: Allowed, uri: Uri) -> Response {
    match MapForm::of(&uri, true, true) {
        Ok(form) => map(&context, PictureKind::Map(form), "image/png", move |view| png(view, form)).await,
        Err(found) => line(StatusCode::BAD_REQUEST, &found),
    }
}

/// Answers `/v1/map.exr`: the radiance of the whole sphere, zero below the horizon, or of the hemisphere.
pub(super) async fn map_exr(State(context): State<Context>, _: Allowed, uri: Uri) -> Response {
    match MapForm::of(&uri, false, false) {
        Ok(form) => {
            map(&context, PictureKind::MapExr(form), "image/x-exr", move |view| exr(view, form)).await
        }
        Err(found) => line(StatusCode::BAD_REQUEST, &found),
    }
}

/// Answers with a picture of `kind` of the map, which `render` makes.
pub(super) async fn map(
    context: &Context,
    kind: PictureKind,
    content_type: &'static str,
    paint: impl FnOnce(&MapView) -> Option<Vec<u8>> + Send + 'static,
) -> Response {
    let link = &context.link;
    let look = |_| view(link, &link.views().maps);
    let render = move |view: Arc<MapView>| {
        Some(Rendered { bytes: paint(&view)?, frame: view.frame, told: Told::Nothing })
    };
    answer(context, context.answers.pictures.picture(kind, look, render).await, content_type)
}

/// Answers with a picture, or with the reason why there is none.
pub(super) fn answer(
    context: &Context,
    picture: Result<Picture, NoPicture>,
    content_type: &'static str,
) -> Response {
    let Picture { bytes, frame, told, is_fresh } = match picture {
        Ok(picture) => picture,
        Err(why) => return no_picture(context, why),
    };
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(HeaderName::from_static("hemilux-frame"), frame.into());
    if !is_fresh {
        headers.insert(HeaderName::from_static("hemilux-stale"), HeaderValue::from_static("true"));
    }
    match told {
        Told::Nothing => {}
        Told::Shot(Shot { of, seconds }) => {
            headers.insert(HeaderName::from_static("hemilux-exposures"), of.into());
            let seconds = HeaderValue::from_str(&seconds.to_string());
            headers.extend(seconds.map(|s| (HeaderName::from_static("hemilux-exposure-s"), s)));
        }
        Told::Grey(radiance) => {
            let grey = HeaderValue::from_str(&radiance.to_string());
            headers.extend(grey.map(|g| (HeaderName::from_static("hemilux-grey"), g)));
        }
    }
    (headers, bytes).into_response()
}

/// Returns the refusal with the reason for a missing picture.
pub(super) fn no_picture(context: &Context, why: NoPicture) -> Response {
    match why {
        NoPicture::NoView => no_frame_yet(&context.link),
        NoPicture::Full => too_much(context),
        NoPicture::Fault => line(StatusCode::INTERNAL_SERVER_ERROR, "the picture could not be made"),
    }
}

/// Returns exposure `at` of the burst as JPEG, at most `width` pixels wide.
fn shot(view: &BurstView, at: usize, width: Option<u16>) -> Option<Rendered> {
    let frame = view.frames.get(at)?;
    let shot = Shot { of: view.frames.len(), seconds: frame.exposure.seconds * frame.exposure.gain };
    let bytes = jpeg(frame, &view.calibration, width)?;
    Some(Rendered { bytes, frame: view.frame, told: Told::Shot(shot) })
}

fn well_exposed(view: &BurstView) -> usize {
    let white = develop::white(&view.calibration);
    let clipped = |frame: &Frame| {
        let codes = develop::develop(frame, &view.calibration).unwrap_or_default();
        codes.iter().filter(|v| f64::from(**v) >= white).count() as f64 / codes.len().max(1) as f64
    };
    view.frames.iter().rposition(|frame| clipped(frame) < CLIPPED).unwrap_or(0)
}

fn jpeg(frame: &Frame, c: &Calibration, width: Option<u16>) -> Option<Vec<u8>> {
    let codes = develop::develop(frame, c)?;
    let mut picture = RgbImage::from_raw(c.layout.width(), c.layout.height(), codes)?;
    if let Some(width) = width.map(u32::from).filter(|w| *w < picture.width()) {
        let height = (width * picture.height()).div_ceil(picture.width());
        picture = imageops::thumbnail(&picture, width, height);
    }
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY)).ok()?;
    Some(bytes)
}

/// Returns the tone-mapped map as PNG, on which the lights are drawn if `form` has marks.
pub(super) fn png(view: &MapView, form: MapForm) -> Option<Vec<u8>> {
    let sized = form.sized(view);
    let lights = if form.marks { sized.lights.as_slice() } else { &[] };
    let mut picture = picture::draw(&sized.map(), lights);
    if !form.hemisphere {
        let mut sphere = RgbImage::new(picture.width(), 2 * picture.height());
        imageops::replace(&mut sphere, &picture, 0, 0);
        picture = sphere;
    }
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).ok()?;
    Some(bytes.into_inner())
}

fn exr(view: &MapView, form: MapForm) -> Option<Vec<u8>> {
    let sized = form.sized(view);
    let grid = sized.grid;
    let radiance = |row: usize, column: usize| {
        let energy = sized.texels.get(row * grid.width + column).copied().unwrap_or_default();
        if row < grid.height { energy.map(|v| v / grid.solid_angle(row) as f32) } else { [0.0; 3] }
    };
    let (covers, rows) = form.extent(&grid);
    write::openexr(grid.width, rows, covers, radiance).ok()
}
