//! Determines the client of each request, which may have passed a proxy.

use super::connection::ConnectionGuard;
use super::proxy::Client;
use super::{Context, line};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::Response;
use std::sync::Arc;

/// Adds the [`Client`] of a request to the request's extensions and counts the connection under the client's
/// key.
pub(super) async fn identify(State(context): State<Context>, mut request: Request, next: Next) -> Response {
    let guard = request.extensions().get::<Arc<ConnectionGuard>>().cloned();
    let client = match &guard {
        None => Client::default(),
        Some(guard) => match context.admission.proxies.client(guard.address, request.headers()) {
            Ok(client) => client,
            Err(found) => {
                context.counts.refused("malformed");
                return line(StatusCode::BAD_REQUEST, &format!("found {found}"));
            }
        },
    };
    if let Some(guard) = guard.filter(|guard| guard.address != client.address) {
        guard.assign(client.key());
    }
    request.extensions_mut().insert(client);
    next.run(request).await
}
