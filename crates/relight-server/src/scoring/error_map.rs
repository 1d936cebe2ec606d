//! Where an image errs.

use std::sync::LazyLock;

use relight_scene::Image;

use super::ScoringError;
use crate::benchmark::Benchmark;
use crate::submission::{ImageReader, Limits, Refusal, Submission, SubmissionError};

/// Mean absolute error of a pixel's channels, of 255, from which on the map shows its brightest colour.
pub const FULL_ERROR: u32 = 64;

/// The colours of no error to [`FULL_ERROR`].
static COLOURS: LazyLock<[[u8; 3]; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| colorous::INFERNO.eval_rational(i, 256).into_array()));

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
    let pixels = reader.rgb.chunks_exact(3).zip(truth.data.chunks_exact(3));
    let data = pixels.flat_map(|(a, b)| COLOURS[level(a, b)]).collect();
    Ok(Image { width: truth.width, height: truth.height, data })
}

/// The mean absolute difference of two pixels as an index of a colour.
fn level(a: &[u8], b: &[u8]) -> usize {
    let sum: u32 = a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum();
    (sum * 255 / (3 * FULL_ERROR)).min(255) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_go_from_no_error_to_full_error() {
        assert_eq!(level(&[7, 8, 9], &[7, 8, 9]), 0);
        assert_eq!(level(&[0, 100, 9], &[32, 68, 41]), 127);
        assert_eq!(level(&[0, 0, 0], &[64, 64, 64]), 255);
        assert_eq!(level(&[0, 0, 0], &[255, 255, 255]), 255);
        assert_eq!(COLOURS[0], [0, 0, 4]);
    }
}
