//! Submissions: sending, asking after, withdrawing.

use std::num::NonZeroU32;

use axum::body::Body;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::ApiError;
use crate::accounts::user_of_token;
use crate::app::{App, AppState, Client};
use crate::disclosure::{ToldScores, tell};
use crate::method::{Method, Phase, Visibility};
use crate::receipt::Receipt;
use crate::store::{State as Progressing, StoreError, SubmissionEntry, User};
use crate::submission::Problem;
use crate::time::Time;
use crate::upload::{Upload, receive};

/// What the header `Authorization` says of who asks, if there is one.
///
/// # Errors
/// 401 if the token is none, 429 after too many of those.
async fn caller(app: &App, headers: &HeaderMap, client: Client) -> Result<Option<User>, ApiError> {
    let Some(value) = headers.get(header::AUTHORIZATION) else { return Ok(None) };
    let token = value.to_str().ok().and_then(|value| {
        let (scheme, token) = value.split_once(' ')?;
        scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
    });
    let user = match token {
        Some(token) => user_of_token(&app.store, token).await?,
        None => None,
    };
    if user.is_none() {
        app.rates.wrong_token(client.0)?;
        return Err(ApiError::unauthorized());
    }
    Ok(user)
}

/// As [`caller`], but someone must ask.
async fn known_caller(app: &App, headers: &HeaderMap, client: Client) -> Result<User, ApiError> {
    caller(app, headers, client).await?.ok_or_else(ApiError::unauthorized)
}

/// What is said of a submission in the query; what is left out may stand in headers `X-Relight-Method`,
/// `X-Relight-Training-Time`, ….
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Told {
    method: Option<String>,
    authors: Option<String>,
    description: Option<String>,
    paper: Option<String>,
    code: Option<String>,
    hardware: Option<String>,
    training_time: Option<String>,
    phase: Option<String>,
    visibility: Option<String>,
}

impl Told {
    /// The metadata, from the query first, then from headers.
    fn read(self, headers: &HeaderMap) -> Result<(Method, Phase, Visibility), ApiError> {
        let bad = |problem: String| ApiError::new(StatusCode::BAD_REQUEST, problem);
        let or_header = |said: Option<String>, name: &str| {
            if let Some(said) = said {
                return Ok(said);
            }
            let Some(value) = headers.get(format!("x-relight-{name}")) else { return Ok(String::new()) };
            let text = std::str::from_utf8(value.as_bytes());
            text.map(str::to_owned).map_err(|_| bad(format!("the header X-Relight-{name} is not UTF-8")))
        };
        let method = Method {
            name: or_header(self.method, "method")?,
            authors: or_header(self.authors, "authors")?,
            description: or_header(self.description, "description")?,
            paper: or_header(self.paper, "paper")?,
            code: or_header(self.code, "code")?,
            hardware: or_header(self.hardware, "hardware")?,
            training_time: or_header(self.training_time, "training-time")?,
        };
        let phase = or_header(self.phase, "phase")?;
        let phase = if phase.is_empty() { Ok(Phase::Test) } else { phase.parse() };
        let visibility = or_header(self.visibility, "visibility")?;
        let visibility = if visibility.is_empty() { Ok(Visibility::Public) } else { visibility.parse() };
        let phase = phase.map_err(|problem| bad(format!("phase: {problem}")))?;
        let visibility = visibility.map_err(|problem| bad(format!("visibility: {problem}")))?;
        Ok((method, phase, visibility))
    }
}

/// Takes a zip in: `POST /api/v1/benchmarks/NAME/submissions`.
pub(super) async fn submit(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    Path(benchmark): Path<String>,
    Query(told): Query<Told>,
    headers: HeaderMap,
    body: Body,
) -> Result<(StatusCode, Json<Value>), ApiError> {
    let user = known_caller(&app, &headers, client).await?;
    let (mut method, phase, visibility) = told.read(&headers)?;
    if method.name.is_empty() {
        method.name.clone_from(&user.name);
    }
    let method = method.checked()?;
    if visibility == Visibility::Anonymous {
        method.check_anonymous(&user).map_err(|problem| ApiError::new(StatusCode::BAD_REQUEST, problem))?;
    }
    let declared = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse().ok());
    let upload = Upload { user, benchmark, phase, visibility, method, declared };
    let id = receive(&app, upload, body.into_data_stream()).await?;
    Ok((StatusCode::ACCEPTED, Json(json!({ "id": id, "state": "queued" }))))
}

