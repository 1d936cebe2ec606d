//! Who someone is: passwords for people, tokens for programs, sessions for browsers.

mod password;
mod secret;

use std::time::Duration;

use crate::method::unprintable;
use crate::store::{SignUpPolicy, Store, StoreError, User, UserStatus};
use crate::time::Time;

use password::{hash, matches};
use secret::Secret;

/// How long a browser stays signed in.
pub const SESSION: Duration = Duration::from_secs(14 * 24 * 3600);
/// The shortest password, characters.
const SHORTEST: usize = 10;
/// The longest password, bytes.
const LONGEST: usize = 1000;
/// The user of [`baselines`].
const BASELINES: &str = "baselines";

/// Why an account is not made, or is not opened.
#[derive(Debug, thiserror::Error)]
pub enum AccountError {
    /// A name, an address or a password is not fit.
    #[error("{0}")]
    Unfit(String),
    /// Name and password do not belong together, or there is no such user: which of the two is not told.
    #[error("there is no user of that name with that password")]
    Unknown,
    /// The hosts make all accounts.
    #[error("the hosts of this server make all accounts; write to them")]
    Closed,
    /// The database fails, or the name is taken.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There is no randomness, or no memory for a hash.
    #[error("the server cannot make a secret: {0}")]
    Secret(String),
}

/// Whose entries are a benchmark's baselines: nobody's, whom no password and no token lets in.
///
/// # Errors
/// If the database fails, or somebody has made an account of that name, as was possible once.
pub async fn baselines(store: &Store) -> Result<User, AccountError> {
    let email = format!("{BASELINES}@localhost");
    match store.user(BASELINES).await {
        Err(StoreError::Missing { .. }) => {
            Ok(store.add_user(BASELINES, &email, None, UserStatus::Active, "admin").await?)
        }
        Ok(user)
            if user.email == email
                && store.password_of(BASELINES).await?.is_none_or(|(_, hash)| hash.is_none()) =>
        {
            Ok(user)
        }
        Ok(_) => unfit(format!(
            "somebody has an account named {BASELINES}; withdraw its entries, and enter baselines elsewhere"
        )),
        Err(error) => Err(error.into()),
    }
}

/// Makes an account for someone who asks, as far as the hosts let people do that.
///
/// # Errors
/// [`AccountError`].
pub async fn sign_up(store: &Store, name: &str, email: &str, password: &str) -> Result<User, AccountError> {
    let status = match store.sign_up_policy().await? {
        SignUpPolicy::Open => UserStatus::Active,
        SignUpPolicy::Approval => UserStatus::Waiting,
        SignUpPolicy::Closed => return Err(AccountError::Closed),
    };
    let (name, email) = (fit_name(name)?, fit_email(email)?);
    let hash = hash(fit_password(password)?).await?;
    Ok(store.add_user(&name, &email, Some(&hash), status, &name).await?)
}

/// Adds a user without a password, for admins. Returns a token, which is never shown again.
///
/// # Errors
/// [`AccountError`].
pub async fn add_user(store: &Store, name: &str, email: &str) -> Result<(User, String), AccountError> {
    let (name, email) = (fit_name(name)?, fit_email(email)?);
    let user = store.add_user(&name, &email, None, UserStatus::Active, "admin").await?;
    let token = new_token(store, &user, "first", "admin").await?;
    Ok((user, token))
}

/// Gives a user a password.
///
/// # Errors
/// [`AccountError`].
pub async fn set_password(
    store: &Store,
    user: &User,
    password: &str,
    actor: &str,
) -> Result<(), AccountError> {
    let hash = hash(fit_password(password)?).await?;
    Ok(store.set_password(user, &hash, actor).await?)
}

/// Makes a token, which is never shown again: `relight_NUMBER_` and 64 hexadecimal digits.
///
/// # Errors
/// [`AccountError`].
pub async fn new_token(store: &Store, user: &User, name: &str, actor: &str) -> Result<String, AccountError> {
    let secret = Secret::new()?;
    let id = store.add_token(user, &fit_line("the token's name", name)?, &secret.hash(), actor).await?;
    Ok(format!("relight_{id}_{}", secret.to_text()))
}

