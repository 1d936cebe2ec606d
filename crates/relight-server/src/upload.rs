//! Taking zips in.
//!
//! A zip streams into a file under `incoming/`, hashed on the way and never held in memory. Whole, it is forced to the disk
//! and renamed into `submissions/`; then one transaction checks the quota and makes it a queued submission. A kill between
//! the two leaves a zip that nothing speaks of, and the next start removes it: what was answered with 202 is never lost,
//! and no half of a zip is ever seen.

use std::collections::HashMap;
use std::fmt::Display;
use std::io::{Read, Write};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::app::{App, AppState};
use crate::data_folder::sync_folder;
use crate::limits::TooMany;
use crate::method::{Method, Phase, Visibility};
use crate::receipt::to_hex;
use crate::store::{NewSubmission, StoreError, User};
use crate::time::Time;

/// Uploads of all users at a time.
const AT_A_TIME: usize = 32;
/// Uploads of one user at a time.
const OF_A_USER: usize = 4;
/// The longest silence within an upload.
const SILENCE: Duration = Duration::from_secs(60);
/// The slowest upload, bytes a second, after [`SILENCE`].
const SLOWEST: u64 = 10_000;
/// Bytes of the disk that uploads leave free.
const RESERVE: u64 = 1 << 30;
/// Bytes of an upload until the disk is looked at again: with all uploads at a time, half of [`RESERVE`].
const LOOK_AGAIN: u64 = RESERVE / 2 / AT_A_TIME as u64;
/// What is still read of an upload that is turned away, so that its client gets to read why.
const DRAINED: u64 = 16 << 20;
/// How long that may take.
const DRAINING: Duration = Duration::from_secs(5);

/// Why an upload is no submission.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// The zip is longer than any may be.
    #[error("the zip is longer than the {0} bytes that this server takes")]
    TooLong(u64),
    /// The connection broke.
    #[error("the upload broke off: {0}")]
    Broken(String),
    /// There was nothing in it.
    #[error("the body is empty; it must be the zip itself")]
    Empty,
    /// Less came than was announced.
    #[error("{received} bytes came, and {declared} were announced")]
    Short {
        /// Bytes received.
        received: u64,
        /// Bytes announced.
        declared: u64,
    },
    /// Too little came for too long.
    #[error("the upload is too slow: {0}; try again over a better line")]
    Slow(&'static str),
    /// Too many uploads at a time.
    #[error("too many uploads at the same time; try again when one has ended")]
    Busy,
    /// There is no room on the disk.
    #[error("the server's disk is full; tell its hosts")]
    Full,
    /// Too many in a row.
    #[error("too many uploads")]
    TooMany(TooMany),
    /// The quota is used up, there is no such benchmark, the database fails.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The server's fault.
    #[error("{0}")]
    Server(String),
}

/// What comes with a zip.
#[derive(Clone, Debug)]
pub struct Upload {
    /// Who uploads.
    pub user: User,
    /// To which benchmark.
    pub benchmark: String,
    /// Which images it is about.
    pub phase: Phase,
    /// Who shall see it.
    pub visibility: Visibility,
    /// What is said of it.
    pub method: Method,
    /// Bytes that the client announces, if it does.
    pub declared: Option<u64>,
}

/// Who is uploading how much at the moment.
#[derive(Debug, Default)]
pub(crate) struct Uploads(Mutex<HashMap<i64, usize>>);

/// The right to upload, given back when dropped.
pub(crate) struct Slot {
    app: AppState,
    user: i64,
}

impl Slot {
    fn take(app: &AppState, user: i64) -> Result<Slot, UploadError> {
        let mut all = app.uploads.0.lock().unwrap_or_else(PoisonError::into_inner);
        let of_all: usize = all.values().sum();
        let own = all.entry(user).or_default();
        if of_all >= AT_A_TIME || *own >= OF_A_USER {
            return Err(UploadError::Busy);
        }
        *own += 1;
        Ok(Slot { app: Arc::clone(app), user })
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut all = self.app.uploads.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = all.get_mut(&self.user) {
            *own -= 1;
            if *own == 0 {
                all.remove(&self.user);
            }
        }
    }
}