/// A submission as it is told.
#[derive(Debug, Serialize)]
pub(super) struct ToldSubmission {
    id: String,
    benchmark: String,
    phase: Phase,
    visibility: Visibility,
    method: Method,
    state: Progressing,
    /// From 0 to 1 while it is being scored.
    progress: Option<f64>,
    submitted_at: Time,
    finished_at: Option<Time>,
    reason: Option<String>,
    problems: Vec<Problem>,
    more_problems: usize,
    scores: Option<ToldScores>,
    receipt: Option<Receipt>,
    /// Told to its user alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    own: Option<Own>,
}

/// What only its user is told.
#[derive(Debug, Serialize)]
pub(super) struct Own {
    sha256: String,
    bytes: u64,
    hidden: bool,
    withdrawn_at: Option<Time>,
}

fn told(app: &App, entry: SubmissionEntry, is_own: bool) -> ToldSubmission {
    let progress = match entry.state {
        Progressing::Scoring => {
            let progress = app.progress(&entry.id);
            Some(progress.map_or(0.0, |p| p.done as f64 / p.all.max(1) as f64))
        }
        _ => None,
    };
    let (problems, more_problems) = entry.problems.map_or_else(Default::default, |r| (r.problems, r.more));
    let mut method = entry.method;
    if entry.visibility == Visibility::Anonymous && !is_own {
        // All but the name may say whose it is.
        method = Method { name: method.name, ..Method::default() };
    }
    ToldSubmission {
        progress,
        method,
        problems,
        more_problems,
        benchmark: entry.benchmark,
        phase: entry.phase,
        visibility: entry.visibility,
        state: entry.state,
        submitted_at: entry.submitted_at,
        finished_at: entry.finished_at,
        reason: entry.reason,
        scores: entry.scores.as_ref().map(tell),
        receipt: entry.receipt,
        own: is_own.then_some(Own {
            sha256: entry.sha256,
            bytes: entry.bytes,
            hidden: entry.hidden,
            withdrawn_at: entry.withdrawn_at,
        }),
        id: entry.id,
    }
}

/// A submission, if whoever asks may see it: `GET /api/v1/submissions/ID`. Others are told that there is none.
pub(super) async fn one(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Json<ToldSubmission>, ApiError> {
    let caller = caller(&app, &headers, client).await?;
    let entry = app.store.submission(&id).await?;
    let is_own = caller.is_some_and(|user| user.id == entry.user);
    let is_open = entry.visibility != Visibility::Private && !entry.hidden && entry.withdrawn_at.is_none();
    if !is_own && !is_open {
        return Err(StoreError::Missing { what: "submission", name: id }.into());
    }
    Ok(Json(told(&app, entry, is_own)))
}

/// Which part of a list is asked for, in queries.
#[derive(Debug, Deserialize)]
pub(crate) struct Part {
    page: Option<NonZeroU32>,
}

impl Part {
    /// The part, from 1.
    pub(crate) fn page(&self) -> u32 {
        self.page.map_or(1, NonZeroU32::get)
    }
}

/// Submissions of whoever asks, newest first, 50 at a time: `GET /api/v1/submissions?page=1`. `next` is the page that follows.
pub(super) async fn own(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    Query(part): Query<Part>,
    headers: HeaderMap,
) -> Result<Json<Value>, ApiError> {
    let user = known_caller(&app, &headers, client).await?;
    let page = part.page();
    let (entries, has_more) = app.store.submissions_page(Some(user.id), page).await?;
    let entries: Vec<_> = entries.into_iter().map(|entry| told(&app, entry, true)).collect();
    Ok(Json(json!({ "submissions": entries, "next": has_more.then_some(page.saturating_add(1)) })))
}

/// Withdraws a submission: `POST /api/v1/submissions/ID/withdraw`.
pub(super) async fn withdraw(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Json<ToldSubmission>, ApiError> {
    let user = known_caller(&app, &headers, client).await?;
    app.withdraw(&id, &user).await?;
    Ok(Json(told(&app, app.store.submission(&id).await?, true)))
}

/// Who shall see a submission.
#[derive(Debug, Deserialize)]
pub(super) struct To {
    to: Visibility,
}

/// Changes who sees a submission: `POST /api/v1/submissions/ID/visibility?to=private`.
pub(super) async fn set_visibility(
    State(app): State<AppState>,
    Extension(client): Extension<Client>,
    Path(id): Path<String>,
    Query(To { to }): Query<To>,
    headers: HeaderMap,
) -> Result<Json<ToldSubmission>, ApiError> {
    let user = known_caller(&app, &headers, client).await?;
    app.store.set_visibility(&id, &user, to).await?;
    Ok(Json(told(&app, app.store.submission(&id).await?, true)))
}
