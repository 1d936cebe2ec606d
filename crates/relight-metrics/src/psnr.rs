//! Peak signal-to-noise ratio.

use crate::error::{MetricError, check};

/// PSNR in decibels of an RGB8 `picture` against the `truth`: `10 log10(255^2 / mse)`, the mean squared error being
/// over all pixels and channels. Infinite for equal pictures.
///
/// # Errors
/// [`MetricError`] if the lengths differ or are not those of RGB pictures, or if the truth is all black.
pub fn psnr(picture: &[u8], truth: &[u8]) -> Result<f64, MetricError> {
    check(picture, truth)?;
    // In whole numbers, so that the sum is exact and its order does not matter.
    let squares: u64 = picture.iter().zip(truth).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2)).sum();
    if squares == 0 {
        return Ok(f64::INFINITY);
    }
    let mse = squares as f64 / truth.len() as f64;
    Ok(10.0 * (255.0 * 255.0 / mse).log10())
}
