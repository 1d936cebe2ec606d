//! Benchmarks and their quotas.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::{Store, StoreError, audit, damaged, taken};
use crate::method::Phase;
use crate::time::Time;

/// A scene of a benchmark, as its pages tell of it. Indices and sizes are public; where its files lie is not part of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneEntry {
    /// The scene's name.
    pub name: String,
    /// Validation images.
    pub val: usize,
    /// Images of the easy split.
    pub easy: usize,
    /// Images of the hard split.
    pub hard: usize,
    /// Pixels a row of its first image.
    pub width: u32,
    /// Rows of its first image.
    pub height: u32,
}

/// How often a user may submit to one phase of a benchmark. Refused submissions do not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Quota {
    /// Submissions within any 24 hours.
    pub per_day: u32,
    /// Submissions in all.
    pub total: u32,
    /// Seconds between two submissions.
    pub gap_seconds: u32,
}

impl Quota {
    /// The quota of a new benchmark's validation phase.
    pub const VAL: Quota = Quota { per_day: 100, total: 10_000, gap_seconds: 0 };
    /// The quota of a new benchmark's test phase.
    pub const TEST: Quota = Quota { per_day: 5, total: 100, gap_seconds: 0 };
}

/// A benchmark that the server holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchmarkEntry {
    /// Number.
    pub id: i64,
    /// Name, part of addresses.
    pub name: String,
    /// The folder with the ground truth. Never shown.
    pub folder: PathBuf,
    /// Its scenes.
    pub scenes: Vec<SceneEntry>,
    /// Whether it takes submissions.
    pub open: bool,
    /// Quota of the validation phase.
    pub val: Quota,
    /// Quota of the test phase.
    pub test: Quota,
    /// When it was added.
    pub added_at: Time,
}

impl BenchmarkEntry {
    /// The quota of a phase.
    pub fn quota(&self, phase: Phase) -> Quota {
        match phase {
            Phase::Val => self.val,
            Phase::Test => self.test,
        }
    }
}

pub(super) fn benchmark(row: &SqliteRow) -> Result<BenchmarkEntry, StoreError> {
    let quota = |per_day, total, gap| {
        Ok::<_, sqlx::Error>(Quota {
            per_day: row.try_get(per_day)?,
            total: row.try_get(total)?,
            gap_seconds: row.try_get(gap)?,
        })
    };
    Ok(BenchmarkEntry {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        folder: PathBuf::from(row.try_get::<String, _>("folder")?),
        scenes: serde_json::from_str(row.try_get("scenes")?).map_err(damaged("list of scenes"))?,
        open: row.try_get("open")?,
        val: quota("val_per_day", "val_total", "val_gap_seconds")?,
        test: quota("test_per_day", "test_total", "test_gap_seconds")?,
        added_at: Time(row.try_get("added_at")?),
    })
}

impl Store {
    /// Adds a benchmark, with the quotas of a new one.
    ///
    /// # Errors
    /// If the name is taken, the folder's name is not UTF-8, or the database fails.
    pub async fn add_benchmark(
        &self,
        name: &str,
        folder: &Path,
        scenes: &[SceneEntry],
    ) -> Result<(), StoreError> {
        let folder = folder.to_str().ok_or_else(|| {
            StoreError::Refused(format!("{}: the name is not UTF-8; rename the folder", folder.display()))
        })?;
        let now = Time::now();
        let mut writing = self.write().await?;
        let (val, test) = (Quota::VAL, Quota::TEST);
        sqlx::query(
            "INSERT INTO benchmarks (name, folder, scenes, val_per_day, val_total, val_gap_seconds, test_per_day, \
             test_total, test_gap_seconds, added_at) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(name)
        .bind(folder)
        .bind(serde_json::to_string(scenes).map_err(damaged("list of scenes"))?)
        .bind(val.per_day)
        .bind(val.total)
        .bind(val.gap_seconds)
        .bind(test.per_day)
        .bind(test.total)
        .bind(test.gap_seconds)
        .bind(now.0)
        .execute(&mut *writing)
        .await
        .map_err(taken("the name", name))?;
        audit::note(&mut writing, now, "admin", "add-benchmark", name, folder).await?;
        writing.commit().await?;
        Ok(())
    }

    /// The benchmark of that name.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn benchmark(&self, name: &str) -> Result<BenchmarkEntry, StoreError> {
        let row = sqlx::query("SELECT * FROM benchmarks WHERE name = ?")
            .bind(name)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref()
            .map_or_else(|| Err(StoreError::Missing { what: "benchmark", name: name.to_owned() }), benchmark)
    }

    /// All benchmarks, oldest first.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn benchmarks(&self) -> Result<Vec<BenchmarkEntry>, StoreError> {
        let rows = sqlx::query("SELECT * FROM benchmarks ORDER BY id").fetch_all(&self.readers).await?;
        rows.iter().map(benchmark).collect()
    }

    /// Sets the quota of a benchmark's phase.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_quota(
        &self,
        name: &str,
        phase: Phase,
        quota: Quota,
        actor: &str,
    ) -> Result<(), StoreError> {
        let sql = match phase {
            Phase::Val => {
                "UPDATE benchmarks SET val_per_day = ?, val_total = ?, val_gap_seconds = ? WHERE name = ?"
            }
            Phase::Test => {
                "UPDATE benchmarks SET test_per_day = ?, test_total = ?, test_gap_seconds = ? WHERE name = ?"
            }
        };
        let mut writing = self.write().await?;
        let changed = sqlx::query(sql)
            .bind(quota.per_day)
            .bind(quota.total)
            .bind(quota.gap_seconds)
            .bind(name)
            .execute(&mut *writing)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "benchmark", name: name.to_owned() });
        }
        let Quota { per_day, total, gap_seconds } = quota;
        let detail = format!("{phase}: {per_day} a day, {total} in all, {gap_seconds} s apart");
        audit::note(&mut writing, Time::now(), actor, "set-quota", name, &detail).await?;
        writing.commit().await?;
        Ok(())
    }

    /// Opens a benchmark to submissions, or closes it.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_open(&self, name: &str, open: bool, actor: &str) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let changed = sqlx::query("UPDATE benchmarks SET open = ? WHERE name = ?")
            .bind(open)
            .bind(name)
            .execute(&mut *writing)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "benchmark", name: name.to_owned() });
        }
        let action = if open { "open-benchmark" } else { "close-benchmark" };
        audit::note(&mut writing, Time::now(), actor, action, name, "").await?;
        writing.commit().await?;
        Ok(())
    }
}
