//! Signing up, in and out, and the account.

use axum::Extension;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;

use super::account;
use super::session::{Guest, PageError, Posted, session_cookie};
use crate::accounts::{self, AccountError};
use crate::api::ApiError;
use crate::app::{AppState, Client};

/// Where to go after signing in.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Next {
    #[serde(default)]
    next: String,
}

/// A path on this site, whatever was asked for.
fn on_this_site(next: &str) -> &str {
    let is_path =
        next.starts_with('/') && !next.starts_with("//") && !next.contains(['\\', '\r', '\n', '\t']);
    if is_path { next } else { "/account/submissions" }
}

pub(super) async fn sign_in_form(
    State(app): State<AppState>,
    Query(Next { next }): Query<Next>,
    headers: HeaderMap,
    guest: Guest,
) -> Result<Response, PageError> {
    if guest.user.is_some() {
        return Ok(Redirect::to(on_this_site(&next)).into_response());
    }
    let (visitor, cookie) = guest.with_forms(&app, &headers)?;
    Ok((cookie, Html(account::sign_in(&visitor, "", "", &next).into_string())).into_response())
}

#[derive(Debug, Deserialize)]
pub(super) struct SignIn {
    name: String,
    password: String,
    #[serde(default)]
    next: String,
}

pub(super) async fn sign_in(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    headers: HeaderMap,
    Posted { guest, form }: Posted<SignIn>,
) -> Result<Response, PageError> {
    app.rates.sign_in(client.0)?;
    match accounts::sign_in(&app.store, &form.name, &form.password).await {
        Ok((_, session)) => {
            let cookie = session_cookie(&app, &headers, session);
            Ok((cookie, Redirect::to(on_this_site(&form.next))).into_response())
        }
        Err(error) => {
            let ApiError { status, message, .. } = error.into();
            let page = account::sign_in(&guest.visitor(), &form.name, &capital(&message), &form.next);
            Ok((status, Html(page.into_string())).into_response())
        }
    }
}

pub(super) async fn sign_up_form(
    State(app): State<AppState>,
    headers: HeaderMap,
    guest: Guest,
) -> Result<Response, PageError> {
    if guest.user.is_some() {
        return Ok(Redirect::to("/account").into_response());
    }
    let (visitor, cookie) = guest.with_forms(&app, &headers)?;
    Ok((cookie, Html(account::sign_up(&visitor, "", "", "").into_string())).into_response())
}

#[derive(Debug, Deserialize)]
pub(super) struct SignUp {
    name: String,
    email: String,
    password: String,
}

pub(super) async fn sign_up(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    headers: HeaderMap,
    Posted { guest, form }: Posted<SignUp>,
) -> Result<Response, PageError> {
    app.rates.sign_in(client.0)?;
    let made = match accounts::sign_up(&app.store, &form.name, &form.email, &form.password).await {
        Ok(user) => accounts::new_session(&app.store, &user).await,
        Err(error) => Err(error),
    };
    match made {
        Ok(session) => {
            let cookie = session_cookie(&app, &headers, session);
            Ok((cookie, Redirect::to("/account")).into_response())
        }
        Err(error) => {
            let ApiError { status, message, .. } = error.into();
            let page = account::sign_up(&guest.visitor(), &form.name, &form.email, &capital(&message));
            Ok((status, Html(page.into_string())).into_response())
        }
    }
}

#[derive(Debug, Deserialize)]
pub(super) struct Nothing {}

pub(super) async fn sign_out(
    State(app): State<AppState>,
    headers: HeaderMap,
    Posted { guest, .. }: Posted<Nothing>,
) -> Result<Response, PageError> {
    if let Some(session) = guest.session() {
        accounts::sign_out(&app.store, session).await?;
    }
    Ok((session_cookie(&app, &headers, String::new()), Redirect::to("/")).into_response())
}

pub(super) async fn account(State(app): State<AppState>, guest: Guest) -> Result<Response, PageError> {
    account_page(&app, &guest, StatusCode::OK, None, "").await
}

async fn account_page(
    app: &AppState,
    guest: &Guest,
    status: StatusCode,
    new_token: Option<&str>,
    problem: &str,
) -> Result<Response, PageError> {
    let user = match guest.signed_in("/account") {
        Ok(user) => user,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    let tokens = app.store.tokens(user).await?;
    let page = account::account(&guest.visitor(), user, &tokens, new_token, &capital(problem));
    Ok((status, Html(page.into_string())).into_response())
}

#[derive(Debug, Deserialize)]
pub(super) struct NewToken {
    name: String,
}

/// Answers with the page itself and not with a redirection: the token is nowhere but in this answer.
pub(super) async fn new_token(
    State(app): State<AppState>,
    Posted { guest, form }: Posted<NewToken>,
) -> Result<Response, PageError> {
    let user = match guest.signed_in("/account") {
        Ok(user) => user,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    match accounts::new_token(&app.store, user, &form.name, &user.name).await {
        Ok(token) => account_page(&app, &guest, StatusCode::OK, Some(&token), "").await,
        Err(error) => refused(&app, &guest, error).await,
    }
}

async fn refused(app: &AppState, guest: &Guest, error: AccountError) -> Result<Response, PageError> {
    let ApiError { status, message, .. } = error.into();
    account_page(app, guest, status, None, &message).await
}

pub(super) async fn revoke_token(
    State(app): State<AppState>,
    Path(token): Path<i64>,
    Posted { guest, .. }: Posted<Nothing>,
) -> Result<Response, PageError> {
    match guest.signed_in("/account") {
        Ok(user) => app.store.revoke_token(user, token).await?,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    }
    Ok(Redirect::to("/account").into_response())
}

#[derive(Debug, Deserialize)]
pub(super) struct NewPassword {
    old: String,
    new: String,
}

/// Ends all sessions, this one too, and begins a new one.
pub(super) async fn new_password(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    headers: HeaderMap,
    Posted { guest, form }: Posted<NewPassword>,
) -> Result<Response, PageError> {
    let user = match guest.signed_in("/account") {
        Ok(user) => user,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    app.rates.sign_in(client.0)?;
    let changed = match accounts::sign_in(&app.store, &user.name, &form.old).await {
        Ok(_) => match accounts::set_password(&app.store, user, &form.new, &user.name).await {
            Ok(()) => accounts::new_session(&app.store, user).await,
            Err(error) => Err(error),
        },
        Err(AccountError::Unknown) => Err(AccountError::Unfit("the old password is another".to_owned())),
        Err(error) => Err(error),
    };
    match changed {
        Ok(session) => {
            Ok((session_cookie(&app, &headers, session), Redirect::to("/account")).into_response())
        }
        Err(error) => refused(&app, &guest, error).await,
    }
}

/// A message as a sentence of its own.
pub(super) fn capital(message: &str) -> String {
    let mut letters = message.chars();
    let first = letters.next().map(|letter| letter.to_uppercase().to_string()).unwrap_or_default();
    let end = if message.is_empty() || message.ends_with('.') { "" } else { "." };
    format!("{first}{}{end}", letters.as_str())
}
