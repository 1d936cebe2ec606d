//! Users, their tokens and sessions.

use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::{Store, StoreError, audit, taken};
use crate::text::text_enum;
use crate::time::Time;

text_enum! {
    /// What a user may do.
    pub enum UserStatus {
        /// Submit.
        Active = "active",
        /// Sign in, and submit once an admin has approved.
        Waiting = "waiting",
        /// Nothing.
        Blocked = "blocked",
    }
}

text_enum! {
    /// Whether people can make accounts for themselves.
    pub enum SignUpPolicy {
        /// Everyone, at once.
        Open = "open",
        /// Everyone, but an admin must approve before they submit.
        Approval = "approval",
        /// Admins make all accounts.
        Closed = "closed",
    }
}

/// A user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// Number.
    pub id: i64,
    /// Name, shown beside public entries.
    pub name: String,
    /// Address, shown to nobody else.
    pub email: String,
    /// What the user may do.
    pub status: UserStatus,
    /// When the account was made.
    pub created_at: Time,
    /// Whether the user sees the pages of admins.
    pub is_admin: bool,
}

/// A token as its owner sees it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct TokenEntry {
    /// Number.
    pub id: i64,
    /// What its owner calls it.
    pub name: String,
    /// When it was made.
    pub created_at: Time,
    /// When it was last used, to the hour.
    pub used_at: Option<Time>,
}

fn user(row: &SqliteRow) -> Result<User, StoreError> {
    Ok(User {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        email: row.try_get("email")?,
        status: UserStatus::read(row.try_get("status")?)?,
        created_at: Time(row.try_get("created_at")?),
        is_admin: row.try_get("is_admin")?,
    })
}

