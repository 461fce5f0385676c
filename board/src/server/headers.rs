//! Headers of every answer, and the rules for pages of other sites (CORS).

use super::hosts::HostRefusal;
use super::origin::is_allowed;
use super::{Context, hosts};
use axum::extract::{Request, State};
use axum::http::header::{
    AUTHORIZATION, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ORIGIN, REFERRER_POLICY,
    RETRY_AFTER, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderName, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::Response;
use std::time::Duration;
use tower_http::cors::{AllowOrigin, CorsLayer};

/// Content-Security-Policy of every answer: pages load from and connect to this server alone, and no frame may
/// show them.
const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self' blob:; \
     form-action 'self'; frame-ancestors 'none'; base-uri 'none'",
);

/// Request headers beyond the CORS-safelisted ones that scripts of allowed origins may send: credentials, the type of a change, and the id of the
/// last event of a stream (EventSource sends it by itself, fetch clients set it).
const REQUEST_HEADERS: [HeaderName; 4] =
    [AUTHORIZATION, CACHE_CONTROL, CONTENT_TYPE, HeaderName::from_static("last-event-id")];

/// Headers of answers that scripts of allowed origins may read.
const ANSWER_HEADERS: [HeaderName; 6] = [
    RETRY_AFTER,
    HeaderName::from_static("hemilux-frame"),
    HeaderName::from_static("hemilux-stale"),
    HeaderName::from_static("hemilux-exposures"),
    HeaderName::from_static("hemilux-exposure-s"),
    HeaderName::from_static("hemilux-grey"),
];

/// Allows scripts of pages of `origins` to use the server (CORS).
pub(super) fn cors(origins: &[String]) -> CorsLayer {
    let origins = origins.iter().filter_map(|origin| HeaderValue::from_str(origin).ok());
    CorsLayer::new()
        .allow_origin(AllowOrigin::list(origins))
        .allow_methods([Method::GET, Method::POST, Method::PATCH])
        .allow_headers(REQUEST_HEADERS)
        .expose_headers(ANSWER_HEADERS)
        .max_age(Duration::from_secs(600))
}

/// Refuses requests for unknown hosts, and adds the headers of every answer.
pub(super) async fn finish(State(context): State<Context>, request: Request, next: Next) -> Response {
    let is_shared =
        request.headers().get(ORIGIN).is_some_and(|origin| is_allowed(origin, &context.admission.origins));
    let mut response = match hosts::refusal(&context.admission.hosts, &request) {
        Some(HostRefusal { reason, response }) => {
            context.counts.refused(reason);
            response
        }
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("same-origin"));
    headers.insert(CONTENT_SECURITY_POLICY, POLICY);
    if !is_shared {
        let policy = HeaderName::from_static("cross-origin-resource-policy");
        headers.insert(policy, HeaderValue::from_static("same-origin"));
    }
    response
}
