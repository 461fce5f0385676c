//! Access control for changes of settings and for pictures.
//!
//! With a token, a request must carry it as `Authorization: Bearer`, as the password of `Authorization: Basic` (what old clients and
//! pictures in pages can send; the name does not matter), or carry the cookie that the log-in form gives. It never stands in a URL.
//! A browser sends cookies and Basic passwords by itself, so requests that a page of another site made are refused in any case.

use super::guard;
use super::token::Token;
use super::{Context, line, pages};
use axum::extract::{Form, FromRequest, FromRequestParts, Request, State};
use axum::http::header::{ACCEPT, AUTHORIZATION, COOKIE, LOCATION, SET_COOKIE, WWW_AUTHENTICATE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use data_encoding::BASE64;
use std::time::Duration;

/// Longest time to send a body.
pub(super) const BODY_TIME: Duration = Duration::from_secs(5);

const BEARER: &str = "Bearer realm=\"hemilux\"";

const COOKIE_NAME: &str = "hemilux";

/// The condition under which a request may change settings and see pictures.
#[derive(Clone, Debug)]
pub enum Access {
    /// None: every request that reaches the port may.
    Open,
    /// The request must carry the token or the session cookie.
    Token {
        /// The token that clients send.
        token: Token,
        /// The value of the session cookie, random for each run of the program.
        session: Token,
    },
}

impl Access {
    /// Requires `token`, or the cookie of a session that was opened with it.
    ///
    /// # Errors
    /// [`super::TokenError`] when there are no random numbers for the cookie.
    pub fn with_token(token: Token) -> Result<Self, super::TokenError> {
        Ok(Self::Token { token, session: Token::random()? })
    }

    /// Whether a request with these headers carries what is needed.
    pub(super) fn admits(&self, headers: &HeaderMap) -> bool {
        let Self::Token { token, session } = self else { return true };
        let mut given = headers.get_all(AUTHORIZATION).iter();
        let (first, second) = (given.next(), given.next());
        if let (Some(value), None) = (first, second) {
            return credential(value).is_some_and(|secret| token.is(&secret));
        }
        let cookies = headers.get_all(COOKIE).iter().filter_map(|v| v.to_str().ok());
        let mut pairs = cookies.flat_map(|v| v.split(';')).filter_map(|pair| pair.trim().split_once('='));
        first.is_none() && pairs.any(|(name, value)| name == COOKIE_NAME && session.is(value.as_bytes()))
    }
}

/// The secret in an Authorization header.
fn credential(value: &HeaderValue) -> Option<Vec<u8>> {
    let (scheme, rest) = value.to_str().ok()?.split_once(' ')?;
    let rest = rest.trim();
    if scheme.eq_ignore_ascii_case("bearer") {
        return Some(rest.into());
    }
    let decoded = scheme.eq_ignore_ascii_case("basic").then(|| BASE64.decode(rest.as_bytes()).ok())??;
    let colon = decoded.iter().position(|b| *b == b':')?;
    Some(decoded[colon + 1..].to_vec())
}

/// Proof that a request may change settings and see pictures: a handler that takes it is protected.
pub(super) struct Allowed;

impl FromRequestParts<Context> for Allowed {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, context: &Context) -> Result<Self, Response> {
        check(context, &parts.uri, &parts.headers).map_or(Ok(Self), Err)
    }
}

/// The refusal of a request that may not change settings and see pictures.
pub(super) fn check(context: &Context, uri: &Uri, headers: &HeaderMap) -> Option<Response> {
    if guard::is_foreign(uri, headers, &context.origins) {
        context.counts.refused("foreign");
        return Some(line(StatusCode::FORBIDDEN, "a request made by a page of another site"));
    }
    if context.access.admits(headers) {
        return None;
    }
    context.counts.refused("token");
    // Navigations get the log-in form. Pictures and programs get a Basic challenge, for which a browser shows a password dialog;
    // fetch requests of scripts get a Bearer challenge, for which it does not.
    let text = |name: HeaderName| headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let is_script = text(HeaderName::from_static("sec-fetch-mode")) == "cors";
    let person = text(ACCEPT).contains("text/html");
    let (mut response, challenge) = if person {
        (pages::login("This needs the probe's token.").into_response(), BEARER)
    } else {
        let text = "this needs the probe's token: as Authorization: Bearer TOKEN, as a Basic password, or log in at /login";
        (
            line(StatusCode::UNAUTHORIZED, text),
            if is_script {
                BEARER
            } else {
                "Basic realm=\"hemilux\", charset=\"UTF-8\", Bearer realm=\"hemilux\""
            },
        )
    };
    *response.status_mut() = StatusCode::UNAUTHORIZED;
    response.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
    Some(response)
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LogIn {
    token: String,
}

/// Shows the log-in form.
pub(super) async fn form(State(context): State<Context>) -> Response {
    match context.access {
        Access::Open => line(StatusCode::OK, "this probe has no token: there is nothing to log in to"),
        Access::Token { .. } => pages::login("").into_response(),
    }
}

/// Sets the session cookie when the form holds the token.
pub(super) async fn log_in(State(context): State<Context>, request: Request) -> Response {
    if guard::is_foreign(request.uri(), request.headers(), &context.origins) {
        context.counts.refused("foreign");
        return line(StatusCode::FORBIDDEN, "a log-in sent by a page of another site");
    }
    let form = tokio::time::timeout(BODY_TIME, Form::<LogIn>::from_request(request, &())).await;
    let Ok(Ok(Form(LogIn { token: given }))) = form else {
        return line(StatusCode::BAD_REQUEST, "found another body, expected the form's one field, token");
    };
    let Access::Token { token, session } = &context.access else {
        return line(StatusCode::OK, "this probe has no token: there is nothing to log in to");
    };
    if !token.is(given.trim().as_bytes()) {
        context.counts.refused("token");
        return (StatusCode::UNAUTHORIZED, pages::login("That is not the token.")).into_response();
    }
    let cookie = format!("{COOKIE_NAME}={}; Path=/; HttpOnly; SameSite=Strict", session.reveal());
    let mut response = StatusCode::SEE_OTHER.into_response();
    response.headers_mut().insert(LOCATION, HeaderValue::from_static("/"));
    // base64url is always a header value.
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(SET_COOKIE, cookie);
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_secret_is_found_in_both_schemes() {
        let secret = |text: &'static str| credential(&HeaderValue::from_static(text));
        // RFC 7617's and RFC 6750's own examples.
        assert_eq!(secret("Basic QWxhZGRpbjpvcGVuIHNlc2FtZQ=="), Some(b"open sesame".to_vec()), "Basic");
        assert_eq!(secret("bearer mF_9.B5f-4.1JqM"), Some(b"mF_9.B5f-4.1JqM".to_vec()), "Bearer");
        for other in ["", "Basic", "Basic !!!!", "Basic QWxhZGRpbg==", "Digest abc", "Bearer"] {
            assert_eq!(secret(other), None, "{other}");
        }
    }
}
