//! `/v1/source`: the source in use, and its replacement by another one of the library.

use super::access::{Allowed, BODY_TIME};
use super::config::{answer, errors};
use super::origin::Sender;
use super::{Context, change};
use crate::probe::Change;
use crate::probe::settings::{short, wish_of};
use crate::source::{self, Choice};
use axum::body::Bytes;
use axum::extract::{FromRequest, Request, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde_json::{Value, json};

/// Answers with the name of the source in use and, for clients that may change it, the names of the available sources.
pub(super) async fn show(State(context): State<Context>, sender: Sender) -> Response {
    let library = context.library.clone();
    let rules = &context.admission;
    let choices = match rules.access.admit(&sender.headers, sender.client.key(), &rules.attempts) {
        Ok(()) => tokio::task::spawn_blocking(move || library.choices()).await.unwrap_or_default(),
        Err(_) => Vec::new(),
    };
    let names: Vec<_> = choices.into_iter().map(|choice| choice.name).collect();
    answer(StatusCode::OK, &json!({"source": context.link.source(), "choices": names}))
}

/// Opens the source that the JSON object in the body names and uses it from the next burst, with the source's own exposures.
pub(super) async fn change(State(context): State<Context>, _: Allowed, request: Request) -> Response {
    let body = tokio::time::timeout(BODY_TIME, Bytes::from_request(request, &())).await;
    let name = body.ok().and_then(Result::ok).and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    let Some(name) = name.as_ref().and_then(|v| v.get("source")).and_then(Value::as_str) else {
        let expected = "a JSON object such as {\"source\": \"scene:sky\"}";
        return refused(StatusCode::BAD_REQUEST, &format!("found another body, expected {expected}"));
    };
    // Sources are opened one at a time: a map takes seconds and memory to open.
    let Ok(_alone) = context.opening.try_lock() else {
        return refused(StatusCode::CONFLICT, "another source is being opened: try again");
    };
    let (library, wanted) = (context.library.clone(), name.to_owned());
    let opened = tokio::task::spawn_blocking(move || {
        let Choice { name, spec } = library.find(&wanted)?;
        Some(source::open_or_wait(&spec).map(|source| (source, name)))
    });
    match opened.await {
        Ok(Some(Ok((source, name)))) => {
            own_exposures(&context).await;
            tracing::info!("source {name} from the next burst on");
            context.link.switch(source, name.clone());
            answer(StatusCode::OK, &json!({"source": name}))
        }
        Ok(Some(Err(error))) => {
            tracing::warn!("source {}: {error}", short(name));
            // The error contains the path of the source, which is not disclosed to clients.
            refused(
                StatusCode::CONFLICT,
                &format!("'{}' could not be opened; the log has the reason", short(name)),
            )
        }
        Ok(None) => {
            let found = format!("found '{}', expected one of the choices of GET /v1/source", short(name));
            refused(StatusCode::BAD_REQUEST, &found)
        }
        Err(_) => refused(StatusCode::INTERNAL_SERVER_ERROR, "the source could not be opened"),
    }
}

/// Resets the setting `exposures_s`, whose exposure times were set for the earlier source.
async fn own_exposures(context: &Context) {
    let none = json!({"exposures_s": null});
    let change: Option<Change> = none.as_object().and_then(|wish| wish_of(wish).ok());
    let is_set = context.link.settings().applied().borrow().config.exposures_s.is_some();
    if let Some(change) = change.filter(|_| is_set) {
        let _ = change::make(context, &change).await;
    }
}

fn refused(status: StatusCode, why: &str) -> Response {
    errors(status, &json!({"source": why}))
}
