//! Access control for changes of settings and for pictures.
//!
//! With a token, a request must carry it as `Authorization: Bearer`, as the password of `Authorization: Basic` (for old clients and for pictures
//! in pages; the user name is ignored), or carry the cookie that the log-in form sets. A token in a URL is not accepted. Browsers add cookies
//! and Basic passwords to every request to the server, so requests that a page of another site caused are always refused.

use super::attempts::Attempts;
use super::client_key::ClientKey;
use super::origin::{Cause, Sender};
use super::proxy::Scheme;
use super::token::Token;
use super::{Context, line, pages};
use axum::extract::{Form, FromRequest, FromRequestParts, Request, State};
use axum::http::header::{AUTHORIZATION, COOKIE, LOCATION, RETRY_AFTER, SET_COOKIE, WWW_AUTHENTICATE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use data_encoding::BASE64;
use std::time::{Duration, Instant};

/// Longest time within which the body of a request must arrive.
pub(super) const BODY_TIME: Duration = Duration::from_secs(5);

const BEARER: &str = "Bearer realm=\"hemilux\"";
const BASIC_OR_BEARER: &str = "Basic realm=\"hemilux\", charset=\"UTF-8\", Bearer realm=\"hemilux\"";

const COOKIE_NAME: &str = "hemilux";

/// The condition under which a request may change settings and get pictures.
#[derive(Clone, Debug)]
pub enum Access {
    /// Every request is admitted, without a token.
    Open,
    /// The request must carry the token or the session cookie.
    Token {
        /// The token that clients must send for protected requests.
        token: Token,
        /// The value of the session cookie, random for each run of the program.
        session: Token,
    },
}

/// Reasons why a request is not admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Denial {
    /// The request carries no credentials.
    Missing,
    /// The token or the session cookie of the request is wrong.
    Wrong,
    /// The client has sent too many wrong tokens: its credentials are not checked for this duration.
    Blocked(Duration),
}

impl Access {
    /// Requires `token`, or the cookie of a session that was opened with the token.
    ///
    /// # Errors
    /// [`super::TokenError`] when the operating system provides no random numbers for the cookie.
    pub fn with_token(token: Token) -> Result<Self, super::TokenError> {
        Ok(Self::Token { token, session: Token::random()? })
    }

    /// Checks the credentials in `headers`; a wrong token is counted as a failed attempt of `client`.
    pub(super) fn admit(
        &self,
        headers: &HeaderMap,
        client: ClientKey,
        attempts: &Attempts,
    ) -> Result<(), Denial> {
        let Self::Token { session, .. } = self else { return Ok(()) };
        let mut given = headers.get_all(AUTHORIZATION).iter();
        match (given.next(), given.next()) {
            (Some(value), None) => {
                self.check(&credential(value).map_or(Vec::new(), |c| c.secret), client, attempts)
            }
            (Some(_), Some(_)) => Err(Denial::Wrong),
            // The value of the session cookie has 256 random bits: it cannot be guessed.
            (None, _) if cookies(headers).any(|value| session.is(value.as_bytes())) => Ok(()),
            (None, _) => Err(Denial::Missing),
        }
    }

    /// Checks whether `secret` is the token, unless `client` has sent too many wrong tokens.
    fn check(&self, secret: &[u8], client: ClientKey, attempts: &Attempts) -> Result<(), Denial> {
        let Self::Token { token, .. } = self else { return Ok(()) };
        let now = Instant::now();
        if let Some(wait) = attempts.blocked(client, now) {
            return Err(Denial::Blocked(wait));
        }
        if token.is(secret) {
            return Ok(());
        }
        attempts.failed(client, now);
        Err(Denial::Wrong)
    }
}

/// Returns the values of all session cookies in the headers of a request.
fn cookies(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    let all = headers.get_all(COOKIE).iter().filter_map(|v| v.to_str().ok());
    let pairs = all.flat_map(|v| v.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.filter(|(name, _)| *name == COOKIE_NAME).map(|(_, value)| value)
}

/// The secret in an Authorization header, and the scheme of the header: Basic or Bearer.
#[derive(Debug, PartialEq, Eq)]
struct Credential {
    is_basic: bool,
    secret: Vec<u8>,
}

fn credential(value: &HeaderValue) -> Option<Credential> {
    let (scheme, rest) = value.to_str().ok()?.split_once(' ')?;
    let rest = rest.trim();
    if scheme.eq_ignore_ascii_case("bearer") {
        return Some(Credential { is_basic: false, secret: rest.into() });
    }
    let decoded = scheme.eq_ignore_ascii_case("basic").then(|| BASE64.decode(rest.as_bytes()).ok())??;
    let colon = decoded.iter().position(|b| *b == b':')?;
    Some(Credential { is_basic: true, secret: decoded[colon + 1..].to_vec() })
}

/// Returns true if a request carries Basic credentials, which a browser stores and adds by itself.
pub(super) fn is_basic(headers: &HeaderMap) -> bool {
    headers.get_all(AUTHORIZATION).iter().filter_map(credential).any(|c| c.is_basic)
}

/// Returns true if a request carries a Bearer token, which no page of another site can add.
pub(super) fn is_bearer(headers: &HeaderMap) -> bool {
    headers.get_all(AUTHORIZATION).iter().filter_map(credential).any(|c| !c.is_basic)
}

/// Proof that a request may change settings and get pictures: a handler with this argument is protected.
pub(super) struct Allowed;

impl FromRequestParts<Context> for Allowed {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, context: &Context) -> Result<Self, Response> {
        check(context, &Sender::of(parts)).map_or(Ok(Self), Err)
    }
}

