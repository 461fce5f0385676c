//! The routes of all requests of the server.

use super::format::Format;
use super::paths::PATHS;
use super::{
    Context, access, calibration, change, client, compare, config, events, headers, identify, lights,
    metrics, page, pages, pictures, screenshot, sources, sphere, status,
};
use axum::Router;
use axum::extract::{MatchedPath, Request, State};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::Response;
use axum::routing::{get, post};

use tower_http::limit::RequestBodyLimitLayer;

/// Largest body of a request, bytes; handlers that need no body do not read it.
const MAX_BODY_BYTES: usize = 16 << 10;

/// Returns all routes, preceded by the checks of host, origin and size.
pub(super) fn router(context: Context) -> Router {
    let light_set = |format| get(move |context, uri, headers| lights::answer(context, uri, headers, format));
    let paths = Router::new()
        .route("/", get(page::index))
        .route("/page/{name}", get(page::part))
        .route("/info", get(pages::info))
        .route("/change", get(change::change).head(not_allowed).merge(post(change::submit)))
        .route("/data", light_set(Some(Format::Text)))
        .route("/xml", light_set(Some(Format::Xml)))
        .route("/image", get(pictures::image).head(not_allowed))
        .route("/capture", get(pictures::capture).head(not_allowed))
        .route("/screenshot", get(screenshot::take).head(not_allowed))
        .route("/screenshots/{name}", get(screenshot::kept))
        .route("/login", get(access::form).merge(post(access::log_in)))
        .route("/lights.json", light_set(Some(Format::Json)))
        .route("/healthz", get(lights::health))
        .route("/metrics", get(metrics::metrics))
        .route("/openapi.json", get(client::openapi))
        .route("/client.js", get(client::javascript))
        .route("/three.js", get(client::three))
        .route("/v1/lights", light_set(None))
        .route("/v1/events", get(events::events).head(not_allowed))
        .route("/v1/socket", get(events::socket).head(not_allowed))
        .route("/v1/compare", get(compare::compare).head(not_allowed))
        .route("/v1/config", get(config::show).patch(config::change))
        .route("/v1/calibration", get(calibration::show).head(not_allowed).post(calibration::act))
        .route("/v1/status", get(status::status))
        .route("/v1/source", get(sources::show).patch(sources::change))
        .route("/v1/map.jpg", get(sphere::map_jpg).head(not_allowed))
        .route("/v1/map.png", get(pictures::map_png).head(not_allowed))
        .route("/v1/map.exr", get(pictures::map_exr).head(not_allowed))
        .route("/v1/map.hdr", get(sphere::map_hdr).head(not_allowed))
        .route("/v1/mask.png", get(sphere::mask_png).head(not_allowed))
        .route("/v1/xr", get(lights::estimate))
        .route("/v1/image/{index}", get(pictures::image_at).head(not_allowed));
    paths
        .fallback(not_found)
        .method_not_allowed_fallback(not_allowed)
        .layer(RequestBodyLimitLayer::new(MAX_BODY_BYTES))
        .layer(headers::cors(&context.admission.origins))
        .layer(from_fn_with_state(context.clone(), headers::finish))
        .layer(from_fn_with_state(context.clone(), identify::identify))
        .layer(from_fn_with_state(context.clone(), count))
        .with_state(context)
}

async fn count(State(context): State<Context>, request: Request, next: Next) -> Response {
    let path = request.extensions().get::<MatchedPath>().cloned();
    let response = next.run(request).await;
    let path = path.as_ref().map_or("", MatchedPath::as_str);
    context.counts.answered(path, response.status().as_u16());
    response
}

async fn not_found() -> Response {
    super::line(StatusCode::NOT_FOUND, &format!("no such path, expected one of: {}", PATHS.join(" ")))
}

async fn not_allowed() -> Response {
    super::line(StatusCode::METHOD_NOT_ALLOWED, "this path has other methods: see /openapi.json")
}
