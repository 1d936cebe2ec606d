//! What the server remembers: users, benchmarks, submissions, an audit log. All SQL is in this module, behind functions, so
//! that another database can take SQLite's place.
//!
//! Whatever must hold together is one transaction, and writing transactions begin with the write lock
//! (`BEGIN IMMEDIATE`): two processes, such as a server and an admin's command, never decide on what the other is changing.

mod audit;
mod benchmarks;
mod queue;
mod quota;
mod submissions;
mod users;
mod zips;

use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{ConnectOptions, Row, Sqlite, Transaction};

pub use audit::AuditEntry;
pub use benchmarks::{BenchmarkEntry, Quota, SceneEntry};
pub use queue::{Claim, Verdict};
pub use quota::{QuotaSpent, QuotaUse};
pub use submissions::{Listing, NewSubmission, State, SubmissionEntry};
pub use users::{SignUpPolicy, TokenEntry, User, UserStatus};

use crate::time::Time;

/// The format of the database that this program reads and writes.
const FORMAT: i64 = 2;
/// SQLite's `application_id` of such a database: "RLit".
const APPLICATION: i64 = 0x524c_6974;
/// Connections that read.
const READERS: u32 = 4;
/// How long a writer waits for another process' transaction.
const PATIENCE: Duration = Duration::from_secs(20);

/// Why the store does not do what it is asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database fails: the disk is full, the file is damaged.
    #[error("the database fails: {0}")]
    Database(#[from] sqlx::Error),
    /// The file is no database of ours.
    #[error(
        "{path}: is not a relight server's database of format {FORMAT} (found format {found}). Name the data folder of a \
         relight server, or use the program's release that wrote it"
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: i64,
    },
    /// A value in the database does not read.
    #[error("the database holds a damaged {what}: {problem}. Restore a backup")]
    Damaged {
        /// What does not read.
        what: &'static str,
        /// Why.
        problem: String,
    },
    /// A name or an address is taken.
    #[error("{what} {name:?} is taken. Choose another")]
    Taken {
        /// What is taken.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// What is spoken of is not there.
    #[error("there is no {what} {name:?}")]
    Missing {
        /// What it would be.
        what: &'static str,
        /// Its name.
        name: String,
    },
    /// The state of a thing does not allow it.
    #[error("{0}")]
    Refused(String),
    /// The quota is used up.
    #[error(transparent)]
    Quota(#[from] QuotaSpent),
}

/// A writing transaction.
pub(crate) type Writing = Transaction<'static, Sqlite>;

/// The database. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Store {
    path: PathBuf,
    readers: SqlitePool,
    /// One connection: writers of this process queue here rather than at the file.
    writer: SqlitePool,
}

impl Store {
    /// Opens the database at `path`, or makes an empty one.
    ///
    /// # Errors
    /// If the file is something else, of an unknown format, or cannot be read and written.
    pub async fn open(path: &Path) -> Result<Store, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            // What was acknowledged survives a loss of power too.
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(PATIENCE)
            .disable_statement_logging();
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .acquire_timeout(PATIENCE)
            .connect_with(options.clone())
            .await?;
        let readers = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(PATIENCE)
            .connect_lazy_with(options.pragma("query_only", "on"));
        let store = Store { path: path.to_owned(), readers, writer };
        store.prepare().await?;
        Ok(store)
    }

    /// Checks the format, and writes the tables of a new database.
    async fn prepare(&self) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let number = async |writing: &mut Writing, sql: &'static str| -> Result<i64, StoreError> {
            Ok(sqlx::query(sql).fetch_one(&mut **writing).await?.try_get(0)?)
        };
        let application = number(&mut writing, "PRAGMA application_id").await?;
        let format = number(&mut writing, "PRAGMA user_version").await?;
        let tables = number(&mut writing, "SELECT count(*) FROM sqlite_schema").await?;
        if (application, format, tables) == (0, 0, 0) {
            sqlx::raw_sql(include_str!("schema.sql")).execute(&mut *writing).await?;
            // Pragmas take no parameters; a test holds these two numbers against the constants.
            sqlx::raw_sql("PRAGMA application_id = 1380739444; PRAGMA user_version = 2;")
                .execute(&mut *writing)
                .await?;
        } else if (application, format) == (APPLICATION, 1) {
            // Format 1 knew no admins among the users.
            sqlx::raw_sql(
                "ALTER TABLE users ADD COLUMN is_admin INTEGER NOT NULL DEFAULT 0; PRAGMA user_version = 2;",
            )
            .execute(&mut *writing)
            .await?;
        } else if (application, format) != (APPLICATION, FORMAT) {
            return Err(StoreError::Format { path: self.path.clone(), found: format });
        }
        writing.commit().await?;
        Ok(())
    }

    /// Begins a transaction that writes.
    pub(crate) async fn write(&self) -> Result<Writing, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }

    /// A number that has grown whenever anything that pages show has changed, by whichever process.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn revision(&self) -> Result<i64, StoreError> {
        Ok(sqlx::query("SELECT value FROM revision").fetch_one(&self.readers).await?.try_get(0)?)
    }

    /// A value among the settings.
    pub(crate) async fn setting(&self, key: &str) -> Result<Option<String>, StoreError> {
        let row = sqlx::query("SELECT value FROM settings WHERE key = ?")
            .bind(key)
            .fetch_optional(&self.readers)
            .await?;
        row.map(|row| Ok(row.try_get(0)?)).transpose()
    }

    /// Writes a setting.
    pub(crate) async fn set(&self, key: &str, value: &str, actor: &str) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        sqlx::query("INSERT INTO settings VALUES (?1, ?2) ON CONFLICT (key) DO UPDATE SET value = ?2")
            .bind(key)
            .bind(value)
            .execute(&mut *writing)
            .await?;
        audit::note(&mut writing, Time::now(), actor, "set", key, value).await?;
        writing.commit().await?;
        Ok(())
    }

    /// Writes a whole copy of the database, as of one moment, to a file that must not exist yet. Others read and write
    /// meanwhile.
    ///
    /// # Errors
    /// If it cannot be written.
    pub async fn copy_to(&self, file: &Path) -> Result<(), StoreError> {
        let name = file.to_str().ok_or_else(|| {
            StoreError::Refused(format!("{}: the name is not UTF-8; choose another", file.display()))
        })?;
        let mut connection = self.writer.acquire().await?;
        sqlx::query("VACUUM INTO ?").bind(name).execute(&mut *connection).await?;
        Ok(())
    }

    /// Ends all connections, writing back what is in the log.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// The error for a value that does not read.
pub(crate) fn damaged(what: &'static str) -> impl Fn(serde_json::Error) -> StoreError {
    move |error| StoreError::Damaged { what, problem: error.to_string() }
}

/// Turns the failure of a unique column into [`StoreError::Taken`].
fn taken(what: &'static str, name: &str) -> impl FnOnce(sqlx::Error) -> StoreError {
    let name = name.to_owned();
    move |error| match error.as_database_error() {
        Some(inner) if inner.is_unique_violation() => StoreError::Taken { what, name },
        _ => StoreError::Database(error),
    }
}

#[cfg(test)]
mod tests;
