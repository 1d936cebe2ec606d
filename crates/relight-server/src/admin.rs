//! What admins do that is more than a row of the database.

use std::ops::ControlFlow;
use std::path::Path;

use relight_scene::Split;

use crate::Progress;
use crate::benchmark::{Benchmark, BenchmarkError, BenchmarkScene};
use crate::store::{SceneEntry, Store, StoreError};

/// Why a benchmark is not added.
#[derive(Debug, thiserror::Error)]
pub enum AddError {
    /// Its name does not fit into an address.
    #[error(
        "{0:?} cannot be a benchmark's name: take 1 to 64 small letters, digits and hyphens, a letter or digit first"
    )]
    Name(String),
    /// The folder.
    #[error(transparent)]
    Benchmark(#[from] BenchmarkError),
    /// The folder's path cannot be made absolute.
    #[error("{0}")]
    Path(String),
    /// The database.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Adds a benchmark: a folder of scenes with their ground truth, all of which is looked at. The folder stays where it is, and
/// the server reads it there.
///
/// # Errors
/// [`AddError`].
pub async fn add_benchmark(
    store: &Store,
    name: &str,
    folder: &Path,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Vec<SceneEntry>, AddError> {
    let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
    if name.is_empty()
        || name.len() > 64
        || !name.starts_with(fits)
        || !name.chars().all(|c| fits(c) || c == '-')
    {
        return Err(AddError::Name(name.to_owned()));
    }
    let folder =
        folder.canonicalize().map_err(|error| AddError::Path(format!("{}: {error}", folder.display())))?;
    let benchmark = Benchmark::open(&folder)?;
    benchmark.verify(progress)?;
    let scenes: Vec<SceneEntry> = benchmark.scenes.iter().map(entry).collect();
    store.add_benchmark(name, &folder, &scenes).await?;
    Ok(scenes)
}

fn entry(scene: &BenchmarkScene) -> SceneEntry {
    let count = |split| scene.images.iter().filter(|image| image.split == split).count();
    let (width, height) = scene.images.first().map_or((0, 0), |image| (image.width, image.height));
    SceneEntry {
        name: scene.name.clone(),
        val: count(Split::Val),
        easy: count(Split::Easy),
        hard: count(Split::Hard),
        width,
        height,
    }
}
