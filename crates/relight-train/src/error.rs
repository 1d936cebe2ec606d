//! What can go wrong while training and scoring.

use std::path::{Path, PathBuf};

use relight_field::engine::EngineError;
use relight_field::parameters::ParameterError;
use relight_field::weights_file::WeightsError;
use relight_metrics::MetricError;
use relight_render::RenderError;
use relight_scene::SceneError;

/// What can go wrong while training and scoring.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting of a recipe is out of range.
    #[error("recipe: {0}")]
    Recipe(String),
    /// The scene does not hold what training or scoring needs.
    #[error("{0}")]
    Data(String),
    /// A file or folder of a run is not what it should be.
    #[error("{}: {problem}", path.display())]
    Run {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// A file could not be read or written.
    #[error("{}: {source}. Check the path, its permissions and the space left on the disk", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A ground truth image is all black.
    #[error(
        "{}: {count} of the {total} ground truth images of this split are all black, this one first. The official \
         ReNe release blacks out its test images, so nothing can be scored against them here: score another split \
         (--split val), or render the test views and submit them",
        path.display()
    )]
    BlackGroundTruth {
        /// The first such image.
        path: PathBuf,
        /// How many there are.
        count: usize,
        /// Images in the split.
        total: usize,
    },
    /// A loss or gradient was not finite.
    #[error(
        "step {step}: {what} is not finite; training stopped. {} {}; a lower learning rate or tighter bounds usually \
         mend this",
        if *kept {
            "The last good checkpoint and the best weights are kept in"
        } else {
            "There was no checkpoint yet, so nothing is kept in"
        },
        run.display()
    )]
    NonFinite {
        /// The step.
        step: u64,
        /// Where it arose.
        what: String,
        /// The run's folder.
        run: PathBuf,
        /// Whether it holds a checkpoint.
        kept: bool,
    },
    /// The scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The field cannot be made.
    #[error(transparent)]
    Parameters(#[from] ParameterError),
    /// Weights could not be read or written.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// A score could not be computed.
    #[error("{}: {source}", path.display())]
    Metric {
        /// The ground truth.
        path: PathBuf,
        /// Why.
        source: MetricError,
    },
    /// A picture could not be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl TrainError {
    /// Wraps an I/O error with the file it is about.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }

    /// Wraps a failed score with the ground truth it is about.
    pub(crate) fn metric(path: &Path) -> impl Fn(MetricError) -> Self {
        move |source| Self::Metric { path: path.to_owned(), source }
    }

    /// A fault of a run's file.
    pub(crate) fn run(path: &Path, problem: impl Into<String>) -> Self {
        Self::Run { path: path.to_owned(), problem: problem.into() }
    }
}
