//! Which zips are needed, and for how long.

use std::collections::HashMap;

use sqlx::Row;

use super::{Store, StoreError, audit};
use crate::time::Time;

/// The setting that says how many days zips are kept.
const DAYS: &str = "zip-days";
/// Its value for ever.
const ALL: &str = "all";

impl Store {
    /// Which of the stored zips are still needed: those of submissions that wait, are being scored or are scored and not
    /// withdrawn.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn kept_zips(&self) -> Result<HashMap<String, String>, StoreError> {
        let rows = sqlx::query(
            "SELECT id, sha256 FROM submissions WHERE state <> 'refused' AND (withdrawn_at IS NULL OR state = 'scoring')",
        )
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("id")?, row.try_get("sha256")?))).collect()
    }

    /// How many days after their scores zips are kept; for good if `None`, unless an admin has said otherwise.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn zip_days(&self) -> Result<Option<u32>, StoreError> {
        let damaged =
            |error: std::num::ParseIntError| StoreError::Damaged { what: DAYS, problem: error.to_string() };
        match self.setting(DAYS).await? {
            Some(days) if days != ALL => days.parse().map(Some).map_err(damaged),
            _ => Ok(None),
        }
    }

    /// Says how many days zips are kept; for good if `None`.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn set_zip_days(&self, days: Option<u32>) -> Result<(), StoreError> {
        let days = days.map_or_else(|| ALL.to_owned(), |days| days.to_string());
        self.set(DAYS, &days, "admin").await
    }

    /// The names of the submissions that had their scores before a moment.
    pub(crate) async fn scored_before(&self, moment: Time) -> Result<Vec<String>, StoreError> {
        let rows = sqlx::query(
            "SELECT id FROM submissions WHERE state = 'scored' AND finished_at < ? ORDER BY number",
        )
        .bind(moment.0)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(|row| Ok(row.try_get("id")?)).collect()
    }

    /// Notes that a zip was removed.
    pub(crate) async fn note_pruned(
        &self,
        id: &str,
        actor: &str,
        bytes: u64,
        at: Time,
    ) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        audit::note(&mut writing, at, actor, "prune", id, &format!("{bytes} bytes")).await?;
        writing.commit().await?;
        Ok(())
    }
}
