//! What everyone can read: benchmarks, leaderboards, submissions and their pictures.

use std::collections::HashSet;

use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Response};

use super::entry::{Own, Pictures, Shown, entry};
use super::session::{Guest, PageError, is_secure};
use super::{assets, guide, home};
use crate::api::ApiError;
use crate::app::{App, AppState};
use crate::disclosure::{ToldScores, tell};
use crate::leaderboard::{View, ViewQuery};
use crate::method::{Method, Visibility};
use crate::store::{State as Progressing, StoreError, SubmissionEntry};
use crate::worker::pictures::{Picture, file_name};

/// How long browsers keep assets, whose names change with what they hold.
const FOR_EVER: &str = "public, max-age=31536000, immutable";
/// How long browsers keep pictures: not beyond the moment when their user may have withdrawn them by much.
const A_WHILE: &str = "private, max-age=600";

pub(super) async fn first(State(app): State<AppState>, guest: Guest) -> Result<Html<String>, PageError> {
    let snapshot = app.boards.current(&app.store).await?;
    Ok(Html(home::home(&guest.visitor(), &snapshot.cards).into_string()))
}

pub(super) async fn leaderboard(
    State(app): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<ViewQuery>,
    headers: HeaderMap,
    guest: Guest,
) -> Result<Response, PageError> {
    let board = app.boards.current(&app.store).await?.board(&name)?;
    let view = View::new(&board.tables, &query)?;
    Ok(board.page(&view, &guest.visitor()).answer("text/html; charset=utf-8", &headers))
}

pub(super) async fn leaderboard_json(
    State(app): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<ViewQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let json = app.boards.current(&app.store).await?.board(&name)?.json(&query)?;
    Ok(json.answer("application/json", &headers))
}

pub(super) async fn leaderboard_csv(
    State(app): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<ViewQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let csv = app.boards.current(&app.store).await?.board(&name)?.csv(&query)?;
    Ok(csv.answer("text/csv; charset=utf-8; header=present", &headers))
}

/// JSON, unless the client would rather have CSV.
pub(super) async fn leaderboard_data(
    state: State<AppState>,
    name: Path<String>,
    query: Query<ViewQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok()).unwrap_or("");
    // The first of the two that is named; nobody who asks for both weighs them.
    let wants_csv = accept
        .split(',')
        .map(|kind| kind.split(';').next().unwrap_or("").trim())
        .find(|kind| ["application/json", "text/csv"].contains(kind))
        .is_some_and(|kind| kind == "text/csv");
    if wants_csv {
        leaderboard_csv(state, name, query, headers).await
    } else {
        leaderboard_json(state, name, query, headers).await
    }
}

pub(super) async fn how_to_submit(
    State(app): State<AppState>,
    Path(name): Path<String>,
    headers: HeaderMap,
    guest: Guest,
) -> Result<Html<String>, PageError> {
    let benchmark = app.store.benchmark(&name).await?;
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or("localhost");
    let scheme = if is_secure(&app, &headers) { "https" } else { "http" };
    Ok(Html(guide::guide(&guest.visitor(), &benchmark, &format!("{scheme}://{host}")).into_string()))
}

/// A submission, if whoever asks may see it. Others are told that there is none.
pub(super) async fn visible(
    app: &App,
    id: &str,
    guest: &Guest,
) -> Result<(SubmissionEntry, bool), StoreError> {
    let entry = app.store.submission(id).await?;
    let is_own = guest.user.as_ref().is_some_and(|user| user.id == entry.user);
    let is_open = entry.visibility != Visibility::Private && !entry.hidden && entry.withdrawn_at.is_none();
    if is_own || is_open {
        Ok((entry, is_own))
    } else {
        Err(StoreError::Missing { what: "submission", name: id.to_owned() })
    }
}

pub(super) async fn submission(
    State(app): State<AppState>,
    Path(id): Path<String>,
    guest: Guest,
) -> Result<Html<String>, PageError> {
    submission_page(&app, &id, &guest, "").await
}

/// The page of a submission with a message above it.
pub(super) async fn submission_page(
    app: &App,
    id: &str,
    guest: &Guest,
    message: &str,
) -> Result<Html<String>, PageError> {
    let (found, is_own) = visible(app, id, guest).await?;
    let shown = shown(app, found, is_own).await?;
    Ok(Html(entry(&guest.visitor(), &shown, message).into_string()))
}

