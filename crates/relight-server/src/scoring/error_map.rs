//! Where an image errs.

use relight_scene::Image;

use super::ScoringError;
use crate::benchmark::Benchmark;
use crate::submission::{ImageReader, Limits, Refusal, Submission, SubmissionError};

/// Mean absolute error of a pixel's channels, of 255, from which on the map shows its brightest colour.
pub const FULL_ERROR: u8 = 64;

/// A picture of the errors of a submitted image: the mean absolute error of every pixel, from black (none) to pale yellow
/// ([`FULL_ERROR`] of 255 and more). The same images give the same bytes.
///
/// Whoever sees it can work out the ground truth from it and the image: for splits whose ground truth is public.
///
/// # Errors
/// As [`score`](super::score); `index` is one of the submission's images, or there is no such image.
pub fn error_map(
    submission: &Submission,
    benchmark: &Benchmark,
    limits: &Limits,
    index: usize,
) -> Result<Image, ScoringError> {
    let io = |source| ScoringError::from(SubmissionError::Io { path: submission.zip.clone(), source });
    let Some(submitted) = submission.images.get(index) else {
        return Err(io(std::io::Error::other(format!("it holds no image {index}"))));
    };
    let mut reader = ImageReader::default();
    submission
        .read(&mut reader, benchmark, limits, index)
        .map_err(io)?
        .map_err(|problems| Refusal { problems, more: 0 })?;
    let truth = benchmark.scenes[submitted.scene].images[submitted.image].read_truth()?;
    let entry = &benchmark.scenes[submitted.scene].images[submitted.image].entry;
    let data = relight_metrics::error_map(&reader.rgb, &truth.data, FULL_ERROR)
        .map_err(|source| ScoringError::Metric { entry: entry.clone(), source })?;
    Ok(Image { width: truth.width, height: truth.height, data })
}
