//! What all handlers share, and how routes and their guards come together.

use std::collections::HashMap;
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{DefaultBodyLimit, MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use tokio::sync::Notify;
use tower_http::catch_panic::CatchPanicLayer;

use crate::Progress;
use crate::api;
use crate::api::ApiError;
use crate::data_folder::{DataFolder, FolderError};
use crate::limits::RateLimits;
use crate::metrics::Metrics;
use crate::pages;
use crate::pages::boards::Boards;
use crate::receipt::{KeyError, ReceiptKey};
use crate::store::{Store, StoreError, User};
use crate::submission::Limits;
use crate::time::Time;
use crate::upload::Uploads;

/// The longest body of a request that is no upload, bytes.
const BODY: usize = 64 << 10;
/// What browsers that came by TLS are told: nothing but TLS for a year.
const TLS_ALONE: &str = "max-age=31536000";
/// How long a request that is no upload may take.
const TIMEOUT: Duration = Duration::from_secs(30);

/// How a server is run.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Whether clients' addresses are what the nearest proxy says (the last of `X-Forwarded-For`), and not those of the
    /// connections. Only if all requests come through such a proxy: anyone could claim any address otherwise.
    pub behind_proxy: bool,
    /// Requests a second that one address may make.
    pub requests_per_second: NonZeroU32,
    /// What a submission may be at most.
    pub limits: Limits,
    /// Memory of the process that scores, bytes of address space.
    pub scoring_memory: u64,
    /// The longest time that scoring may take.
    pub scoring_time: Duration,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            behind_proxy: false,
            requests_per_second: NonZeroU32::new(5000).unwrap_or(NonZeroU32::MIN),
            limits: Limits::default(),
            scoring_memory: 4 << 30,
            scoring_time: Duration::from_secs(3600),
        }
    }
}

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum AppError {
    /// Its folder.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// Its database.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Its key.
    #[error(transparent)]
    Key(#[from] KeyError),
}

/// What all handlers share.
#[derive(Debug)]
pub struct App {
    /// The database.
    pub store: Store,
    /// The files.
    pub folder: DataFolder,
    /// Signs receipts.
    pub key: ReceiptKey,
    /// How the server is run.
    pub settings: Settings,
    /// What it counts.
    pub metrics: Metrics,
    /// Leaderboards, ready to be sent.
    pub boards: Boards,
    /// How often clients may ask.
    pub rates: RateLimits,
    /// What is being received.
    pub(crate) uploads: Uploads,
    /// How far the submissions are that are being scored.
    progress: Mutex<HashMap<String, Progress>>,
    /// Told when there is something to score.
    pub(crate) wake: Notify,
}

/// The [`App`], as handlers get it: `State(app): State<AppState>`.
pub type AppState = Arc<App>;

impl App {
    /// Opens all that a server needs in its folder, made if there is none.
    ///
    /// # Errors
    /// [`AppError`].
    pub async fn open(data: &Path, settings: Settings) -> Result<AppState, AppError> {
        let folder = DataFolder::create(data)?;
        let store = Store::open(&folder.database()).await?;
        let key = ReceiptKey::open(&folder.receipt_key())?;
        let rates = RateLimits::new(settings.requests_per_second);
        Ok(Arc::new(App {
            store,
            folder,
            key,
            settings,
            rates,
            metrics: Metrics::default(),
            boards: Boards::default(),
            uploads: Uploads::default(),
            progress: Mutex::default(),
            wake: Notify::new(),
        }))
    }

    /// How far a submission is that is being scored.
    pub fn progress(&self, id: &str) -> Option<Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).get(id).copied()
    }

    /// Tells how far a submission is; `None` once it is no longer being scored.
    pub(crate) fn set_progress(&self, id: &str, progress: Option<Progress>) {
        let mut all = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        match progress {
            Some(progress) => all.insert(id.to_owned(), progress),
            None => all.remove(id),
        };
    }

    /// Withdraws a submission of a user's, and removes its zip and pictures unless they are being scored.
    ///
    /// # Errors
    /// As [`Store::withdraw`].
    pub async fn withdraw(&self, id: &str, user: &User) -> Result<(), StoreError> {
        self.store.withdraw(id, Some(user.id), &user.name, Time::now()).await?;
        // The scorer removes what it is scoring; what cannot be removed now, the next start removes.
        if self.progress(id).is_none()
            && let Err(error) = self.folder.forget(id)
        {
            tracing::warn!(submission = id, %error, "files of a withdrawn submission stay");
        }
        Ok(())
    }

    /// The address of whoever is at the other end of a request.
    fn client(&self, headers: &HeaderMap, connection: Option<IpAddr>) -> IpAddr {
        let told =
            headers.get_all("x-forwarded-for").iter().next_back().and_then(|value| value.to_str().ok());
        let told = told.and_then(|list| list.rsplit(',').next()?.trim().parse().ok());
        let direct = connection.unwrap_or(IpAddr::from([0, 0, 0, 0]));
        if self.settings.behind_proxy { told.unwrap_or(direct) } else { direct }
    }
}

