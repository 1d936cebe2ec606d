//! Passwords, as Argon2id hashes (RFC 9106; 19 MiB, 2 passes, as OWASP recommends and the crate's defaults are).

use argon2::Argon2;
use argon2::password_hash::phc::PasswordHash;
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use tokio::sync::Semaphore;

use super::AccountError;

/// Hashes at a time: each takes 19 MiB and some 20 ms of a core, and readers shall not notice.
static AT_A_TIME: Semaphore = Semaphore::const_new(2);

/// The hash of a password, with its salt and settings.
pub(super) async fn hash(password: &str) -> Result<String, AccountError> {
    let password = password.to_owned();
    slowly(move || {
        let hash = Argon2::default().hash_password(password.as_bytes());
        hash.map(|hash| hash.to_string()).map_err(|error| AccountError::Secret(error.to_string()))
    })
    .await?
}

/// Whether a password has that hash. Without a hash the answer is no, after the same time.
pub(super) async fn matches(password: &str, hash: Option<String>) -> Result<bool, AccountError> {
    let password = password.to_owned();
    slowly(move || {
        let parsed = hash.as_deref().and_then(|hash| PasswordHash::new(hash).ok());
        match parsed {
            Some(parsed) => Argon2::default().verify_password(password.as_bytes(), &parsed).is_ok(),
            None => {
                // The work alone counts.
                let _ = Argon2::default().hash_password(password.as_bytes());
                false
            }
        }
    })
    .await
}

async fn slowly<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, AccountError> {
    let failed = |problem: String| AccountError::Secret(problem);
    let _permit = AT_A_TIME.acquire().await.map_err(|error| failed(error.to_string()))?;
    tokio::task::spawn_blocking(work).await.map_err(|error| failed(error.to_string()))
}
