//! The queue: which submission is scored next, and what became of it. Each step is one transaction that names the state it
//! starts from, so that a step that was interrupted can be taken again and none can be taken twice.

use std::collections::HashSet;
use std::time::Duration;

use sqlx::Row;

use super::benchmarks::benchmark;
use super::{BenchmarkEntry, Store, StoreError, Writing, audit, damaged};
use crate::method::Phase;
use crate::receipt::Receipt;
use crate::scoring::Scores;
use crate::submission::Refusal;
use crate::time::Time;

/// A submission that is to be scored now.
#[derive(Clone, Debug)]
pub struct Claim {
    /// Its name.
    pub id: String,
    /// Its benchmark.
    pub benchmark: BenchmarkEntry,
    /// Which images it is about.
    pub phase: Phase,
    /// SHA-256 of its zip.
    pub sha256: String,
    /// How often scoring it has failed.
    pub failures: u32,
}

/// What became of a submission.
#[derive(Clone, Debug)]
pub enum Verdict {
    /// It has scores.
    Scored {
        /// They.
        scores: Box<Scores>,
        /// A signed statement of them.
        receipt: Box<Receipt>,
        /// Which phase it turned out to belong to.
        phase: Phase,
    },
    /// It has none, and costs nothing.
    Refused {
        /// Why.
        reason: String,
        /// What is wrong with the zip, if that is why.
        problems: Option<Refusal>,
    },
}

/// What was withdrawn while it was being scored, and has come back unscored, is not scored again.
async fn end_withdrawn(writing: &mut Writing, now: Time) -> Result<(), StoreError> {
    sqlx::query(
        "UPDATE submissions SET state = 'refused', counted = 0, finished_at = ?, \
         reason = 'withdrawn before it was scored' WHERE state = 'queued' AND withdrawn_at IS NOT NULL",
    )
    .bind(now.0)
    .execute(&mut **writing)
    .await?;
    Ok(())
}

impl Store {
    /// Puts back what a server that was killed was scoring. For the start of the one process that scores.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn requeue_interrupted(&self) -> Result<u64, StoreError> {
        let mut writing = self.write().await?;
        let changed = sqlx::query("UPDATE submissions SET state = 'queued' WHERE state = 'scoring'")
            .execute(&mut *writing)
            .await?;
        end_withdrawn(&mut writing, Time::now()).await?;
        writing.commit().await?;
        Ok(changed.rows_affected())
    }

    /// Takes the next submission from the queue: validation first, which is quick and promised at once, then by age; or only
    /// validation.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn claim(&self, only_validation: bool, now: Time) -> Result<Option<Claim>, StoreError> {
        let mut writing = self.write().await?;
        let next = sqlx::query(
            "UPDATE submissions SET state = 'scoring' WHERE number = (SELECT number FROM submissions \
             WHERE state = 'queued' AND not_before <= ? AND (phase = 'val' OR NOT ?) ORDER BY phase = 'test', number LIMIT 1) \
             RETURNING *",
        )
        .bind(now.0)
        .bind(only_validation)
        .fetch_optional(&mut *writing)
        .await?;
        let Some(row) = next else { return Ok(None) };
        let of = sqlx::query("SELECT * FROM benchmarks WHERE id = ?")
            .bind(row.try_get::<i64, _>("benchmark")?)
            .fetch_one(&mut *writing)
            .await?;
        let claim = Claim {
            id: row.try_get("id")?,
            benchmark: benchmark(&of)?,
            phase: Phase::read(row.try_get("phase")?)?,
            sha256: row.try_get("sha256")?,
            failures: row.try_get("failures")?,
        };
        writing.commit().await?;
        Ok(Some(claim))
    }

    /// Writes down what became of a submission that was being scored.
    ///
    /// # Errors
    /// [`StoreError::Refused`] if it was not being scored; nothing is written then.
    pub async fn finish(&self, id: &str, verdict: &Verdict, now: Time) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let (query, action, detail) = match verdict {
            Verdict::Scored { scores, receipt, phase } => (
                sqlx::query(
                    "UPDATE submissions SET state = 'scored', finished_at = ?2, scores = ?3, receipt = ?4, phase = ?5, \
                     reason = NULL WHERE id = ?1 AND state = 'scoring'",
                )
                .bind(id)
                .bind(now.0)
                .bind(serde_json::to_string(scores).map_err(damaged("list of scores"))?)
                .bind(serde_json::to_string(receipt).map_err(damaged("receipt"))?)
                .bind(phase.as_str()),
                "scored",
                scores.evaluator.as_str(),
            ),
            Verdict::Refused { reason, problems } => (
                sqlx::query(
                    "UPDATE submissions SET state = 'refused', finished_at = ?2, reason = ?3, problems = ?4, counted = 0 \
                     WHERE id = ?1 AND state = 'scoring'",
                )
                .bind(id)
                .bind(now.0)
                .bind(reason)
                .bind(
                    problems
                        .as_ref()
                        .map(|problems| serde_json::to_string(problems).map_err(damaged("list of problems")))
                        .transpose()?,
                ),
                "refused",
                reason.as_str(),
            ),
        };
        if query.execute(&mut *writing).await?.rows_affected() != 1 {
            return Err(StoreError::Refused(format!("{id} is not being scored")));
        }
        audit::note(&mut writing, now, "server", action, id, detail).await?;
        writing.commit().await?;
        Ok(())
    }

    /// Puts a submission back that was being scored: to go on as soon as possible, or because scoring failed, and why, and how
    /// long it shall wait; the failure is counted then.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn put_back(
        &self,
        id: &str,
        failure: Option<(&str, Duration)>,
        now: Time,
    ) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let wait = failure.map_or(now, |(_, wait)| now.after(wait));
        sqlx::query(
            "UPDATE submissions SET state = 'queued', not_before = ?2, failures = failures + ?3 \
             WHERE id = ?1 AND state = 'scoring'",
        )
        .bind(id)
        .bind(wait.0)
        .bind(failure.is_some())
        .execute(&mut *writing)
        .await?;
        end_withdrawn(&mut writing, now).await?;
        if let Some((why, _)) = failure {
            audit::note(&mut writing, now, "server", "scoring-failed", id, why).await?;
        }
        writing.commit().await?;
        Ok(())
    }

    /// Numbers of submissions by state, for metrics.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn counts(&self) -> Result<Vec<(String, i64)>, StoreError> {
        let rows = sqlx::query("SELECT state, count(*) FROM submissions GROUP BY state ORDER BY state")
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok((row.try_get(0)?, row.try_get(1)?))).collect()
    }

    /// The names of the submissions that have no verdict yet.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn waiting(&self) -> Result<HashSet<String>, StoreError> {
        let rows = sqlx::query("SELECT id FROM submissions WHERE state IN ('queued', 'scoring')")
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok(row.try_get("id")?)).collect()
    }
}
