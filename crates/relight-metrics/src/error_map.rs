//! Where two pictures differ.

use crate::error::{MetricError, check};

/// The colour of an error: black for none (0) to pale yellow (1 and more), Inferno's.
pub fn error_colour(share: f64) -> [u8; 3] {
    colorous::INFERNO.eval_continuous(share.clamp(0.0, 1.0)).into_array()
}

/// The mean absolute error of every pixel's channels in the colours of [`error_colour`], which has its brightest from `full` (of 255)
/// on: RGB8, as long as the two pictures. The same pictures give the same bytes.
///
/// Whoever sees it can work out the ground truth from it and the picture.
///
/// # Errors
/// [`MetricError`] if the lengths differ or are not those of RGB pictures, or if the truth is all black.
pub fn error_map(picture: &[u8], truth: &[u8], full: u8) -> Result<Vec<u8>, MetricError> {
    check(picture, truth)?;
    let colours: [[u8; 3]; 256] = std::array::from_fn(|i| error_colour(i as f64 / 255.0));
    let full = 3 * u32::from(full.max(1));
    let pixels = picture.chunks_exact(3).zip(truth.chunks_exact(3));
    let level = |(a, b): (&[u8], &[u8])| {
        let sum: u32 = a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum();
        (sum * 255 / full).min(255) as usize
    };
    Ok(pixels.flat_map(|pair| colours[level(pair)]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_go_from_no_error_to_full_error() {
        let truth = [7, 8, 9, 0, 100, 9, 0, 0, 0, 0, 0, 0];
        let picture = [7, 8, 9, 32, 68, 41, 64, 64, 64, 255, 255, 255];
        let map = error_map(&picture, &truth, 64).unwrap();
        assert_eq!(map[..3], [0, 0, 4]);
        assert_eq!(map[3..6], error_colour(127.0 / 255.0));
        assert_eq!(map[6..9], error_colour(1.0));
        assert_eq!(map[9..], error_colour(2.0));
        assert_eq!(error_map(&picture[1..], &truth, 64), Err(MetricError::Sizes { picture: 11, truth: 12 }));
    }
}
