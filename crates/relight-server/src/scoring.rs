//! How well a submission does.

mod decibels;
mod error_map;

use std::io;
use std::ops::ControlFlow;
use std::path::PathBuf;

use relight_metrics::{MetricError, psnr_and_ssim};
use relight_scene::Split;
use serde::{Deserialize, Serialize};

pub use error_map::{FULL_ERROR, error_map};

use crate::benchmark::{Benchmark, BenchmarkError, SCORED};
use crate::parallel::Progress;
use crate::submission::{Limits, Refusal, Submission, SubmissionError};

/// Names this way of scoring; changes whenever any digit of any score may.
pub const EVALUATOR: &str = concat!("relight ", env!("CARGO_PKG_VERSION"), ", scores 2");

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
    #[serde(with = "decibels")]
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
    #[serde(with = "decibels")]
    pub psnr: f64,
    /// SSIM with a Gaussian window.
    pub ssim: f64,
}

/// Why a submission has no scores.
#[derive(Debug, thiserror::Error)]
pub enum ScoringError {
    /// An image of the submission is bad: what [`check`](crate::submission::check) would have told.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Ground truth cannot be read. No fault of the submission's.
    #[error(transparent)]
    Truth(#[from] BenchmarkError),
    /// Two images do not compare: they are smaller than the window of SSIM.
    #[error("{entry}: {source}")]
    Metric {
        /// The image's name in the zip.
        entry: String,
        /// Why.
        source: MetricError,
    },
    /// The zip cannot be read from the disk. No fault of the submission's.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The zip.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The caller asked to stop.
    #[error("stopped before all images were scored")]
    Stopped,
}

impl From<SubmissionError> for ScoringError {
    fn from(error: SubmissionError) -> ScoringError {
        match error {
            SubmissionError::Refused(refusal) => ScoringError::Refused(refusal),
            SubmissionError::Io { path, source } => ScoringError::Io { path, source },
            SubmissionError::Stopped => ScoringError::Stopped,
        }
    }
}

/// Scores a submission that [`inspect`](crate::submission::inspect) or [`check`](crate::submission::check) let pass: PSNR and SSIM
/// (11x11 Gaussian window of sigma 1.5) of its 8-bit pictures at full size. As many images at a time as the current rayon pool has
/// threads, one on each. The same submission has the same scores to the last digit, whatever the number of threads.
///
/// # Errors
/// [`ScoringError`]; its kind tells whose fault it is.
pub fn score(
    submission: &Submission,
    benchmark: &Benchmark,
    limits: &Limits,
    progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Scores, ScoringError> {
    let one = |index: usize, rgb: &[u8]| -> Result<ImageScore, ScoringError> {
        let submitted = &submission.images[index];
        let scene = &benchmark.scenes[submitted.scene];
        let image = &scene.images[submitted.image];
        let truth = image.read_truth()?;
        let (psnr, ssim) = psnr_and_ssim(rgb, &truth.data, truth.width, truth.height)
            .map_err(|source| ScoringError::Metric { entry: image.entry.clone(), source })?;
        let (camera, light) = (image.camera, image.light);
        Ok(ImageScore { scene: scene.name.clone(), split: image.split, camera, light, psnr, ssim })
    };
    let images = submission.each_image(benchmark, limits, one, progress)?;
    Ok(Scores::of(images))
}

impl Scores {
    /// The scores of images and their means; scenes in the order in which images first show them.
    pub fn of(images: Vec<ImageScore>) -> Scores {
        let mut scenes: Vec<SceneScores> = Vec::new();
        for image in &images {
            if scenes.iter().all(|scene| scene.scene != image.scene) {
                scenes.push(scene_scores(&image.scene, &images));
            }
        }
        let over_scenes = |split: Split| {
            let means: Vec<Mean> = scenes
                .iter()
                .flat_map(|scene| &scene.means)
                .filter(|mean| mean.split == split)
                .copied()
                .collect();
            let images = means.iter().map(|mean| mean.images).sum();
            mean(split, images, means.iter().map(|mean| (mean.psnr, mean.ssim)))
        };
        let means = SCORED.into_iter().filter_map(over_scenes).collect();
        Scores { evaluator: EVALUATOR.to_owned(), means, scenes, images }
    }
}

fn scene_scores(scene: &str, images: &[ImageScore]) -> SceneScores {
    let of_split = |split: Split| {
        let scores: Vec<(f64, f64)> = images
            .iter()
            .filter(|image| image.scene == scene && image.split == split)
            .map(|image| (image.psnr, image.ssim))
            .collect();
        mean(split, scores.len(), scores.into_iter())
    };
    SceneScores { scene: scene.to_owned(), means: SCORED.into_iter().filter_map(of_split).collect() }
}

/// The mean of scores, summed in their order; none of none.
fn mean(split: Split, images: usize, scores: impl ExactSizeIterator<Item = (f64, f64)>) -> Option<Mean> {
    let n = scores.len() as f64;
    if images == 0 {
        return None;
    }
    let (psnr, ssim) = scores.fold((0.0, 0.0), |(psnr, ssim), (p, s)| (psnr + p, ssim + s));
    Some(Mean { split, images, psnr: psnr / n, ssim: ssim / n })
}
