//! Who asks for a page, and whether a form came from our own.
//!
//! Every form carries a token that is made from the cookie of whoever it was drawn for: their session's, or, before they sign in,
//! one that serves nothing else. Another site can make a browser send the cookie, but can read neither it nor the token.

use axum::body::Bytes;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, IntoResponseParts, Redirect, Response, ResponseParts};
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use super::shell::{Visitor, problem};
use crate::accounts::{SESSION, user_of_session};
use crate::api::ApiError;
use crate::app::AppState;
use crate::leaderboard::percent_encoded;
use crate::receipt::to_hex;
use crate::store::User;

/// The cookie of a session.
const SESSION_COOKIE: &str = "relight_session";
/// The cookie of someone who is about to sign in or up.
const GUEST_COOKIE: &str = "relight_guest";

/// An answer that is a page which says why there is no other.
#[derive(Debug)]
pub struct PageError {
    error: ApiError,
    /// Whether a form was not one of ours.
    pub is_foreign: bool,
}

impl PageError {
    /// What happened, as programs are told.
    pub fn into_inner(self) -> ApiError {
        self.error
    }
}

impl<E: Into<ApiError>> From<E> for PageError {
    fn from(error: E) -> PageError {
        PageError { error: error.into(), is_foreign: false }
    }
}

impl IntoResponse for PageError {
    fn into_response(self) -> Response {
        let PageError { error, .. } = self;
        let title = match error.status {
            StatusCode::NOT_FOUND => "There is no such page",
            StatusCode::FORBIDDEN => "That is not allowed",
            StatusCode::TOO_MANY_REQUESTS => "Too many at once",
            status if status.is_server_error() => "The server failed",
            _ => "That did not work",
        };
        let page = problem(title, &error.message).into_string();
        let mut response = error.into_response();
        response.headers_mut().remove(header::CONTENT_LENGTH);
        response
            .headers_mut()
            .insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
        *response.body_mut() = page.into();
        response
    }
}

/// Who asks.
#[derive(Clone, Debug, Default)]
pub struct Guest {
    /// Who is signed in.
    pub user: Option<User>,
    /// The cookie that their forms' token is made from.
    cookie: Option<String>,
}

/// A cookie to be set, or to be forgotten if it is empty.
#[derive(Debug)]
pub struct SetCookie {
    name: &'static str,
    value: String,
    secure: bool,
}

impl IntoResponseParts for SetCookie {
    type Error = std::convert::Infallible;

    fn into_response_parts(self, mut parts: ResponseParts) -> Result<ResponseParts, Self::Error> {
        let age = if self.value.is_empty() { 0 } else { SESSION.as_secs() };
        let secure = if self.secure { "; Secure" } else { "" };
        let text =
            format!("{}={}; Path=/; Max-Age={age}; HttpOnly; SameSite=Lax{secure}", self.name, self.value);
        // Our cookies are digits, letters and underscores.
        if let Ok(value) = HeaderValue::from_str(&text) {
            parts.headers_mut().append(header::SET_COOKIE, value);
        }
        Ok(parts)
    }
}

/// The cookie of a session that has just begun, or, empty, of one that has ended.
pub fn session_cookie(app: &AppState, headers: &HeaderMap, session: String) -> SetCookie {
    SetCookie { name: SESSION_COOKIE, value: session, secure: is_secure(app, headers) }
}

/// Whether the browser speaks TLS, as the proxy says.
pub fn is_secure(app: &AppState, headers: &HeaderMap) -> bool {
    let told = headers.get("x-forwarded-proto").and_then(|value| value.to_str().ok());
    app.settings.behind_proxy && told.is_some_and(|proto| proto.eq_ignore_ascii_case("https"))
}

fn cookie<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    let all = headers.get_all(header::COOKIE).into_iter().filter_map(|value| value.to_str().ok());
    all.flat_map(|value| value.split(';')).find_map(|pair| pair.trim().strip_prefix(name)?.strip_prefix('='))
}

