//! `/v1/config`: the settings of the probe with their schemas as JSON, and changes of settings.

use super::access::{Allowed, BODY_TIME};
use super::{Context, change};
use crate::probe::settings::{SETTINGS, wish_of};
use crate::probe::{Applied, Config, Refusal};
use axum::body::Bytes;
use axum::extract::{FromRequest, Query, Request, State};
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

/// Answers with the settings, their schemas, and whether a configuration file can store them.
pub(super) async fn show(State(context): State<Context>) -> Response {
    let config = context.link.settings().applied().borrow().config.clone();
    answer(StatusCode::OK, &document(&context, &config))
}

/// Changes the settings that the JSON object in the body names, all of them or none; `?save=1` writes the settings to the
/// configuration file.
pub(super) async fn change(State(context): State<Context>, _: Allowed, request: Request) -> Response {
    let query = Query::<Vec<(String, String)>>::try_from_uri(request.uri());
    let save = match query.as_ref().map(|q| q.as_slice()) {
        Ok([]) => false,
        Ok([(name, value)]) if name == "save" && value == "1" => true,
        _ => return refused("query", "found another query, expected none or save=1"),
    };
    if save && context.file.is_none() {
        let why = "found no configuration file, expected the probe to be started with --config FILE";
        return errors(StatusCode::CONFLICT, &json!({"save": why}));
    }
    let body = tokio::time::timeout(BODY_TIME, Bytes::from_request(request, &())).await;
    let Ok(Ok(body)) = body else {
        return refused("body", "found more than 16,384 bytes, or a body that did not arrive in time");
    };
    let Ok(Value::Object(wish)) = serde_json::from_slice(&body) else {
        return refused("body", "found something else, expected a JSON object such as {\"lights\": 32}");
    };
    let change = match wish_of(&wish) {
        Ok(change) => change,
        Err(each) => return errors(StatusCode::BAD_REQUEST, &json!(each)),
    };
    match change::make(&context, &change).await {
        Err(Refusal { setting, why }) | Ok(Some(Applied { refused: Some(Refusal { setting, why }), .. })) => {
            let found = if why.starts_with("found ") { "" } else { "found " };
            refused(setting, &format!("{found}{why}"))
        }
        Ok(Some(Applied { config, .. })) if save => keep(&context, config).await,
        Ok(Some(Applied { config, .. })) => answer(StatusCode::OK, &document(&context, &config)),
        Ok(None) => {
            let config = context.link.settings().applied().borrow().config.clone();
            let mut document = document(&context, &config);
            document["pending"] = json!(true);
            answer(StatusCode::ACCEPTED, &document)
        }
    }
}

/// Writes the settings in effect to the configuration file.
async fn keep(context: &Context, config: Config) -> Response {
    let Some(file) = context.file.clone() else { return refused("save", "found no configuration file") };
    let document = document(context, &config);
    let written = tokio::task::spawn_blocking(move || file.save(&config)).await;
    match written {
        Ok(Ok(())) => answer(StatusCode::OK, &document),
        Ok(Err(error)) => {
            tracing::warn!("{error}");
            // The error contains the path of the configuration file, which is not disclosed to clients.
            errors(
                StatusCode::INTERNAL_SERVER_ERROR,
                &json!({"save": "in effect, but the configuration file could not be written"}),
            )
        }
        Err(_) => errors(StatusCode::INTERNAL_SERVER_ERROR, &json!({"save": "in effect, but not written"})),
    }
}

fn document(context: &Context, config: &Config) -> Value {
    let values: serde_json::Map<_, _> =
        SETTINGS.iter().map(|s| (s.name.to_owned(), s.value(config))).collect();
    let mut settings: serde_json::Map<_, _> =
        SETTINGS.iter().map(|s| (s.name.to_owned(), s.schema(config))).collect();
    let exposures = context.link.settings().exposures();
    if let Some(schema) = settings.get_mut("exposures_s") {
        schema["current"] = json!(exposures.seconds);
        schema["readOnly"] = json!(exposures.fixed.is_some());
        schema["reason"] = json!(exposures.fixed);
    }
    let pending = false;
    json!({"values": values, "settings": settings, "can_save": context.file.is_some(), "pending": pending})
}

fn refused(field: &str, why: &str) -> Response {
    errors(StatusCode::BAD_REQUEST, &json!({ field: why }))
}

pub(super) fn errors(status: StatusCode, each: &Value) -> Response {
    answer(status, &json!({"errors": each}))
}

/// Returns a JSON answer that caches do not store.
pub(super) fn answer(status: StatusCode, document: &Value) -> Response {
    (status, [(CONTENT_TYPE, "application/json"), (CACHE_CONTROL, "no-store")], format!("{document}\n"))
        .into_response()
}
