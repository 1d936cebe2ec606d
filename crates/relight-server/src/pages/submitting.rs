//! Submitting from a form, and what users do with what they have submitted.

use std::time::Duration;

use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{FromRequest, Multipart, Path, Query, Request, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use tokio::time::{Instant, timeout_at};

use super::browse::submission_page;
use super::history::{self, Line, Pages};
use super::members::{Nothing, capital};
use super::session::{Guest, PageError, Posted};
use crate::api::{ApiError, Part};
use crate::app::AppState;
use crate::disclosure::tell_mean;
use crate::leaderboard::percent_encoded;
use crate::method::{Method, Phase, Visibility};
use crate::store::{BenchmarkEntry, SubmissionEntry, User};
use crate::time::Time;
use crate::upload::{Upload, begin, receive_within};

/// The longest field of the form besides the zip, bytes.
const FIELD: usize = 32 << 10;
/// How long all of these together may take.
const FIELDS_TIME: Duration = Duration::from_secs(30);
/// Fields of the form at most.
const FIELDS: usize = 20;

pub(super) async fn history(
    State(app): State<AppState>,
    Query(part): Query<Part>,
    guest: Guest,
) -> Result<Response, PageError> {
    let page = part.page();
    let user = match guest.signed_in("/account/submissions") {
        Ok(user) => user,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    let (all, has_more) = app.store.submissions_page(Some(user.id), page).await?;
    let lines: Vec<Line> = all.into_iter().map(line).collect();
    let open = app.store.benchmarks().await?.into_iter().filter(|benchmark| benchmark.open);
    let open: Vec<String> = open.map(|benchmark| benchmark.name).collect();
    Ok(Html(history::history(&guest.visitor(), &lines, Pages { page, has_more }, &open).into_string())
        .into_response())
}

fn line(entry: SubmissionEntry) -> Line {
    let means = entry.scores.iter().flat_map(|scores| &scores.means).map(tell_mean);
    Line {
        means: means.map(|mean| (mean.split.to_string(), mean.psnr, mean.ssim)).collect(),
        id: entry.id,
        benchmark: entry.benchmark,
        method: entry.method.name,
        phase: entry.phase,
        visibility: entry.visibility,
        state: entry.state,
        submitted_at: entry.submitted_at.to_string(),
        withdrawn: entry.withdrawn_at.is_some(),
    }
}

pub(super) async fn upload_form(
    State(app): State<AppState>,
    Path(name): Path<String>,
    guest: Guest,
) -> Result<Response, PageError> {
    let benchmark = app.store.benchmark(&name).await?;
    match guest.signed_in(&format!("/benchmarks/{}/upload", percent_encoded(&name))) {
        Ok(user) => upload_page(&app, &guest, user, &benchmark, StatusCode::OK, "").await,
        Err(to_sign_in) => Ok(to_sign_in.into_response()),
    }
}

async fn upload_page(
    app: &AppState,
    guest: &Guest,
    user: &User,
    benchmark: &BenchmarkEntry,
    status: StatusCode,
    problem: &str,
) -> Result<Response, PageError> {
    let usage = async |phase| {
        Ok::<_, PageError>((phase, app.store.quota_use(benchmark, user, phase, Time::now()).await?))
    };
    let quotas = [usage(Phase::Val).await?, usage(Phase::Test).await?];
    let page = history::upload(&guest.visitor(), &benchmark.name, benchmark.open, quotas, &capital(problem));
    Ok((status, Html(page.into_string())).into_response())
}

/// Takes a zip in from the form: the fields first, then the zip, which streams to the disk.
pub(super) async fn upload(
    State(app): State<AppState>,
    Path(name): Path<String>,
    guest: Guest,
    request: Request,
) -> Result<Response, PageError> {
    let benchmark = app.store.benchmark(&name).await?;
    let user = match guest.signed_in(&format!("/benchmarks/{}/upload", percent_encoded(&name))) {
        Ok(user) => user,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    let multipart = Multipart::from_request(request, &app).await;
    let multipart = multipart.map_err(|error| ApiError::new(StatusCode::BAD_REQUEST, error.to_string()))?;
    match take_in(&app, &guest, user, &name, multipart).await {
        Ok(id) => Ok(Redirect::to(&format!("/submissions/{id}")).into_response()),
        // A foreign form learns nothing of the account.
        Err(error) if error.is_foreign => Err(error),
        Err(error) => {
            let ApiError { status, message, .. } = error.into_inner();
            upload_page(&app, &guest, user, &benchmark, status, &message).await
        }
    }
}

async fn take_in(
    app: &AppState,
    guest: &Guest,
    user: &User,
    benchmark: &str,
    mut multipart: Multipart,
) -> Result<String, PageError> {
    let bad = |problem: String| ApiError::new(StatusCode::BAD_REQUEST, problem);
    let broken = |error: MultipartError| bad(error.body_text());
    // Whoever may not upload now is told so once the form is known to be ours.
    let slot = begin(app, user.id);
    let until = Instant::now() + FIELDS_TIME;
    let (mut method, mut phase, mut visibility) = (Method::default(), None, None);
    let mut is_ours = false;
    for _ in 0..FIELDS {
        let next = timeout_at(until, multipart.next_field()).await.map_err(|_| too_slow())?;
        let Some(field) = next.map_err(broken)? else { break };
        let name = field.name().unwrap_or("").to_owned();
        if name == "form_token" {
            guest.check_form(&short(field, until).await?)?;
            is_ours = true;
            continue;
        }
        if !is_ours {
            // The token comes first, before anything is read that may be long.
            guest.check_form("")?;
        }
        if name == "zip" {
            let phase = phase.ok_or_else(|| bad("say which images the zip shows".to_owned()))?;
            let visibility = visibility.ok_or_else(|| bad("say who shall see it".to_owned()))?;
            let method = method.checked()?;
            if visibility == Visibility::Anonymous {
                method.check_anonymous(user).map_err(bad)?;
            }
            let upload = Upload {
                user: user.clone(),
                benchmark: benchmark.to_owned(),
                phase,
                visibility,
                method,
                declared: None,
            };
            return Ok(receive_within(app, slot, upload, field).await?);
        }
        let text = short(field, until).await?;
        let line = match name.as_str() {
            "method" => &mut method.name,
            "authors" => &mut method.authors,
            "description" => &mut method.description,
            "paper" => &mut method.paper,
            "code" => &mut method.code,
            "hardware" => &mut method.hardware,
            "training_time" => &mut method.training_time,
            "phase" => {
                phase = Some(text.parse::<Phase>().map_err(bad)?);
                continue;
            }
            "visibility" => {
                visibility = Some(text.parse::<Visibility>().map_err(bad)?);
                continue;
            }
            _ => return Err(bad("the form has a field that it should not have".to_owned()).into()),
        };
        // Browsers send line breaks as CR LF.
        *line = text.replace("\r\n", "\n");
    }
    if !is_ours {
        guest.check_form("")?;
    }
    Err(bad("there is no zip in the form, or it does not come last".to_owned()).into())
}

fn too_slow() -> ApiError {
    ApiError::new(StatusCode::REQUEST_TIMEOUT, "the form came too slowly")
}

/// The text of a field that is not the zip.
async fn short(mut field: Field<'_>, until: Instant) -> Result<String, PageError> {
    let bad = |problem: &str| ApiError::new(StatusCode::BAD_REQUEST, problem);
    let mut text = Vec::new();
    loop {
        let chunk = timeout_at(until, field.chunk()).await.map_err(|_| too_slow())?;
        let Some(chunk) = chunk.map_err(|error| bad(&error.body_text()))? else { break };
        text.extend_from_slice(&chunk);
        if text.len() > FIELD {
            return Err(bad("a field of the form is too long").into());
        }
    }
    String::from_utf8(text).map_err(|_| bad("a field of the form is not UTF-8").into())
}

#[derive(Debug, Deserialize)]
pub(super) struct To {
    to: Visibility,
}

pub(super) async fn set_visibility(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Posted { guest, form }: Posted<To>,
) -> Result<Response, PageError> {
    let here = format!("/submissions/{}", percent_encoded(&id));
    match guest.signed_in(&here) {
        Ok(user) => app.store.set_visibility(&id, user, form.to).await?,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    }
    app.boards.changed();
    Ok(Redirect::to(&here).into_response())
}

pub(super) async fn withdraw(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Posted { guest, .. }: Posted<Nothing>,
) -> Result<Response, PageError> {
    let here = format!("/submissions/{}", percent_encoded(&id));
    let withdrawn = match guest.signed_in(&here) {
        Ok(user) => app.withdraw(&id, user).await,
        Err(to_sign_in) => return Ok(to_sign_in.into_response()),
    };
    app.boards.changed();
    match withdrawn {
        Ok(()) => Ok(Redirect::to(&here).into_response()),
        Err(crate::store::StoreError::Refused(problem)) => {
            Ok(submission_page(&app, &id, &guest, &capital(&problem)).await?.into_response())
        }
        Err(error) => Err(error.into()),
    }
}