/// Returns the refusal of a request that may not change settings and get pictures; `None` for an admitted one.
pub(super) fn check(context: &Context, sender: &Sender) -> Option<Response> {
    if sender.cause(&context.admission.origins) == Cause::ForeignPage {
        return Some(foreign(context, "a request made by a page of another site"));
    }
    let denial = context
        .admission
        .access
        .admit(&sender.headers, sender.client.key(), &context.admission.attempts)
        .err()?;
    Some(denied(context, sender, denial))
}

/// Counts and returns the refusal of a request that a page of another site caused.
pub(super) fn foreign(context: &Context, text: &str) -> Response {
    context.counts.refused("foreign");
    line(StatusCode::FORBIDDEN, text)
}

fn denied(context: &Context, sender: &Sender, denial: Denial) -> Response {
    if let Denial::Blocked(wait) = denial {
        return blocked(context, wait);
    }
    context.counts.refused("token");
    // Navigations get the log-in form. Pictures and programs get a Basic challenge, for which a browser shows a password dialog;
    // fetch requests of scripts get a Bearer challenge, for which a browser shows no dialog.
    let accepts_pages =
        sender.text(&axum::http::header::ACCEPT).is_some_and(|accept| accept.contains("text/html"));
    let is_script = sender.text(&HeaderName::from_static("sec-fetch-mode")) == Some("cors");
    let mut response = if accepts_pages {
        pages::login("This needs the probe's token.").into_response()
    } else {
        let text = "this needs the probe's token: as Authorization: Bearer TOKEN, as a Basic password, or log in at /login";
        line(StatusCode::UNAUTHORIZED, text)
    };
    let challenge = if accepts_pages || is_script { BEARER } else { BASIC_OR_BEARER };
    *response.status_mut() = StatusCode::UNAUTHORIZED;
    response.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
    response
}

/// Counts and returns the refusal of a client whose credentials are not checked for the duration `wait`.
fn blocked(context: &Context, wait: Duration) -> Response {
    context.counts.refused("guessing");
    let seconds = wait.as_secs() + 1;
    let text = format!("too many wrong tokens from this address: wait {seconds} s");
    let mut response = line(StatusCode::TOO_MANY_REQUESTS, &text);
    response.headers_mut().insert(RETRY_AFTER, seconds.into());
    response
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LogIn {
    token: String,
}

/// Answers a request for `/login` with the log-in form.
pub(super) async fn form(State(context): State<Context>) -> Response {
    match context.admission.access {
        Access::Open => no_token(),
        Access::Token { .. } => pages::login("").into_response(),
    }
}

fn no_token() -> Response {
    line(StatusCode::OK, "this probe has no token: no log-in is needed")
}

/// Answers a submitted log-in form: sets the session cookie if the form contains the token.
pub(super) async fn log_in(State(context): State<Context>, sender: Sender, request: Request) -> Response {
    if sender.cause(&context.admission.origins) == Cause::ForeignPage {
        return foreign(&context, "a log-in sent by a page of another site");
    }
    let form = tokio::time::timeout(BODY_TIME, Form::<LogIn>::from_request(request, &())).await;
    let Ok(Ok(Form(LogIn { token: given }))) = form else {
        return line(StatusCode::BAD_REQUEST, "found another body, expected the form's one field, token");
    };
    let Access::Token { session, .. } = &context.admission.access else { return no_token() };
    match context.admission.access.check(
        given.trim().as_bytes(),
        sender.client.key(),
        &context.admission.attempts,
    ) {
        Ok(()) => logged_in(session, sender.client.scheme),
        Err(Denial::Blocked(wait)) => blocked(&context, wait),
        Err(_) => {
            context.counts.refused("token");
            (StatusCode::UNAUTHORIZED, pages::login("That is not the token.")).into_response()
        }
    }
}

/// Returns the answer to a log-in: a redirection with a Set-Cookie header. For a client that uses HTTPS, the cookie is restricted to HTTPS.
fn logged_in(session: &Token, scheme: Scheme) -> Response {
    let secure = if scheme == Scheme::Https { "; Secure" } else { "" };
    let cookie = format!("{COOKIE_NAME}={}; Path=/; HttpOnly; SameSite=Strict{secure}", session.reveal());
    let mut response = StatusCode::SEE_OTHER.into_response();
    response.headers_mut().insert(LOCATION, HeaderValue::from_static("/"));
    // Every base64url text is a valid header value.
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(SET_COOKIE, cookie);
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_secret_is_parsed_in_both_schemes() {
        let secret = |text: &'static str| credential(&HeaderValue::from_static(text)).map(|c| c.secret);
        // The examples of RFC 7617 and RFC 6750.
        assert_eq!(secret("Basic QWxhZGRpbjpvcGVuIHNlc2FtZQ=="), Some(b"open sesame".to_vec()), "Basic");
        assert_eq!(secret("bearer mF_9.B5f-4.1JqM"), Some(b"mF_9.B5f-4.1JqM".to_vec()), "Bearer");
        for other in ["", "Basic", "Basic !!!!", "Basic QWxhZGRpbg==", "Digest abc", "Bearer"] {
            assert_eq!(secret(other), None, "{other}");
        }
    }
}
