//! How long zips are kept. Scores, receipts and pictures stay in any case.

use std::fs;
use std::time::Duration;

use crate::data_folder::{DataFolder, FolderError, remove};
use crate::store::{Store, StoreError};
use crate::time::Time;

/// What was removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Zips.
    pub zips: usize,
    /// Their bytes.
    pub bytes: u64,
}

/// Why zips are not removed.
#[derive(Debug, thiserror::Error)]
pub enum PruneError {
    /// The database fails.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A zip stays.
    #[error(transparent)]
    Folder(#[from] FolderError),
}

/// Removes the zips of submissions that had their scores before the time that [`Store::zip_days`] leaves them; none if zips are
/// kept for good. The audit log tells of each.
///
/// # Errors
/// [`PruneError`]; what was removed before stays so.
pub async fn prune(folder: &DataFolder, store: &Store, actor: &str, now: Time) -> Result<Pruned, PruneError> {
    let mut pruned = Pruned::default();
    let Some(days) = store.zip_days().await? else { return Ok(pruned) };
    let before = now.before(Duration::from_secs(24 * 3600) * days);
    for id in store.scored_before(before).await? {
        let zip = folder.zip(&id);
        // Most were removed the last time.
        let Ok(metadata) = fs::metadata(&zip) else { continue };
        remove(&zip)?;
        store.note_pruned(&id, actor, metadata.len(), now).await?;
        pruned.zips += 1;
        pruned.bytes += metadata.len();
    }
    Ok(pruned)
}
