//! Errors as programs get them: a status and `{"error": "…"}`.

use std::time::Duration;

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;

use crate::accounts::AccountError;
use crate::leaderboard::ViewError;
use crate::limits::TooMany;
use crate::method::MethodError;
use crate::store::{QuotaSpent, StoreError};
use crate::time::Time;
use crate::upload::UploadError;

/// An answer that is an error.
#[derive(Debug)]
pub struct ApiError {
    /// The status.
    pub status: StatusCode,
    /// What is wrong, and how to mend it.
    pub message: String,
    /// When to try again.
    retry_after: Option<Duration>,
}

impl ApiError {
    /// An error of that status.
    pub fn new(status: StatusCode, message: impl Into<String>) -> ApiError {
        ApiError { status, message: message.into(), retry_after: None }
    }

    /// The fault is the server's; what it is stands in the log and not in the answer.
    pub fn internal() -> ApiError {
        ApiError::new(StatusCode::INTERNAL_SERVER_ERROR, "the server failed; its log says why")
    }

    /// Nobody, or not someone who may.
    pub fn unauthorized() -> ApiError {
        ApiError::new(
            StatusCode::UNAUTHORIZED,
            "give a token that works: the header `Authorization: Bearer TOKEN`",
        )
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let mut response = (self.status, Json(json!({ "error": self.message }))).into_response();
        if let Some(wait) = self.retry_after {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from(wait.as_secs() + 1));
        }
        if self.status == StatusCode::UNAUTHORIZED {
            response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> ApiError {
        match error {
            StoreError::Missing { .. } => ApiError::new(StatusCode::NOT_FOUND, error.to_string()),
            StoreError::Taken { .. } => ApiError::new(StatusCode::CONFLICT, error.to_string()),
            StoreError::Refused(problem) => ApiError::new(StatusCode::FORBIDDEN, problem),
            StoreError::Quota(spent) => spent.into(),
            StoreError::Database(_) | StoreError::Format { .. } | StoreError::Damaged { .. } => {
                tracing::error!(%error, "the store failed");
                ApiError::internal()
            }
        }
    }
}

impl From<QuotaSpent> for ApiError {
    fn from(spent: QuotaSpent) -> ApiError {
        let wait = spent.retry_at.map(|at| at.0.saturating_sub(Time::now().0).max(0).unsigned_abs());
        ApiError {
            status: StatusCode::TOO_MANY_REQUESTS,
            message: spent.to_string(),
            retry_after: wait.map(Duration::from_millis),
        }
    }
}

impl From<TooMany> for ApiError {
    fn from(TooMany(wait): TooMany) -> ApiError {
        ApiError {
            status: StatusCode::TOO_MANY_REQUESTS,
            message: format!("too many requests; try again in {} s", wait.as_secs() + 1),
            retry_after: Some(wait),
        }
    }
}

impl From<ViewError> for ApiError {
    fn from(error: ViewError) -> ApiError {
        ApiError::new(StatusCode::BAD_REQUEST, error.to_string())
    }
}

impl From<MethodError> for ApiError {
    fn from(error: MethodError) -> ApiError {
        ApiError::new(StatusCode::BAD_REQUEST, error.to_string())
    }
}

impl From<AccountError> for ApiError {
    fn from(error: AccountError) -> ApiError {
        let status = match error {
            AccountError::Unfit(_) => StatusCode::BAD_REQUEST,
            AccountError::Unknown => StatusCode::UNAUTHORIZED,
            AccountError::Closed => StatusCode::FORBIDDEN,
            AccountError::Store(error) => return error.into(),
            AccountError::Secret(_) => {
                tracing::error!(%error, "no secret was made");
                return ApiError::internal();
            }
        };
        ApiError::new(status, error.to_string())
    }
}

impl From<UploadError> for ApiError {
    fn from(error: UploadError) -> ApiError {
        let status = match error {
            UploadError::TooLong(_) => StatusCode::PAYLOAD_TOO_LARGE,
            UploadError::Broken(_) | UploadError::Empty | UploadError::Short { .. } => {
                StatusCode::BAD_REQUEST
            }
            UploadError::Slow(_) => StatusCode::REQUEST_TIMEOUT,
            UploadError::Busy => StatusCode::TOO_MANY_REQUESTS,
            UploadError::Full => StatusCode::INSUFFICIENT_STORAGE,
            UploadError::TooMany(too_many) => return too_many.into(),
            UploadError::Store(error) => return error.into(),
            UploadError::Server(_) => {
                tracing::error!(%error, "an upload failed");
                return ApiError::internal();
            }
        };
        ApiError::new(status, error.to_string())
    }
}
