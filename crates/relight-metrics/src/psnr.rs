//! Peak signal-to-noise ratio.

use fearless_simd::{Level, dispatch};

use crate::error::{MetricError, check};

/// PSNR in decibels of an RGB8 `picture` against the `truth`: `10 log10(255^2 / mse)`, the mean squared error being
/// over all pixels and channels. Infinite for equal pictures.
///
/// # Errors
/// [`MetricError`] if the lengths differ or are not those of RGB pictures, or if the truth is all black.
pub fn psnr(picture: &[u8], truth: &[u8]) -> Result<f64, MetricError> {
    check(picture, truth)?;
    let squares = dispatch!(Level::new(), _simd => squares(picture, truth));
    if squares == 0 {
        return Ok(f64::INFINITY);
    }
    let mse = squares as f64 / truth.len() as f64;
    Ok(10.0 * (255.0 * 255.0 / mse).log10())
}

/// The sum of squared differences: in whole numbers, so that it is exact and its order does not matter.
#[inline(always)]
fn squares(picture: &[u8], truth: &[u8]) -> u64 {
    /// So many squares of bytes fit into 32 bits.
    const PART: usize = 1 << 16;
    let parts = picture.chunks(PART).zip(truth.chunks(PART));
    let square = |(&a, &b): (&u8, &u8)| u32::from(u16::from(a.abs_diff(b)) * u16::from(a.abs_diff(b)));
    parts.map(|(a, b)| u64::from(a.iter().zip(b).map(square).sum::<u32>())).sum()
}
