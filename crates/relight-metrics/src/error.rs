//! What keeps two pictures from being compared.

/// Why two pictures have no score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetricError {
    /// The pictures hold different numbers of bytes.
    #[error(
        "the picture holds {picture} bytes and the ground truth {truth}: only pictures of equal size compare"
    )]
    Sizes {
        /// Bytes of the picture.
        picture: usize,
        /// Bytes of the ground truth.
        truth: usize,
    },
    /// The bytes are not those of an RGB8 picture of the given size, or there are none.
    #[error(
        "{bytes} bytes are no {width}x{height} RGB picture, which has 3 bytes a pixel and at least one pixel"
    )]
    Length {
        /// Bytes found.
        bytes: usize,
        /// Width given, pixels.
        width: u32,
        /// Height given, pixels.
        height: u32,
    },
    /// The number of bytes is no multiple of 3, or zero.
    #[error("{0} bytes are no RGB picture, which has 3 bytes a pixel and at least one pixel")]
    NotRgb(usize),
    /// The picture is smaller than the window of the score.
    #[error("a picture of {width}x{height} pixels is too small for a window of {window}x{window}")]
    TooSmall {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Side of the window, pixels.
        window: u32,
    },
    /// No byte of the ground truth is brighter than what a lossy codec leaves of black.
    #[error(
        "the ground truth is all black, so there is nothing to compare with: the official ReNe release blacks out its \
         test images, whose scores come from the benchmark's evaluation server. Score on the validation split, or on \
         a capture whose test images are there"
    )]
    BlackTruth,
}

/// A picture no byte of which is brighter is black: lossy codecs leave a trace.
const BLACK: u8 = 2;

/// Checks what every score asks of its pictures.
pub(crate) fn check(picture: &[u8], truth: &[u8]) -> Result<(), MetricError> {
    if picture.len() != truth.len() {
        return Err(MetricError::Sizes { picture: picture.len(), truth: truth.len() });
    }
    if truth.is_empty() || !truth.len().is_multiple_of(3) {
        return Err(MetricError::NotRgb(truth.len()));
    }
    if truth.iter().all(|&byte| byte <= BLACK) {
        return Err(MetricError::BlackTruth);
    }
    Ok(())
}