impl Guest {
    /// Who asks, by the cookies of a request.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn of(app: &AppState, headers: &HeaderMap) -> Result<Guest, PageError> {
        if let Some(session) = cookie(headers, SESSION_COOKIE)
            && let Some(user) = user_of_session(&app.store, session).await?
        {
            return Ok(Guest { user: Some(user), cookie: Some(session.to_owned()) });
        }
        Ok(Guest { user: None, cookie: cookie(headers, GUEST_COOKIE).map(str::to_owned) })
    }

    /// Whoever asks, as pages greet them.
    pub fn visitor(&self) -> Visitor {
        Visitor {
            name: self.user.as_ref().map(|user| user.name.clone()),
            is_admin: self.user.as_ref().is_some_and(|user| user.is_admin),
            form_token: self.cookie.as_deref().map(form_token).unwrap_or_default(),
        }
    }

    /// A visitor whose forms will be taken, and the cookie for that, if they have none yet.
    ///
    /// # Errors
    /// If there is no randomness.
    pub fn with_forms(
        mut self,
        app: &AppState,
        headers: &HeaderMap,
    ) -> Result<(Visitor, Option<SetCookie>), PageError> {
        let mut set = None;
        if self.cookie.is_none() {
            let mut random = [0; 32];
            getrandom::fill(&mut random).map_err(|_| ApiError::internal())?;
            let value = to_hex(&random);
            set =
                Some(SetCookie { name: GUEST_COOKIE, value: value.clone(), secure: is_secure(app, headers) });
            self.cookie = Some(value);
        }
        Ok((self.visitor(), set))
    }

    /// Whether a form was drawn for whoever sends it.
    ///
    /// # Errors
    /// 403 if not.
    pub fn check_form(&self, token: &str) -> Result<(), PageError> {
        let expected = self.cookie.as_deref().map(form_token).unwrap_or_default();
        if expected.is_empty() || !bool::from(expected.as_bytes().ct_eq(token.as_bytes())) {
            let message = "the form is not from this site, or is too old. Go back, load the page again and repeat it; cookies \
                           must be allowed";
            return Err(PageError { error: ApiError::new(StatusCode::FORBIDDEN, message), is_foreign: true });
        }
        Ok(())
    }

    /// The session's cookie of whoever is signed in.
    pub fn session(&self) -> Option<&str> {
        self.user.as_ref().and(self.cookie.as_deref())
    }

    /// The admin who is signed in.
    ///
    /// # Errors
    /// 403 for all others.
    pub fn admin(&self) -> Result<&User, PageError> {
        let refused = || ApiError::new(StatusCode::FORBIDDEN, "this page is for admins; sign in as one");
        Ok(self.user.as_ref().filter(|user| user.is_admin).ok_or_else(refused)?)
    }

    /// Whoever is signed in; others are sent to sign in and come back to `here`.
    ///
    /// # Errors
    /// The redirection.
    pub fn signed_in(&self, here: &str) -> Result<&User, Redirect> {
        let to_sign_in = || Redirect::to(&format!("/sign-in?next={}", percent_encoded(here)));
        self.user.as_ref().ok_or_else(to_sign_in)
    }
}

fn form_token(cookie: &str) -> String {
    to_hex(&Sha256::digest(format!("relight form\n{cookie}")))
}

impl FromRequestParts<AppState> for Guest {
    type Rejection = PageError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Guest, PageError> {
        Guest::of(app, &parts.headers).await
    }
}

/// A short form that came from one of our pages.
#[derive(Debug)]
pub struct Posted<T> {
    /// Who sent it.
    pub guest: Guest,
    /// What was filled in.
    pub form: T,
}

impl<T: DeserializeOwned> FromRequest<AppState> for Posted<T> {
    type Rejection = PageError;

    async fn from_request(request: Request, app: &AppState) -> Result<Posted<T>, PageError> {
        let guest = Guest::of(app, request.headers()).await?;
        let bad = |problem: String| ApiError::new(StatusCode::BAD_REQUEST, problem);
        let body = Bytes::from_request(request, app).await.map_err(|error| bad(error.to_string()))?;
        let fields: Vec<(String, String)> =
            serde_urlencoded::from_bytes(&body).map_err(|error| bad(error.to_string()))?;
        let token = fields.iter().find(|(name, _)| name == "form_token").map_or("", |(_, token)| token);
        guest.check_form(token)?;
        let form = serde_urlencoded::from_bytes(&body).map_err(|error| bad(format!("the form: {error}")))?;
        Ok(Posted { guest, form })
    }
}
