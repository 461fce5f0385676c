//! `/v1/calibration`: calibration from the running source, step by step. The action `save` alone writes to the lens file.

mod action;
mod document;
mod session;

use super::access::{Allowed, BODY_TIME};
use super::picture_cache::View;
use super::{Context, config, pictures};
use crate::probe::BurstView;
use action::Action;
use axum::body::Bytes;
use axum::extract::{FromRequest, Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde_json::json;
use session::{Refusal, Session};
use std::path::PathBuf;
use std::sync::Arc;
use tokio::sync::{Mutex, OwnedMutexGuard};

/// The calibration in progress, one for all clients, and the lens file to which its results are saved.
#[derive(Default)]
pub(super) struct Calibrations {
    session: Arc<Mutex<Session>>,
    file: Option<PathBuf>,
}

impl Calibrations {
    pub(super) fn new(file: Option<PathBuf>) -> Self {
        Self { session: Arc::default(), file }
    }

    fn lock(&self) -> Option<OwnedMutexGuard<Session>> {
        Arc::clone(&self.session).try_lock_owned().ok()
    }
}

/// Answers with the state of the calibration in progress.
pub(super) async fn show(State(context): State<Context>, _: Allowed) -> Response {
    let can_save = context.calibration.file.is_some();
    match context.calibration.lock() {
        Some(session) => config::answer(StatusCode::OK, &document::of(&session, can_save)),
        None => busy(),
    }
}

/// Runs the calibration action that the JSON object in the body names, and answers with the state of the
/// calibration.
pub(super) async fn act(State(context): State<Context>, _: Allowed, request: Request) -> Response {
    let body = tokio::time::timeout(BODY_TIME, Bytes::from_request(request, &())).await;
    let Ok(Ok(body)) = body else {
        return refused("body", "found more than 16,384 bytes, or a body that did not arrive in time");
    };
    let action = match serde_json::from_slice::<Action>(&body) {
        Ok(action) => action,
        Err(error) => {
            return refused("do", &format!("found {error}, expected an action such as {{\"do\": \"look\"}}"));
        }
    };
    let Some(mut session) = context.calibration.lock() else { return busy() };
    let view = if action.needs_view() { fresh(&context).await } else { None };
    if action.needs_view() && view.is_none() {
        let why = "found no fresh picture, expected a source that delivers bursts";
        return errors(StatusCode::SERVICE_UNAVAILABLE, "do", why);
    }
    let file = context.calibration.file.clone();
    let done = tokio::task::spawn_blocking(move || {
        let outcome = session.act(action, view.as_deref(), file.as_deref());
        outcome.map(|()| document::of(&session, file.is_some()))
    });
    match done.await {
        Ok(Ok(document)) => config::answer(StatusCode::OK, &document),
        Ok(Err(Refusal { field, why, status })) => errors(status, field, &why),
        Err(_) => errors(StatusCode::INTERNAL_SERVER_ERROR, "do", "found a fault of the program"),
    }
}

/// Waits for the next frame and returns its burst; `None` without a frame within the time limit.
async fn fresh(context: &Context) -> Option<Arc<BurstView>> {
    match pictures::view(&context.link, &context.link.views().bursts).await {
        View::Of { view, is_fresh: true, .. } => Some(view),
        _ => None,
    }
}

fn busy() -> Response {
    errors(
        StatusCode::CONFLICT,
        "do",
        "found another action in progress, expected its end: repeat the request after a second",
    )
}

fn refused(field: &str, why: &str) -> Response {
    errors(StatusCode::BAD_REQUEST, field, why)
}

fn errors(status: StatusCode, field: &str, why: &str) -> Response {
    config::answer(status, &json!({"errors": {field: why}}))
}
