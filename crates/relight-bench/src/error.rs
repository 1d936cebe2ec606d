//! What can go wrong.

use std::path::{Path, PathBuf};

use relight_metrics::MetricError;
use relight_render::RenderError;
use relight_scene::SceneError;
use relight_train::TrainError;

/// What can go wrong with jobs, records and tables.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// What was asked for cannot be a list of jobs.
    #[error("{0}")]
    Jobs(String),
    /// A file is not what it should be.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// Training, scoring or a file of a run failed.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A picture could not be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture could not be held against its photograph.
    #[error(transparent)]
    Metric(#[from] MetricError),
}

impl BenchError {
    /// A fault of a file.
    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), problem: problem.into() }
    }
}
