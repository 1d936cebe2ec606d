//! The pages: drawn by the server, whole without a script, readable on paper, on a phone and in the dark.
//!
//! Modules of two kinds. `shell`, `home`, `board`, `entry`, `guide`, `account`, `history` and `admin` are pure functions from what is to
//! be shown to HTML; `browse`, `members`, `submitting` and `administering` answer requests with them. Whatever is not ours is escaped by `maud`, and the
//! content security policy lets nothing in that is not a file of this server.

pub mod account;
pub mod admin;
mod administering;
mod assets;
pub mod board;
pub mod boards;
mod browse;
pub mod entry;
pub mod guide;
pub mod history;
pub mod home;
mod members;
mod session;
pub mod shell;
mod submitting;

use axum::Router;
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use axum::routing::{get, post};

use crate::app::AppState;

pub(crate) use browse::nothing;

/// Routes of short requests.
pub(crate) fn routes() -> Router<AppState> {
    Router::new()
        .route("/", get(browse::first))
        .route("/benchmarks/{name}", get(browse::leaderboard))
        .route("/benchmarks/{name}/submit", get(browse::how_to_submit))
        .route("/submissions/{id}", get(browse::submission))
        .route("/submissions/{id}/receipt.json", get(browse::receipt))
        .route("/submissions/{id}/pictures/{file}", get(browse::picture))
        .route("/submissions/{id}/visibility", post(submitting::set_visibility))
        .route("/submissions/{id}/withdraw", post(submitting::withdraw))
        .route("/sign-in", get(members::sign_in_form).post(members::sign_in))
        .route("/sign-up", get(members::sign_up_form).post(members::sign_up))
        .route("/sign-out", post(members::sign_out))
        .route("/account", get(members::account))
        .route("/account/password", post(members::new_password))
        .route("/account/submissions", get(submitting::history))
        .route("/account/tokens", post(members::new_token))
        .route("/account/tokens/{id}/revoke", post(members::revoke_token))
        .route("/static/{file}", get(browse::asset))
        .route("/admin", get(administering::benchmarks))
        .route("/admin/benchmarks/{name}/open", post(administering::set_open))
        .route("/admin/benchmarks/{name}/quota", post(administering::set_quota))
        .route("/admin/submissions", get(administering::submissions))
        .route("/admin/submissions/{id}/hidden", post(administering::set_hidden))
        .route("/admin/audit", get(administering::audit))
        .route("/api/v1/benchmarks/{name}/leaderboard", get(browse::leaderboard_data))
        .route("/api/v1/benchmarks/{name}/leaderboard.json", get(browse::leaderboard_json))
        .route("/api/v1/benchmarks/{name}/leaderboard.csv", get(browse::leaderboard_csv))
}

pub(crate) use session::is_secure;

/// Routes that take zips in.
pub(crate) fn upload_routes() -> Router<AppState> {
    Router::new().route("/benchmarks/{name}/upload", get(submitting::upload_form).post(submitting::upload))
}

/// Nothing from elsewhere, nothing inline, no frames, no forms to elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// Tells browsers, with every answer, what not to do with it.
pub(crate) async fn told_to_browsers(request: Request, next: Next) -> Response {
    let is_known = request.headers().contains_key(header::COOKIE);
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    let guards: [(HeaderName, &'static str); 7] = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("permissions-policy"), "camera=(), geolocation=(), microphone=()"),
    ];
    for (name, value) in guards {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(header::CACHE_CONTROL) {
        let store = if is_known { "private, no-store" } else { "no-cache" };
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(store));
    }
    response
}
