//! Submissions: taken in, listed, withdrawn, moderated.

use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::benchmarks::BenchmarkEntry;
use super::quota::{check_quota, may_submit};
use super::{Store, StoreError, User, UserStatus, audit, damaged};
use crate::method::{Method, Phase, Visibility};
use crate::receipt::Receipt;
use crate::scoring::Scores;
use crate::submission::Refusal;
use crate::text::text_enum;
use crate::time::Time;

text_enum! {
    /// How far a submission is.
    pub enum State {
        /// Safely stored, waits to be scored.
        Queued = "queued",
        /// Being checked and scored.
        Scoring = "scoring",
        /// Has scores.
        Scored = "scored",
        /// Has none, and costs nothing.
        Refused = "refused",
    }
}

/// Submissions of a part of a list.
const PAGE: i64 = 50;

/// A submission whose zip is stored.
#[derive(Clone, Debug)]
pub struct NewSubmission {
    /// Its name.
    pub id: String,
    /// The benchmark's name.
    pub benchmark: String,
    /// Which images it is about.
    pub phase: Phase,
    /// Who sees it.
    pub visibility: Visibility,
    /// What is said of it.
    pub method: Method,
    /// SHA-256 of the zip, in hexadecimal digits.
    pub sha256: String,
    /// Bytes of the zip.
    pub bytes: u64,
}

/// A submission as the store has it, with all that only its user may see: see [`crate::disclosure`] for what others may.
#[derive(Clone, Debug, PartialEq)]
pub struct SubmissionEntry {
    /// Its name.
    pub id: String,
    /// The benchmark's name.
    pub benchmark: String,
    /// Whose it is: the user's number.
    pub user: i64,
    /// Whose it is: the user's name.
    pub user_name: String,
    /// Which images it is about.
    pub phase: Phase,
    /// Who sees it.
    pub visibility: Visibility,
    /// What is said of it.
    pub method: Method,
    /// SHA-256 of the zip, in hexadecimal digits.
    pub sha256: String,
    /// Bytes of the zip.
    pub bytes: u64,
    /// How far it is.
    pub state: State,
    /// When it was taken in.
    pub submitted_at: Time,
    /// When it was scored or refused.
    pub finished_at: Option<Time>,
    /// Why it was refused.
    pub reason: Option<String>,
    /// What is wrong with its zip.
    pub problems: Option<Refusal>,
    /// Its scores, with all digits.
    pub scores: Option<Scores>,
    /// The signed statement of its scores.
    pub receipt: Option<Receipt>,
    /// Whether an admin has hidden it.
    pub hidden: bool,
    /// Whether an admin has pinned it, as baselines are.
    pub pinned: bool,
    /// When it was withdrawn.
    pub withdrawn_at: Option<Time>,
}

impl SubmissionEntry {
    /// Whether a person without an account may see it: scored, public or anonymous, neither hidden nor withdrawn.
    pub fn is_listed(&self) -> bool {
        self.state == State::Scored
            && self.visibility != Visibility::Private
            && !self.hidden
            && self.withdrawn_at.is_none()
    }
}

