//! Quotas: how many submissions a user may make to a phase of a benchmark, in all, in a day and how soon one after the other.

use std::time::Duration;

use serde::Serialize;
use sqlx::Row;

use super::benchmarks::{BenchmarkEntry, Quota};
use super::{Store, StoreError, User, UserStatus, Writing};
use crate::method::Phase;
use crate::time::Time;

/// What "a day" is to a quota: any 24 hours, so that no midnight is worth waiting for.
const DAY: Duration = Duration::from_secs(24 * 3600);

/// A quota is used up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{limit} in the {phase} phase; {}", again(*.retry_at))]
pub struct QuotaSpent {
    /// The phase.
    pub phase: Phase,
    /// Which limit it is, in words.
    pub limit: String,
    /// When there is room again, if ever.
    pub retry_at: Option<Time>,
}

fn again(retry_at: Option<Time>) -> String {
    retry_at.map_or_else(|| "no further ones are taken".to_owned(), |time| format!("try again at {time}"))
}

/// How much of a quota a user has used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct QuotaUse {
    /// The quota.
    #[serde(flatten)]
    pub quota: Quota,
    /// Submissions of the last 24 hours that count.
    pub used_in_day: u32,
    /// Submissions of all time that count.
    pub used: u32,
}

/// Counts in the transaction that takes the submission in: of two at the same moment, the second sees the first.
pub(super) async fn check_quota(
    writing: &mut Writing,
    user: i64,
    benchmark: i64,
    phase: Phase,
    quota: Quota,
    now: Time,
) -> Result<(), StoreError> {
    let spent = |limit: String, retry_at| Err(QuotaSpent { phase, limit, retry_at }.into());
    // When the nth newest that counts was taken in.
    let mut nth = async |n: u32| -> Result<Option<Time>, StoreError> {
        let row = sqlx::query(
            "SELECT submitted_at FROM submissions WHERE user = ? AND benchmark = ? AND phase = ? AND counted = 1 \
             ORDER BY submitted_at DESC LIMIT 1 OFFSET ?",
        )
        .bind(user)
        .bind(benchmark)
        .bind(phase.as_str())
        .bind(n.saturating_sub(1))
        .fetch_optional(&mut **writing)
        .await?;
        Ok(row.map(|row| row.try_get(0)).transpose()?.map(Time))
    };
    let Quota { per_day, total, gap_seconds } = quota;
    if total == 0 || nth(total).await?.is_some() {
        return spent(format!("all {total} submissions are used up"), None);
    }
    if per_day == 0 {
        return spent("none is taken a day".to_owned(), None);
    }
    if let Some(time) = nth(per_day).await?
        && time.after(DAY) > now
    {
        return spent(format!("the {per_day} submissions of 24 hours are used up"), Some(time.after(DAY)));
    }
    let gap = Duration::from_secs(gap_seconds.into());
    // One that waited for the write lock may come a little before the one that went first.
    if gap > Duration::ZERO
        && let Some(time) = nth(1).await?
        && time.after(gap) > now
    {
        return spent(format!("submissions must be {gap_seconds} s apart"), Some(time.after(gap)));
    }
    Ok(())
}

/// Refuses users who may not submit at all.
pub(super) fn may_submit(status: UserStatus) -> Result<(), StoreError> {
    match status {
        UserStatus::Active => Ok(()),
        UserStatus::Waiting => {
            Err(StoreError::Refused("your account waits for an admin's approval; ask the hosts".to_owned()))
        }
        UserStatus::Blocked => Err(StoreError::Refused("your account is blocked; ask the hosts".to_owned())),
    }
}

impl Store {
    /// Whether [`Store::submit`] would take a submission now, before anything is uploaded.
    ///
    /// # Errors
    /// As [`Store::submit`].
    pub async fn could_submit(
        &self,
        benchmark: &BenchmarkEntry,
        user: &User,
        phase: Phase,
        now: Time,
    ) -> Result<(), StoreError> {
        may_submit(user.status)?;
        if !benchmark.open {
            return Err(StoreError::Refused(format!("{} takes no submissions any more", benchmark.name)));
        }
        let mut reading = self.readers.begin().await?;
        check_quota(&mut reading, user.id, benchmark.id, phase, benchmark.quota(phase), now).await
    }

    /// How much of a quota a user has used.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn quota_use(
        &self,
        benchmark: &BenchmarkEntry,
        user: &User,
        phase: Phase,
        now: Time,
    ) -> Result<QuotaUse, StoreError> {
        let row = sqlx::query(
            "SELECT count(*) AS used, count(CASE WHEN submitted_at > ? THEN 1 END) AS today FROM submissions \
             WHERE user = ? AND benchmark = ? AND phase = ? AND counted = 1",
        )
        .bind(now.before(DAY).0)
        .bind(user.id)
        .bind(benchmark.id)
        .bind(phase.as_str())
        .fetch_one(&self.readers)
        .await?;
        let (used, used_in_day) = (row.try_get("used")?, row.try_get("today")?);
        Ok(QuotaUse { quota: benchmark.quota(phase), used_in_day, used })
    }
}