/// The right of a user to upload now: to be had before anything long is read.
///
/// # Errors
/// [`UploadError::Busy`] or [`UploadError::TooMany`].
pub(crate) fn begin(app: &AppState, user: i64) -> Result<Slot, UploadError> {
    app.rates.upload(user).map_err(UploadError::TooMany)?;
    Slot::take(app, user)
}

/// A zip that came whole and lies on the disk.
struct Received {
    file: NamedTempFile,
    sha256: String,
    bytes: u64,
}

/// Takes a zip in and makes it a submission that waits to be scored. Returns the submission's name.
///
/// # Errors
/// [`UploadError`]; nothing is left then.
pub async fn receive<E: Display>(
    app: &AppState,
    upload: Upload,
    body: impl Stream<Item = Result<Bytes, E>> + Unpin,
) -> Result<String, UploadError> {
    receive_within(app, begin(app, upload.user.id), upload, body).await
}

/// As [`receive`], by a right that was asked for already.
pub(crate) async fn receive_within<E: Display>(
    app: &AppState,
    slot: Result<Slot, UploadError>,
    upload: Upload,
    mut body: impl Stream<Item = Result<Bytes, E>> + Unpin,
) -> Result<String, UploadError> {
    let taken = async {
        let slot = slot?;
        admit(app, &upload).await?;
        let received = write(app, &upload, &mut body).await?;
        // Not within the request: a client that leaves now does not stop what has begun.
        let kept = tokio::spawn(keep(Arc::clone(app), upload, received, slot));
        kept.await.map_err(server)?
    };
    let taken = taken.await;
    if taken.is_err() {
        app.metrics.uploads_refused.fetch_add(1, Ordering::Relaxed);
        drain(&mut body).await;
    }
    taken
}

/// As [`receive`], from a file that lies here already.
///
/// # Errors
/// As [`receive`].
pub async fn receive_file(
    app: &AppState,
    upload: Upload,
    mut file: std::fs::File,
) -> Result<String, UploadError> {
    let chunks = std::iter::from_fn(move || {
        let mut chunk = vec![0; 1 << 20];
        match file.read(&mut chunk) {
            Ok(0) => None,
            Ok(length) => {
                chunk.truncate(length);
                Some(Ok(Bytes::from(chunk)))
            }
            Err(error) => Some(Err(error)),
        }
    });
    receive(app, upload, futures_util::stream::iter(chunks)).await
}

/// Whether an upload may begin: what can be known before its first byte.
async fn admit(app: &AppState, upload: &Upload) -> Result<(), UploadError> {
    let benchmark = app.store.benchmark(&upload.benchmark).await?;
    app.store.could_submit(&benchmark, &upload.user, upload.phase, Time::now()).await?;
    let longest = app.settings.limits.zip_bytes;
    if upload.declared.is_some_and(|declared| declared > longest) {
        return Err(UploadError::TooLong(longest));
    }
    leave_room(app, upload.declared.unwrap_or(0))
}

/// Whether so many bytes more leave what uploads are to leave free.
fn leave_room(app: &App, bytes: u64) -> Result<(), UploadError> {
    let free = fs4::available_space(app.folder.incoming()).map_err(server)?;
    if free < RESERVE.saturating_add(bytes) { Err(UploadError::Full) } else { Ok(()) }
}

fn server(error: impl Display) -> UploadError {
    UploadError::Server(error.to_string())
}

fn disk(error: std::io::Error) -> UploadError {
    match error.kind() {
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => UploadError::Full,
        _ => server(error),
    }
}