/// Which submissions are asked for.
#[derive(Clone, Copy, Debug)]
pub enum Listing<'a> {
    /// Those on the leaderboard of a benchmark: see [`SubmissionEntry::is_listed`].
    Board(&'a BenchmarkEntry),
    /// The same; the scores, which are long and never change, are left out.
    BoardWithoutScores(&'a BenchmarkEntry),
    /// All that there are; the scores are left out.
    All,
}

/// The columns of an entry. `?1` says whether scores are asked for.
macro_rules! select {
    ($rest:literal) => {
        concat!(
            "SELECT submissions.*, CASE WHEN ?1 THEN scores END AS told_scores, benchmarks.name AS benchmark_name, \
             users.name AS user_name FROM submissions JOIN benchmarks ON benchmarks.id = submissions.benchmark \
             JOIN users ON users.id = submissions.user ",
            $rest
        )
    };
}

fn submission(row: &SqliteRow) -> Result<SubmissionEntry, StoreError> {
    let bytes: i64 = row.try_get("bytes")?;
    let json = |column| row.try_get::<Option<String>, _>(column);
    Ok(SubmissionEntry {
        id: row.try_get("id")?,
        benchmark: row.try_get("benchmark_name")?,
        user: row.try_get("user")?,
        user_name: row.try_get("user_name")?,
        phase: Phase::read(row.try_get("phase")?)?,
        visibility: Visibility::read(row.try_get("visibility")?)?,
        method: serde_json::from_str(row.try_get("method")?).map_err(damaged("method"))?,
        sha256: row.try_get("sha256")?,
        bytes: bytes.unsigned_abs(),
        state: State::read(row.try_get("state")?)?,
        submitted_at: Time(row.try_get("submitted_at")?),
        finished_at: row.try_get::<Option<i64>, _>("finished_at")?.map(Time),
        reason: row.try_get("reason")?,
        problems: json("problems")?
            .map(|text| serde_json::from_str(&text).map_err(damaged("list of problems")))
            .transpose()?,
        scores: json("told_scores")?
            .map(|text| serde_json::from_str(&text).map_err(damaged("list of scores")))
            .transpose()?,
        receipt: json("receipt")?
            .map(|text| serde_json::from_str(&text).map_err(damaged("receipt")))
            .transpose()?,
        hidden: row.try_get("hidden")?,
        pinned: row.try_get("pinned")?,
        withdrawn_at: row.try_get::<Option<i64>, _>("withdrawn_at")?.map(Time),
    })
}

impl Store {
    /// Takes in a submission of a user's, whose zip is safely stored, if the quota allows it: all in one transaction.
    ///
    /// # Errors
    /// [`StoreError::Quota`]; [`StoreError::Refused`] if the benchmark is closed or the user may not submit.
    pub async fn submit(&self, new: &NewSubmission, user: i64, now: Time) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let row = sqlx::query("SELECT name, status FROM users WHERE id = ?")
            .bind(user)
            .fetch_one(&mut *writing)
            .await?;
        let user_name: String = row.try_get("name")?;
        may_submit(UserStatus::read(row.try_get("status")?)?)?;
        let row = sqlx::query("SELECT * FROM benchmarks WHERE name = ?")
            .bind(&new.benchmark)
            .fetch_optional(&mut *writing)
            .await?
            .ok_or_else(|| StoreError::Missing { what: "benchmark", name: new.benchmark.clone() })?;
        let benchmark = super::benchmarks::benchmark(&row)?;
        if !benchmark.open {
            return Err(StoreError::Refused(format!("{} takes no submissions any more", benchmark.name)));
        }
        check_quota(&mut writing, user, benchmark.id, new.phase, benchmark.quota(new.phase), now).await?;
        sqlx::query(
            "INSERT INTO submissions (id, benchmark, user, phase, visibility, method, sha256, bytes, state, submitted_at) \
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, 'queued', ?)",
        )
        .bind(&new.id)
        .bind(benchmark.id)
        .bind(user)
        .bind(new.phase.as_str())
        .bind(new.visibility.as_str())
        .bind(serde_json::to_string(&new.method).map_err(damaged("method"))?)
        .bind(&new.sha256)
        .bind(i64::try_from(new.bytes).unwrap_or(i64::MAX))
        .bind(now.0)
        .execute(&mut *writing)
        .await?;
        audit::note(&mut writing, now, &user_name, "submit", &new.id, &benchmark.name).await?;
        writing.commit().await?;
        Ok(())
    }

    /// The submission of that name, whoever's it is.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn submission(&self, id: &str) -> Result<SubmissionEntry, StoreError> {
        let row = sqlx::query(select!("WHERE submissions.id = ?2"))
            .bind(true)
            .bind(id)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref()
            .map_or_else(|| Err(StoreError::Missing { what: "submission", name: id.to_owned() }), submission)
    }

    /// Submissions, newest first.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn submissions(&self, listing: Listing<'_>) -> Result<Vec<SubmissionEntry>, StoreError> {
        let query = match listing {
            Listing::Board(benchmark) | Listing::BoardWithoutScores(benchmark) => sqlx::query(select!(
                "WHERE submissions.benchmark = ?2 AND state = 'scored' AND visibility <> 'private' AND hidden = 0 \
                 AND withdrawn_at IS NULL ORDER BY number DESC"
            ))
            .bind(matches!(listing, Listing::Board(_)))
            .bind(benchmark.id),
            Listing::All => sqlx::query(select!("ORDER BY number DESC")).bind(false),
        };
        query.fetch_all(&self.readers).await?.iter().map(submission).collect()
    }

    /// A part of a list, newest first and counted from 1: of all submissions, without their scores, or of a user's with them. Whether
    /// another part follows is told too.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn submissions_page(
        &self,
        user: Option<i64>,
        page: u32,
    ) -> Result<(Vec<SubmissionEntry>, bool), StoreError> {
        let query = sqlx::query(select!(
            "WHERE ?2 IS NULL OR submissions.user = ?2 ORDER BY number DESC LIMIT ?3 OFFSET ?4"
        ));
        let query = query.bind(user.is_some()).bind(user);
        let query = query.bind(PAGE + 1).bind(PAGE * (i64::from(page) - 1).max(0));
        let rows = query.fetch_all(&self.readers).await?;
        let has_more = rows.len() as i64 > PAGE;
        let entries = rows.iter().take(PAGE as usize).map(submission).collect::<Result<_, _>>()?;
        Ok((entries, has_more))
    }

    /// Withdraws a submission: nobody but its user sees it any more. One that waits is not scored and costs nothing; one that
    /// is scored keeps counting, for its scores were seen. `owner` is the user's number, or `None` for an admin.
    ///
    /// # Errors
    /// [`StoreError::Missing`] if there is none of that owner's, [`StoreError::Refused`] if it is withdrawn already.
    pub async fn withdraw(
        &self,
        id: &str,
        owner: Option<i64>,
        actor: &str,
        now: Time,
    ) -> Result<(), StoreError> {
        let missing = || StoreError::Missing { what: "submission", name: id.to_owned() };
        let mut writing = self.write().await?;
        let row = sqlx::query("SELECT user, withdrawn_at FROM submissions WHERE id = ?")
            .bind(id)
            .fetch_optional(&mut *writing)
            .await?
            .ok_or_else(missing)?;
        if owner.is_some_and(|owner| row.try_get::<i64, _>("user").ok() != Some(owner)) {
            return Err(missing());
        }
        if row.try_get::<Option<i64>, _>("withdrawn_at")?.is_some() {
            return Err(StoreError::Refused(format!("{id} is withdrawn already")));
        }
        sqlx::query(
            "UPDATE submissions SET withdrawn_at = ?1, \
             counted = CASE state WHEN 'queued' THEN 0 ELSE counted END, \
             finished_at = CASE state WHEN 'queued' THEN ?1 ELSE finished_at END, \
             reason = CASE state WHEN 'queued' THEN 'withdrawn before it was scored' ELSE reason END, \
             state = CASE state WHEN 'queued' THEN 'refused' ELSE state END WHERE id = ?2",
        )
        .bind(now.0)
        .bind(id)
        .execute(&mut *writing)
        .await?;
        audit::note(&mut writing, now, actor, "withdraw", id, "").await?;
        writing.commit().await?;
        Ok(())
    }

    /// Changes who sees a submission of a user's.
    ///
    /// # Errors
    /// [`StoreError::Missing`] if the user has none of that name, [`StoreError::Refused`] if it would not be anonymous.
    pub async fn set_visibility(
        &self,
        id: &str,
        user: &User,
        visibility: Visibility,
    ) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let row = sqlx::query("SELECT method FROM submissions WHERE id = ? AND user = ?")
            .bind(id)
            .bind(user.id)
            .fetch_optional(&mut *writing)
            .await?;
        if visibility == Visibility::Anonymous
            && let Some(row) = row
        {
            let method: Method = serde_json::from_str(row.try_get("method")?).map_err(damaged("method"))?;
            method.check_anonymous(user).map_err(StoreError::Refused)?;
        }
        let changed = sqlx::query("UPDATE submissions SET visibility = ? WHERE id = ? AND user = ?")
            .bind(visibility.as_str())
            .bind(id)
            .bind(user.id)
            .execute(&mut *writing)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "submission", name: id.to_owned() });
        }
        audit::note(&mut writing, Time::now(), &user.name, "set-visibility", id, visibility.as_str()).await?;
        writing.commit().await?;
        Ok(())
    }

    /// Hides a submission from all but its user, or shows it again.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_hidden(&self, id: &str, hidden: bool, actor: &str) -> Result<(), StoreError> {
        let action = if hidden { "hide" } else { "show" };
        self.mark("UPDATE submissions SET hidden = ? WHERE id = ?", id, hidden, action, actor).await
    }

    /// Pins a submission, as baselines are, or unpins it.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_pinned(&self, id: &str, pinned: bool) -> Result<(), StoreError> {
        let action = if pinned { "pin" } else { "unpin" };
        self.mark("UPDATE submissions SET pinned = ? WHERE id = ?", id, pinned, action, "admin").await
    }

    async fn mark(
        &self,
        sql: &'static str,
        id: &str,
        value: bool,
        action: &str,
        actor: &str,
    ) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let changed = sqlx::query(sql).bind(value).bind(id).execute(&mut *writing).await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "submission", name: id.to_owned() });
        }
        audit::note(&mut writing, Time::now(), actor, action, id, "").await?;
        writing.commit().await?;
        Ok(())
    }
}