async fn shown(app: &App, entry: SubmissionEntry, is_own: bool) -> Result<Shown, StoreError> {
    let scores = entry.scores.as_ref().map(tell);
    let pictures = match &scores {
        Some(scores) => pictures(app, &entry, scores).await?,
        None => Vec::new(),
    };
    let is_named = is_own || entry.visibility == Visibility::Public;
    let (problems, more_problems) =
        entry.problems.map_or_else(Default::default, |all| (all.problems, all.more));
    Ok(Shown {
        progress: (entry.state == Progressing::Scoring).then(|| app.progress(&entry.id)).flatten(),
        method: match is_named {
            true => entry.method,
            false => Method { name: entry.method.name, ..Method::default() },
        },
        user: if is_named { entry.user_name } else { String::new() },
        baseline: entry.pinned,
        benchmark: entry.benchmark,
        phase: entry.phase,
        visibility: entry.visibility,
        state: entry.state,
        submitted_at: entry.submitted_at.to_string(),
        reason: entry.reason.unwrap_or_default(),
        problems,
        more_problems,
        scores,
        pictures,
        own: is_own.then(|| Own {
            sha256: entry.sha256,
            bytes: entry.bytes,
            hidden: entry.hidden,
            withdrawn: entry.withdrawn_at.is_some(),
        }),
        id: entry.id,
    })
}

/// Those of a submission's images that there are pictures of.
async fn pictures(
    app: &App,
    entry: &SubmissionEntry,
    scores: &ToldScores,
) -> Result<Vec<Pictures>, StoreError> {
    let folder = app.folder.pictures_of(&entry.id);
    let listed = tokio::task::spawn_blocking(move || -> HashSet<String> {
        let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
        files.map(|file| file.file_name().to_string_lossy().into_owned()).collect()
    });
    let files = listed.await.unwrap_or_default();
    let benchmark = app.store.benchmark(&entry.benchmark).await?;
    let of_image = |image: &crate::disclosure::ToldImage| {
        let [submitted, truth, error] = [Picture::Submitted, Picture::Truth, Picture::Error]
            .map(|picture| file_name(&image.scene, image.light, image.camera, picture));
        let all = [&submitted, &truth, &error].into_iter().all(|file| files.contains(file));
        let scene = benchmark.scenes.iter().find(|scene| scene.name == image.scene)?;
        let size = (scene.width, scene.height);
        all.then(|| Pictures { image: image.clone(), size, submitted, truth, error })
    };
    Ok(scores.images.iter().filter_map(of_image).collect())
}

pub(super) async fn picture(
    State(app): State<AppState>,
    Path((id, file)): Path<(String, String)>,
    guest: Guest,
) -> Result<Response, PageError> {
    let missing = || StoreError::Missing { what: "picture", name: file.clone() };
    let (entry, _) = visible(&app, &id, &guest).await?;
    // One name, never a path, of the only kind of file that lies there.
    let is_name = !file.starts_with('.') && !file.contains(['/', '\\', '\0', ':']) && file.ends_with(".png");
    if !is_name {
        return Err(missing().into());
    }
    let path = app.folder.pictures_of(&entry.id).join(&file);
    let png = tokio::fs::read(path).await.map_err(|_| missing())?;
    Ok(([(header::CONTENT_TYPE, "image/png"), (header::CACHE_CONTROL, A_WHILE)], png).into_response())
}

pub(super) async fn receipt(
    State(app): State<AppState>,
    Path(id): Path<String>,
    guest: Guest,
) -> Result<Response, PageError> {
    let (entry, _) = visible(&app, &id, &guest).await?;
    let receipt = entry.receipt.ok_or(StoreError::Missing { what: "receipt of", name: id.clone() })?;
    let name = format!("attachment; filename=\"relight-receipt-{}.json\"", entry.id);
    Ok(([(header::CONTENT_DISPOSITION, name)], Json(receipt)).into_response())
}

pub(super) async fn asset(Path(file): Path<String>) -> Result<Response, PageError> {
    let asset = assets::find(&file).ok_or(StoreError::Missing { what: "file", name: file.clone() })?;
    Ok(([(header::CONTENT_TYPE, asset.kind), (header::CACHE_CONTROL, FOR_EVER)], asset.text).into_response())
}

/// Where nothing is: JSON for programs, a page for people.
pub(crate) async fn nothing(address: Uri) -> Response {
    let error = ApiError::new(StatusCode::NOT_FOUND, "there is nothing at this address");
    if address.path().starts_with("/api/") {
        error.into_response()
    } else {
        PageError::from(error).into_response()
    }
}