impl Store {
    /// Whether people can make accounts for themselves; they can unless an admin has said otherwise.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn sign_up_policy(&self) -> Result<SignUpPolicy, StoreError> {
        match self.setting("sign-up").await? {
            Some(text) => SignUpPolicy::read(&text),
            None => Ok(SignUpPolicy::Open),
        }
    }

    /// Says whether people can make accounts for themselves.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn set_sign_up_policy(&self, policy: SignUpPolicy) -> Result<(), StoreError> {
        self.set("sign-up", policy.as_str(), "admin").await
    }

    /// Adds a user; `password` is a hash.
    pub(crate) async fn add_user(
        &self,
        name: &str,
        email: &str,
        password: Option<&str>,
        status: UserStatus,
        actor: &str,
    ) -> Result<User, StoreError> {
        let now = Time::now();
        let mut writing = self.write().await?;
        // Which of the two is taken is told apart before, not read out of an error's text.
        let named = sqlx::query("SELECT 1 FROM users WHERE name = ?").bind(name);
        if named.fetch_optional(&mut *writing).await?.is_some() {
            return Err(StoreError::Taken { what: "the name", name: name.to_owned() });
        }
        let row = sqlx::query(
            "INSERT INTO users (name, email, password, status, created_at) VALUES (?, ?, ?, ?, ?) RETURNING *",
        )
        .bind(name)
        .bind(email)
        .bind(password)
        .bind(status.as_str())
        .bind(now.0)
        .fetch_one(&mut *writing)
        .await
        .map_err(taken("the address", email))?;
        audit::note(&mut writing, now, actor, "add-user", name, status.as_str()).await?;
        let user = user(&row)?;
        writing.commit().await?;
        Ok(user)
    }

    /// The user of that name or address.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn user(&self, name: &str) -> Result<User, StoreError> {
        let row = sqlx::query("SELECT * FROM users WHERE name = ?1 OR email = ?1")
            .bind(name)
            .fetch_optional(&self.readers)
            .await?;
        row.as_ref().map_or_else(|| Err(StoreError::Missing { what: "user", name: name.to_owned() }), user)
    }

    /// All users, oldest first.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn users(&self) -> Result<Vec<User>, StoreError> {
        let rows = sqlx::query("SELECT * FROM users ORDER BY id").fetch_all(&self.readers).await?;
        rows.iter().map(user).collect()
    }

    /// Says what a user may do. A blocked user's sessions end, and the tokens no longer work.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_user_status(&self, name: &str, status: UserStatus) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let changed = sqlx::query("UPDATE users SET status = ? WHERE name = ?")
            .bind(status.as_str())
            .bind(name)
            .execute(&mut *writing)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "user", name: name.to_owned() });
        }
        audit::note(&mut writing, Time::now(), "admin", "user-status", name, status.as_str()).await?;
        writing.commit().await?;
        Ok(())
    }

    /// Lets a user see and use the pages of admins, or no longer.
    ///
    /// # Errors
    /// [`StoreError::Missing`], or if the database fails.
    pub async fn set_admin(&self, name: &str, is_admin: bool) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        let changed = sqlx::query("UPDATE users SET is_admin = ? WHERE name = ?")
            .bind(is_admin)
            .bind(name)
            .execute(&mut *writing)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::Missing { what: "user", name: name.to_owned() });
        }
        let action = if is_admin { "grant-admin" } else { "revoke-admin" };
        audit::note(&mut writing, Time::now(), "admin", action, name, "").await?;
        writing.commit().await?;
        Ok(())
    }

    /// The hash of the password of the user of that name or address, if there is one.
    pub(crate) async fn password_of(&self, name: &str) -> Result<Option<(User, Option<String>)>, StoreError> {
        let row = sqlx::query("SELECT * FROM users WHERE name = ?1 OR email = ?1")
            .bind(name)
            .fetch_optional(&self.readers)
            .await?;
        row.map(|row| Ok((user(&row)?, row.try_get("password")?))).transpose()
    }

    /// Gives a user another password, a hash, and ends all sessions.
    pub(crate) async fn set_password(
        &self,
        user: &User,
        password: &str,
        actor: &str,
    ) -> Result<(), StoreError> {
        let mut writing = self.write().await?;
        sqlx::query("UPDATE users SET password = ? WHERE id = ?")
            .bind(password)
            .bind(user.id)
            .execute(&mut *writing)
            .await?;
        sqlx::query("DELETE FROM sessions WHERE user = ?").bind(user.id).execute(&mut *writing).await?;
        audit::note(&mut writing, Time::now(), actor, "set-password", &user.name, "").await?;
        writing.commit().await?;
        Ok(())
    }

    /// Adds a token by its hash; its number.
    pub(crate) async fn add_token(
        &self,
        user: &User,
        name: &str,
        hash: &[u8],
        actor: &str,
    ) -> Result<i64, StoreError> {
        let now = Time::now();
        let mut writing = self.write().await?;
        let row =
            sqlx::query("INSERT INTO tokens (user, name, hash, created_at) VALUES (?, ?, ?, ?) RETURNING id")
                .bind(user.id)
                .bind(name)
                .bind(hash)
                .bind(now.0)
                .fetch_one(&mut *writing)
                .await?;
        audit::note(&mut writing, now, actor, "add-token", &user.name, name).await?;
        writing.commit().await?;
        Ok(row.try_get(0)?)
    }

    /// The user and hash of a token that is not revoked.
    pub(crate) async fn token(&self, id: i64) -> Result<Option<(User, Vec<u8>)>, StoreError> {
        let row = sqlx::query(
            "SELECT users.*, tokens.hash FROM tokens JOIN users ON users.id = tokens.user \
             WHERE tokens.id = ? AND revoked_at IS NULL",
        )
        .bind(id)
        .fetch_optional(&self.readers)
        .await?;
        row.map(|row| Ok((user(&row)?, row.try_get("hash")?))).transpose()
    }

    /// Notes that a token was used, at most once an hour, so that reading does not write.
    pub(crate) async fn touch_token(&self, id: i64, now: Time) -> Result<(), StoreError> {
        const HOUR: i64 = 3_600_000;
        let row = sqlx::query("SELECT used_at FROM tokens WHERE id = ?")
            .bind(id)
            .fetch_optional(&self.readers)
            .await?;
        let used: Option<i64> = row.map(|row| row.try_get(0)).transpose()?.flatten();
        if used.is_none_or(|used| used < now.0 - HOUR) {
            sqlx::query("UPDATE tokens SET used_at = ? WHERE id = ?")
                .bind(now.0)
                .bind(id)
                .execute(&self.writer)
                .await?;
        }
        Ok(())
    }

    /// A user's tokens that work, oldest first.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn tokens(&self, user: &User) -> Result<Vec<TokenEntry>, StoreError> {
        let rows = sqlx::query("SELECT * FROM tokens WHERE user = ? AND revoked_at IS NULL ORDER BY id")
            .bind(user.id)
            .fetch_all(&self.readers)
            .await?;
        rows.iter()
            .map(|row| {
                Ok(TokenEntry {
                    id: row.try_get("id")?,
                    name: row.try_get("name")?,
                    created_at: Time(row.try_get("created_at")?),
                    used_at: row.try_get::<Option<i64>, _>("used_at")?.map(Time),
                })
            })
            .collect()
    }

    /// Revokes a token of a user's; nothing happens if it is someone else's.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn revoke_token(&self, user: &User, id: i64) -> Result<(), StoreError> {
        let now = Time::now();
        let mut writing = self.write().await?;
        let changed =
            sqlx::query("UPDATE tokens SET revoked_at = ? WHERE id = ? AND user = ? AND revoked_at IS NULL")
                .bind(now.0)
                .bind(id)
                .bind(user.id)
                .execute(&mut *writing)
                .await?;
        if changed.rows_affected() > 0 {
            audit::note(&mut writing, now, &user.name, "revoke-token", &user.name, &id.to_string()).await?;
        }
        writing.commit().await?;
        Ok(())
    }

    /// Adds a session by its hash, and forgets those that have ended; its number.
    pub(crate) async fn add_session(
        &self,
        user: &User,
        hash: &[u8],
        expires_at: Time,
    ) -> Result<i64, StoreError> {
        let mut writing = self.write().await?;
        sqlx::query("DELETE FROM sessions WHERE expires_at < ?")
            .bind(Time::now().0)
            .execute(&mut *writing)
            .await?;
        let row = sqlx::query("INSERT INTO sessions (user, hash, expires_at) VALUES (?, ?, ?) RETURNING id")
            .bind(user.id)
            .bind(hash)
            .bind(expires_at.0)
            .fetch_one(&mut *writing)
            .await?;
        writing.commit().await?;
        Ok(row.try_get(0)?)
    }

    /// The user and hash of a session that has not ended.
    pub(crate) async fn session(&self, id: i64, now: Time) -> Result<Option<(User, Vec<u8>)>, StoreError> {
        let row = sqlx::query(
            "SELECT users.*, sessions.hash FROM sessions JOIN users ON users.id = sessions.user \
             WHERE sessions.id = ? AND expires_at > ?",
        )
        .bind(id)
        .bind(now.0)
        .fetch_optional(&self.readers)
        .await?;
        row.map(|row| Ok((user(&row)?, row.try_get("hash")?))).transpose()
    }

    /// Ends a session.
    pub(crate) async fn end_session(&self, id: i64) -> Result<(), StoreError> {
        sqlx::query("DELETE FROM sessions WHERE id = ?").bind(id).execute(&self.writer).await?;
        Ok(())
    }
}