/// Streams a body into a file. Whatever goes wrong, the file is gone before it is told.
async fn write<E: Display>(
    app: &App,
    upload: &Upload,
    body: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin),
) -> Result<Received, UploadError> {
    let folder = app.folder.incoming();
    // Hashing and writing block; a few chunks may wait for them, and no more are read meanwhile.
    let (chunks, mut waiting) = mpsc::channel::<Bytes>(8);
    let writer = tokio::task::spawn_blocking(move || -> std::io::Result<Received> {
        let mut file = NamedTempFile::new_in(folder)?;
        let (mut hash, mut bytes) = (Sha256::new(), 0);
        while let Some(chunk) = waiting.blocking_recv() {
            hash.update(&chunk);
            bytes += chunk.len() as u64;
            file.write_all(&chunk)?;
        }
        Ok(Received { file, sha256: to_hex(&hash.finalize()), bytes })
    });
    let passed_on = pass_on(app, body, chunks).await;
    let written = writer.await.map_err(server)?;
    passed_on?;
    let written = written.map_err(disk)?;
    match upload.declared {
        _ if written.bytes == 0 => Err(UploadError::Empty),
        Some(declared) if declared != written.bytes => {
            Err(UploadError::Short { received: written.bytes, declared })
        }
        _ => Ok(written),
    }
}

/// Hands a body over to whoever writes it, within the limits of length and slowness.
async fn pass_on<E: Display>(
    app: &App,
    body: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin),
    chunks: mpsc::Sender<Bytes>,
) -> Result<(), UploadError> {
    let (begun, mut received, mut looked_at) = (Instant::now(), 0, 0);
    let longest = app.settings.limits.zip_bytes;
    loop {
        let chunk = match timeout(SILENCE, body.next()).await {
            Ok(Some(chunk)) => chunk.map_err(|error| UploadError::Broken(error.to_string()))?,
            Ok(None) => return Ok(()),
            Err(_) => return Err(UploadError::Slow("nothing came for a minute")),
        };
        received += chunk.len() as u64;
        app.metrics.uploaded_bytes.fetch_add(chunk.len() as u64, Ordering::Relaxed);
        if received > longest {
            return Err(UploadError::TooLong(longest));
        }
        if received >= looked_at + LOOK_AGAIN {
            looked_at = received;
            leave_room(app, 0)?;
        }
        if received < begun.elapsed().saturating_sub(SILENCE).as_secs() * SLOWEST {
            return Err(UploadError::Slow("less than 10 kB a second"));
        }
        if chunks.send(chunk).await.is_err() {
            return Ok(()); // The writer has failed, and tells why.
        }
    }
}

/// Gives a zip its place, then makes it a submission.
async fn keep(app: AppState, upload: Upload, received: Received, slot: Slot) -> Result<String, UploadError> {
    let mut random = [0; 8];
    getrandom::fill(&mut random).map_err(server)?;
    let id = to_hex(&random);
    let Received { file, sha256, bytes } = received;
    let (zip, folder) = (app.folder.zip(&id), app.folder.submissions());
    let placed = tokio::task::spawn_blocking(move || -> Result<(), UploadError> {
        file.as_file().sync_all().map_err(disk)?;
        file.persist_noclobber(zip).map_err(server)?;
        sync_folder(&folder).map_err(server)
    });
    placed.await.map_err(server)??;
    let Upload { user, benchmark, phase, visibility, method, .. } = upload;
    let new = NewSubmission { id: id.clone(), benchmark, phase, visibility, method, sha256, bytes };
    if let Err(error) = app.store.submit(&new, user.id, Time::now()).await {
        app.folder.forget(&id).map_err(server)?;
        return Err(error.into());
    }
    drop(slot);
    tracing::info!(submission = id, user = user.name, benchmark = new.benchmark, bytes, "taken in");
    app.wake.notify_waiters();
    Ok(id)
}

/// Reads on for a little: most clients look for an answer only once they have sent all.
async fn drain<E>(body: &mut (impl Stream<Item = Result<Bytes, E>> + Unpin)) {
    let reading = async {
        let mut left = DRAINED;
        while let Some(Ok(chunk)) = body.next().await {
            left = left.saturating_sub(chunk.len() as u64);
            if left == 0 {
                break;
            }
        }
    };
    // Whether it all came does not matter.
    let _ = timeout(DRAINING, reading).await;
}