/// Whose token it is, if it is one.
///
/// # Errors
/// If the database fails.
pub async fn user_of_token(store: &Store, token: &str) -> Result<Option<User>, StoreError> {
    let Some((id, secret)) = token.strip_prefix("relight_").and_then(numbered) else { return Ok(None) };
    let Some((user, hash)) = store.token(id).await? else { return Ok(None) };
    if !secret.matches(&hash) || user.status == UserStatus::Blocked {
        return Ok(None);
    }
    store.touch_token(id, Time::now()).await?;
    Ok(Some(user))
}

/// Opens a session for someone with a name, or an address, and a password. Returns what the browser shall keep.
///
/// # Errors
/// [`AccountError::Unknown`], in the same time whether or not there is such a user.
pub async fn sign_in(store: &Store, name: &str, password: &str) -> Result<(User, String), AccountError> {
    let known = store.password_of(name.trim()).await?;
    let (user, hash) = known.map_or((None, None), |(user, hash)| (Some(user), hash));
    let fits = matches(password, hash).await?;
    match user {
        Some(user) if fits && user.status != UserStatus::Blocked => {
            let session = new_session(store, &user).await?;
            Ok((user, session))
        }
        _ => Err(AccountError::Unknown),
    }
}

/// Opens a session. Returns what the browser shall keep: `NUMBER_` and 64 hexadecimal digits.
///
/// # Errors
/// [`AccountError`].
pub async fn new_session(store: &Store, user: &User) -> Result<String, AccountError> {
    let secret = Secret::new()?;
    let id = store.add_session(user, &secret.hash(), Time::now().after(SESSION)).await?;
    Ok(format!("{id}_{}", secret.to_text()))
}

/// Whose session it is, if it is one.
///
/// # Errors
/// If the database fails.
pub async fn user_of_session(store: &Store, session: &str) -> Result<Option<User>, StoreError> {
    let Some((id, secret)) = numbered(session) else { return Ok(None) };
    let found = store.session(id, Time::now()).await?;
    Ok(found
        .filter(|(user, hash)| secret.matches(hash) && user.status != UserStatus::Blocked)
        .map(|(user, _)| user))
}

/// Ends a session.
///
/// # Errors
/// If the database fails.
pub async fn sign_out(store: &Store, session: &str) -> Result<(), StoreError> {
    if user_of_session(store, session).await?.is_some()
        && let Some((id, _)) = numbered(session)
    {
        store.end_session(id).await?;
    }
    Ok(())
}

/// `NUMBER_SECRET`.
fn numbered(text: &str) -> Option<(i64, Secret)> {
    let (id, secret) = text.split_once('_')?;
    Some((id.parse().ok()?, Secret::read(secret)?))
}

fn unfit<T>(problem: impl Into<String>) -> Result<T, AccountError> {
    Err(AccountError::Unfit(problem.into()))
}

fn fit_line(what: &str, text: &str) -> Result<String, AccountError> {
    let text = text.trim();
    if text.is_empty() || text.chars().count() > 64 || text.chars().any(unprintable) {
        return unfit(format!("{what} must have 1 to 64 printable characters"));
    }
    Ok(text.to_owned())
}

/// Names hold no `@`, so that no name is another's address.
fn fit_name(name: &str) -> Result<String, AccountError> {
    let name = fit_line("the name", name)?;
    if name.contains('@') {
        return unfit("the name must not hold an @");
    }
    // The audit log knows the first two, and leaderboards the last.
    if ["admin", "server", BASELINES].iter().any(|taken| name.eq_ignore_ascii_case(taken)) {
        return unfit(format!("the name {name} is not to be had"));
    }
    Ok(name)
}

fn fit_email(email: &str) -> Result<String, AccountError> {
    let email = email.trim();
    let parts = email.split_once('@');
    let plain = email.len() <= 254 && !email.chars().any(|c| c.is_whitespace() || unprintable(c));
    match parts {
        Some((user, host)) if plain && !user.is_empty() && !host.is_empty() && !host.contains('@') => {
            Ok(email.to_owned())
        }
        _ => unfit(format!("{email:?} is no e-mail address")),
    }
}

fn fit_password(password: &str) -> Result<&str, AccountError> {
    if password.chars().count() < SHORTEST || password.len() > LONGEST {
        return unfit(format!(
            "the password must have {SHORTEST} characters or more (at most {LONGEST} bytes)"
        ));
    }
    Ok(password)
}

#[cfg(test)]
mod tests;
