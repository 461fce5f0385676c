//! `/change`: sets settings of the probe from the next frame on, all settings of a request or none.

use super::access::{self, BODY_TIME};
use super::origin::{Cause, Sender};
use super::{Context, line, pages};
use crate::probe::settings::{Kind, SETTINGS, short};
use crate::probe::{Applied, Change, Refusal};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Form, FromRequest, Query, Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use std::time::Duration;

/// Longest time that `/change` waits for the frame that confirms a change.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);

type Pairs = Vec<(String, String)>;

/// Answers a request without a query with a form, and any other by changing the settings that its query names.
///
/// A browser's request must prove that a page of this server caused it; otherwise the answer is a form with the parameters, by which the user
/// confirms the change. With stored Basic credentials, every navigation gets this form: the browser adds the credentials to any link.
pub(super) async fn change(
    State(context): State<Context>,
    sender: Sender,
    query: Result<Query<Pairs>, QueryRejection>,
) -> Response {
    let Ok(Query(pairs)) = query else { return refused("a query that cannot be parsed") };
    if pairs.is_empty() {
        return pages::change_form(&context.link.settings().applied().borrow().config, &accepted())
            .into_response();
    }
    match sender.cause(&context.admission.origins) {
        _ if access::is_bearer(&sender.headers) => apply(&context, &sender, &pairs).await,
        Cause::OwnPage if sender.is_navigation() && access::is_basic(&sender.headers) => confirm_form(&pairs),
        Cause::Program | Cause::OwnPage => apply(&context, &sender, &pairs).await,
        Cause::Unproven => unproven(&context, &pairs),
        Cause::ForeignPage if sender.is_navigation() => unproven(&context, &pairs),
        Cause::ForeignPage => access::foreign(&context, "a request made by a page of another site"),
    }
}

/// Changes the settings in the body of a form. Browsers send Origin with every form, so that a form of another site is recognised.
pub(super) async fn submit(State(context): State<Context>, sender: Sender, request: Request) -> Response {
    if matches!(sender.cause(&context.admission.origins), Cause::ForeignPage | Cause::Unproven) {
        return access::foreign(&context, "a form sent by a page of another site");
    }
    if let Some(refusal) = access::check(&context, &sender) {
        return refusal;
    }
    let form = tokio::time::timeout(BODY_TIME, Form::<Pairs>::from_request(request, &())).await;
    match form {
        Ok(Ok(Form(pairs))) if !pairs.is_empty() => apply_allowed(&context, &pairs).await,
        _ => refused("another body than a form with at least one field"),
    }
}

fn unproven(context: &Context, pairs: &[(String, String)]) -> Response {
    context.counts.refused("unproven");
    confirm_form(pairs)
}

fn confirm_form(pairs: &[(String, String)]) -> Response {
    (StatusCode::FORBIDDEN, pages::change_confirm(pairs)).into_response()
}

async fn apply(context: &Context, sender: &Sender, pairs: &[(String, String)]) -> Response {
    if let Some(refusal) = access::check(context, sender) {
        return refusal;
    }
    apply_allowed(context, pairs).await
}

async fn apply_allowed(context: &Context, pairs: &[(String, String)]) -> Response {
    let change = match parse(pairs) {
        Ok(change) => change,
        Err(found) => return refused(&found),
    };
    match make(context, &change).await {
        Ok(Some(answer)) => confirm(&answer, pairs),
        Ok(None) => pages::change_pending(pairs).into_response(),
        Err(refusal) => refused(&refusal.why),
    }
}

/// Changes settings and waits until the processing thread has applied them; `None` if the wait exceeds [`LONGEST_WAIT`].
///
/// # Errors
/// The refused setting and the reason; no setting is changed then.
pub(super) async fn make(context: &Context, change: &Change) -> Result<Option<Applied>, Refusal> {
    let mut applied = context.link.settings().applied();
    let serial = context.link.settings().change(change)?;
    let looked_at = tokio::time::timeout(LONGEST_WAIT, applied.wait_for(|a| a.serial >= serial)).await;
    Ok(looked_at.ok().and_then(|known| known.ok().map(|a| a.clone())))
}

fn confirm(answer: &Applied, pairs: &[(String, String)]) -> Response {
    match &answer.refused {
        Some(refusal) => refused(&refusal.why),
        None => pages::change_done(&answer.config, pairs).into_response(),
    }
}

/// Returns an answer of status 400 that states `found` and lists the accepted parameters of `/change`.
fn refused(found: &str) -> Response {
    let found = found.strip_prefix("found ").unwrap_or(found);
    line(StatusCode::BAD_REQUEST, &format!("found {found}; nothing was changed. Accepted:\n{}", accepted()))
}

/// Lists the parameters of `/change` and their values, one per line.
fn accepted() -> String {
    let line = |setting: &crate::probe::settings::Setting| match setting.kind {
        Kind::Choice(words) => format!("{}={}", setting.parameter, words.join("|")),
        Kind::Whole(least, most) if setting.name == "lights" => {
            let own = |kind: SamplerKind| least.max(kind.least_lights(Domain::Hemisphere) as u64);
            let each = SamplerKind::ALL.map(|kind| format!("{}..{most} for {kind}", own(kind)));
            format!("{}=N ({})", setting.parameter, each.join(", "))
        }
        Kind::Whole(least, most) => format!("{}=N ({least}..{most})", setting.parameter),
        Kind::OptionalWhole(least, most) => format!("{}=N|off ({least}..{most})", setting.parameter),
        Kind::Real(least, most) => format!("{}=X ({least}..{most})", setting.parameter),
        Kind::Optional(least, most) => format!("{}=X|off ({least}..{most})", setting.parameter),
        Kind::List(least, most, count) => {
            format!("{}=X,X,...|off (1 to {count} rising, {least}..{most})", setting.parameter)
        }
        Kind::Switch => format!("{}=on|off", setting.parameter),
    };
    SETTINGS.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn parse(pairs: &[(String, String)]) -> Result<Change, String> {
    let mut change = Change::default();
    for (i, (name, word)) in pairs.iter().enumerate() {
        if pairs[..i].iter().any(|(n, _)| n == name) {
            return Err(format!("parameter '{}' twice", short(name)));
        }
        let setting = SETTINGS.iter().find(|s| s.parameter == name);
        let setting = setting.ok_or_else(|| format!("unknown parameter '{}'", short(name)))?;
        let added = setting.parse(word).and_then(|value| change.add(setting, value).ok());
        added.ok_or_else(|| format!("{name} '{}'", short(word)))?;
    }
    Ok(change)
}