/// The address of the connection, which the accepting loop puts into each request.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Connection(pub IpAddr);

/// The address of the client: an extension of every request (`Extension(Client(ip))`).
#[derive(Clone, Copy, Debug)]
pub struct Client(pub IpAddr);

/// All routes with their guards.
pub fn router(app: AppState) -> Router {
    let quick = Router::new()
        .merge(api::routes())
        .merge(pages::routes())
        .layer(DefaultBodyLimit::max(BODY))
        .layer(middleware::from_fn(in_time));
    let uploads = Router::new()
        .merge(api::upload_routes())
        .merge(pages::upload_routes())
        .layer(DefaultBodyLimit::disable());
    guarded(app, quick.merge(uploads).fallback(pages::nothing))
}

/// Routes within what holds for all: panics are caught, clients limited, answers counted, browsers told what not to do.
fn guarded(app: AppState, routes: Router<AppState>) -> Router {
    let counted = Arc::clone(&app);
    let panicked = move |panic: Box<dyn std::any::Any + Send>| {
        counted.metrics.panics.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
        tracing::error!(panic = text, "a handler panicked");
        ApiError::internal().into_response()
    };
    routes
        .layer(CatchPanicLayer::custom(panicked))
        .layer(middleware::from_fn_with_state(Arc::clone(&app), observed))
        .layer(middleware::from_fn(pages::told_to_browsers))
        .with_state(app)
}

/// Ends requests that take too long.
async fn in_time(request: Request, next: Next) -> Response {
    match tokio::time::timeout(TIMEOUT, next.run(request)).await {
        Ok(response) => response,
        Err(_) => ApiError::new(StatusCode::SERVICE_UNAVAILABLE, "the server is too busy; try again")
            .into_response(),
    }
}

/// Works out who asks, turns away who asks too often, counts and logs the others.
async fn observed(State(app): State<AppState>, mut request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let _in_flight = app.metrics.begin();
    let connection = request.extensions().get::<Connection>().map(|connection| connection.0);
    let client = app.client(request.headers(), connection);
    request.extensions_mut().insert(Client(client));
    let route = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let route = route.unwrap_or_else(|| "other".to_owned());
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let secure = pages::is_secure(&app, request.headers());
    let mut response = match app.rates.request(client) {
        Ok(()) => next.run(request).await,
        Err(too_many) => {
            app.metrics.rate_limited.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            ApiError::from(too_many).into_response()
        }
    };
    if secure {
        response.headers_mut().insert(header::STRICT_TRANSPORT_SECURITY, HeaderValue::from_static(TLS_ALONE));
    }
    let (status, took) = (response.status(), begun.elapsed());
    app.metrics.answered(&route, status.as_u16(), took);
    let milliseconds = took.as_secs_f64() * 1000.0;
    if status.is_server_error() {
        tracing::warn!(%client, %method, path, status = status.as_u16(), milliseconds, "answered");
    } else {
        tracing::debug!(%client, %method, path, status = status.as_u16(), milliseconds, "answered");
    }
    response
}

#[cfg(test)]
mod tests;
