//! `/change`: settings, all or none of them, in effect from the next frame.

use super::{Context, guard, line, pages};
use crate::probe::{Applied, Change, EXTRAPOLATIONS};
use crate::samplers::{MAX_LIGHTS, NAMES, least_lights};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use hemilux_core::healpix::Domain;
use std::time::Duration;

/// Longest wait for the frame that confirms a change; a dead source gives none.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// Longest part of a name or value that is repeated to who sent it, characters.
const ECHO: usize = 40;

type Pairs = Vec<(String, String)>;

/// Shows the form, or changes what the parameters say.
pub(super) async fn change(
    State(context): State<Context>,
    uri: Uri,
    headers: HeaderMap,
    query: Result<Query<Pairs>, QueryRejection>,
) -> Response {
    let Ok(Query(pairs)) = query else { return refused("a query that cannot be read") };
    if pairs.is_empty() {
        return pages::change_form(&context.link.applied().borrow().config).into_response();
    }
    if guard::is_foreign(&uri, &headers) {
        return line(StatusCode::FORBIDDEN, "a change asked for by a page of another site");
    }
    let change = match parse(&pairs) {
        Ok(change) => change,
        Err(found) => return refused(&found),
    };
    let mut applied = context.link.applied();
    let serial = match context.link.change(&change) {
        Ok(serial) => serial,
        Err(found) => return refused(&found.to_string()),
    };
    let looked_at = tokio::time::timeout(LONGEST_WAIT, applied.wait_for(|a| a.serial >= serial)).await;
    let answer = looked_at.ok().and_then(|known| known.ok().map(|a| a.clone()));
    match answer {
        Some(answer) => confirm(&answer, &pairs),
        None => pages::change_pending(&pairs).into_response(),
    }
}

fn confirm(answer: &Applied, pairs: &[(String, String)]) -> Response {
    match &answer.refused {
        Some(reason) => refused(reason),
        None => pages::change_done(&answer.config, pairs).into_response(),
    }
}

/// 400 with what was found and the list of what is accepted.
fn refused(found: &str) -> Response {
    line(StatusCode::BAD_REQUEST, &format!("found {found}; nothing was changed. Accepted:\n{}", accepted()))
}

/// Parameters and their values, one a line.
pub(super) fn accepted() -> String {
    let extrapolations = EXTRAPOLATIONS.map(|(name, _)| name).join("|");
    let least = |name| least_lights(name, Domain::Hemisphere).unwrap_or(1);
    let samples = NAMES.map(|name| format!("{}..{MAX_LIGHTS} for {name}", least(name))).join(", ");
    let samplers = NAMES.join("|");
    format!("algorithm={samplers}\nsamples=N ({samples})\nextrapolation={extrapolations}\ngui=on|off")
}

fn parse(pairs: &[(String, String)]) -> Result<Change, String> {
    let mut change = Change::default();
    for (i, (name, value)) in pairs.iter().enumerate() {
        if pairs[..i].iter().any(|(n, _)| n == name) {
            return Err(format!("parameter '{}' twice", echo(name)));
        }
        let known = set(&mut change, name, value);
        known.map_err(|what| format!("{what} '{}'", echo(if what == UNKNOWN { name } else { value })))?;
    }
    Ok(change)
}

const UNKNOWN: &str = "unknown parameter";

/// Sets one parameter, or says what is wrong.
fn set(change: &mut Change, name: &str, value: &str) -> Result<(), &'static str> {
    match name {
        "algorithm" => {
            let known = NAMES.iter().find(|n| **n == value).ok_or("algorithm")?;
            change.sampler = Some((*known).into());
        }
        "samples" => {
            let number = value.parse().ok().filter(|n| (1..=MAX_LIGHTS).contains(n));
            change.lights = Some(number.ok_or("samples")?);
        }
        "extrapolation" => {
            let known = EXTRAPOLATIONS.iter().find(|(n, _)| *n == value);
            change.extrapolation = Some(known.ok_or("extrapolation")?.1);
        }
        "gui" => change.gui = Some(on_off(value).ok_or("gui")?),
        _ => return Err(UNKNOWN),
    }
    Ok(())
}

fn on_off(value: &str) -> Option<bool> {
    match value {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    }
}

/// Text of a client, short and on one line.
fn echo(text: &str) -> String {
    text.chars().take(ECHO).flat_map(char::escape_debug).collect()
}
