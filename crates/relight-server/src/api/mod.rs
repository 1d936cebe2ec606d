//! The programs' interface: JSON over HTTP, tokens for whoever must be known.

mod error;
mod submissions;

use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde_json::{Value, json};

pub use error::ApiError;
pub(crate) use submissions::Part;

use crate::app::AppState;
use crate::store::BenchmarkEntry;

/// Routes of short requests.
pub(crate) fn routes() -> Router<AppState> {
    Router::new()
        .route("/api/v1/benchmarks", get(benchmarks))
        .route("/api/v1/benchmarks/{name}", get(benchmark))
        .route("/api/v1/submissions", get(submissions::own))
        .route("/api/v1/submissions/{id}", get(submissions::one))
        .route("/api/v1/submissions/{id}/withdraw", post(submissions::withdraw))
        .route("/api/v1/submissions/{id}/visibility", post(submissions::set_visibility))
        .route("/api/v1/receipt-key", get(receipt_key))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
}

/// Routes that take zips in: their bodies are long and may take long.
pub(crate) fn upload_routes() -> Router<AppState> {
    Router::new().route("/api/v1/benchmarks/{name}/submissions", post(submissions::submit))
}

/// What is public of a benchmark.
fn told(benchmark: &BenchmarkEntry) -> Value {
    let BenchmarkEntry { name, scenes, open, val, test, added_at, .. } = benchmark;
    json!({ "name": name, "open": open, "scenes": scenes, "quotas": { "val": val, "test": test }, "added_at": added_at })
}

async fn benchmarks(State(app): State<AppState>) -> Result<Json<Value>, ApiError> {
    let all = app.store.benchmarks().await?;
    Ok(Json(json!({ "benchmarks": all.iter().map(told).collect::<Vec<_>>() })))
}

async fn benchmark(State(app): State<AppState>, Path(name): Path<String>) -> Result<Json<Value>, ApiError> {
    Ok(Json(told(&app.store.benchmark(&name).await?)))
}

async fn receipt_key(State(app): State<AppState>) -> Json<Value> {
    Json(json!({ "algorithm": "Ed25519", "public_key": app.key.public() }))
}

/// Whether the server does its work: the database answers, and its folder takes files.
async fn health(State(app): State<AppState>) -> Result<Json<Value>, ApiError> {
    app.store.revision().await?;
    if !app.folder.incoming().is_dir() {
        return Err(ApiError::internal());
    }
    Ok(Json(json!({ "status": "ok", "version": env!("CARGO_PKG_VERSION") })))
}

async fn metrics(State(app): State<AppState>) -> Result<Response, ApiError> {
    let text = app.metrics.text(&app.store).await?;
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response())
}
