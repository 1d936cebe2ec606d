//! Scores of 8-bit pictures against ground truth: PSNR, SSIM in the two customary windows, and maps of errors.
//!
//! Pictures are RGB8: row-major, interleaved, `3 * width * height` bytes. Scores are over the whole picture, border
//! included where the score's definition includes it, with a data range of 255 (which equals a range of 1 on
//! pictures divided by 255).

mod error;
mod error_map;
mod psnr;
mod ssim;

pub use error::MetricError;
pub use error_map::{error_colour, error_map};
pub use psnr::psnr;
pub use ssim::{ssim, ssim_uniform7};

/// [`psnr`] and [`ssim`] of a picture, on the calling thread alone: for callers that score many pictures at a time.
///
/// # Errors
/// As both.
pub fn psnr_and_ssim(
    picture: &[u8],
    truth: &[u8],
    width: u32,
    height: u32,
) -> Result<(f64, f64), MetricError> {
    Ok((psnr(picture, truth)?, ssim::ssim_on_one_thread(picture, truth, width, height)?))
}
