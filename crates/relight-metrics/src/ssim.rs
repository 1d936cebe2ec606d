//! Structural similarity (Wang et al. 2004), in the two forms that published tables use.

use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

use crate::error::{MetricError, check};

mod band;

/// SSIM with an 11x11 Gaussian window of sigma 1.5, mean over pixels and channels: the defaults of torchmetrics'
/// `StructuralSimilarityIndexMeasure` with data range 1. The window is centred on every pixel and the pictures are
/// mirrored at their borders without repeating the outermost pixel, as torchmetrics does since release 1.4.2; earlier
/// releases left out a border of 5 pixels.
///
/// `picture` and `truth` are RGB8 of `width` x `height` pixels. The same pictures have the same score to the last bit, with any
/// number of threads and on any machine.
///
/// # Errors
/// [`MetricError`] if lengths and sizes disagree, a side is below 11 pixels, or the truth is all black.
pub fn ssim(picture: &[u8], truth: &[u8], width: u32, height: u32) -> Result<f64, MetricError> {
    let compared = gaussian(picture, truth, width, height)?;
    Ok(compared.mean(compared.bands().into_par_iter().map(|band| compared.band_sum(band)).collect()))
}

/// [`ssim`] on the calling thread alone.
pub(crate) fn ssim_on_one_thread(
    picture: &[u8],
    truth: &[u8],
    width: u32,
    height: u32,
) -> Result<f64, MetricError> {
    let compared = gaussian(picture, truth, width, height)?;
    Ok(compared.mean(compared.bands().into_iter().map(|band| compared.band_sum(band)).collect()))
}

/// SSIM with a 7x7 uniform window and sample covariances, mean over pixels and channels: the defaults of
/// scikit-image's `structural_similarity` with `channel_axis=2, data_range=255`. Windows that do not fit into the
/// picture are left out.
///
/// `picture` and `truth` are RGB8 of `width` x `height` pixels.
///
/// # Errors
/// [`MetricError`] if lengths and sizes disagree, a side is below 7 pixels, or the truth is all black.
pub fn ssim_uniform7(picture: &[u8], truth: &[u8], width: u32, height: u32) -> Result<f64, MetricError> {
    let window = Window { taps: [1.0 / 7.0; 4], covariance_scale: 49.0 / 48.0, margin: 3 };
    let compared = Compared::new(picture, truth, width, height, window)?;
    Ok(compared.mean(compared.bands().into_par_iter().map(|band| compared.band_sum(band)).collect()))
}

fn gaussian<'a>(
    picture: &'a [u8],
    truth: &'a [u8],
    width: u32,
    height: u32,
) -> Result<Compared<'a, 6>, MetricError> {
    let gauss: [f64; 6] = std::array::from_fn(|d| (-0.5 * (d as f64 / 1.5).powi(2)).exp());
    let sum = gauss[0] + 2.0 * gauss[1..].iter().sum::<f64>();
    let mut taps = gauss.map(|g| (g / sum) as f32);
    // To single precision the weights sum to one exactly: else flat regions would seem to vary.
    taps[0] = (1.0 - 2.0 * taps[1..].iter().map(|&tap| f64::from(tap)).sum::<f64>()) as f32;
    Compared::new(picture, truth, width, height, Window { taps, covariance_scale: 1.0, margin: 0 })
}

/// A separable symmetric window.
struct Window<const TAPS: usize> {
    /// The weights along one axis, from the middle outwards; the whole axis sums to 1.
    taps: [f32; TAPS],
    /// Factor from population to the wanted (co)variances.
    covariance_scale: f32,
    /// Pixels of the border round which no window is centred. Where a window reaches over the border all the same, pixels
    /// beyond it are the mirrored ones within; the border pixel is not repeated.
    margin: usize,
}

/// Two pictures under a window of `2 TAPS - 1` pixels.
struct Compared<'a, const TAPS: usize> {
    picture: &'a [u8],
    truth: &'a [u8],
    width: usize,
    height: usize,
    window: Window<TAPS>,
    level: Level,
}

impl<'a, const TAPS: usize> Compared<'a, TAPS> {
    /// Pixels to either side of a window's middle.
    const RADIUS: usize = TAPS - 1;

    fn new(
        picture: &'a [u8],
        truth: &'a [u8],
        width: u32,
        height: u32,
        window: Window<TAPS>,
    ) -> Result<Compared<'a, TAPS>, MetricError> {
        check(picture, truth)?;
        let (w, h) = (width as usize, height as usize);
        if w.checked_mul(h).and_then(|pixels| pixels.checked_mul(3)) != Some(truth.len()) {
            return Err(MetricError::Length { bytes: truth.len(), width, height });
        }
        let side = 2 * Self::RADIUS + 1;
        if w.min(h) < side {
            return Err(MetricError::TooSmall { width, height, window: side as u32 });
        }
        Ok(Compared { picture, truth, width: w, height: h, window, level: Level::new() })
    }

    /// Columns and rows on which a window is centred.
    fn centres(&self) -> (usize, usize) {
        (self.width - 2 * self.window.margin, self.height - 2 * self.window.margin)
    }

    /// The first rows of the bands in which windows are scored.
    fn bands(&self) -> Vec<usize> {
        (0..self.centres().1).step_by(band::ROWS).collect()
    }

    /// Sums SSIM over a band's windows.
    fn band_sum(&self, top: usize) -> f64 {
        dispatch!(self.level, simd => band::sum(simd, self, top))
    }

    /// The score, from the sums of all bands.
    fn mean(&self, bands: Vec<f64>) -> f64 {
        let (columns, rows) = self.centres();
        bands.iter().sum::<f64>() / (3 * columns * rows) as f64
    }

    /// The bytes of the picture's row at the place `i`, counted from the first row of the first window.
    #[inline(always)]
    fn row<'b>(&self, picture: &'b [u8], i: usize) -> &'b [u8] {
        let y = self.mirrored(i, self.height);
        &picture[3 * y * self.width..3 * (y + 1) * self.width]
    }

    /// The pixel of `n` at the place `i`, counted from the first of the first window. Beyond the last window any will do.
    #[inline(always)]
    fn mirrored(&self, i: usize, n: usize) -> usize {
        let i = (i + self.window.margin).min(n - 1 + 2 * Self::RADIUS).abs_diff(Self::RADIUS);
        if i < n { i } else { 2 * (n - 1) - i }
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::Simd as _;

    use super::*;

    fn noise(bytes: usize, seed: u32) -> Vec<u8> {
        (0..bytes as u32).map(|i| (i.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 13) as u8).collect()
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let (width, height) = (331, 127);
        let (a, b) = (noise(3 * 331 * 127, 1), noise(3 * 331 * 127, 77));
        let best = Level::new();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let lower = [best.as_avx2().map(|s| s.level()), best.as_sse2().map(|s| s.level())];
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        let lower = [None];
        let score = ssim(&a, &b, width, height).unwrap();
        for level in lower.into_iter().flatten() {
            let compared = Compared { level, ..gaussian(&a, &b, width, height).unwrap() };
            let bands = compared.bands().into_iter().map(|band| compared.band_sum(band)).collect();
            assert_eq!(compared.mean(bands).to_bits(), score.to_bits(), "{level:?}");
        }
        assert_eq!(ssim_on_one_thread(&a, &b, width, height).unwrap().to_bits(), score.to_bits());
        for threads in 1..4 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let on_pool = pool.install(|| ssim(&a, &b, width, height)).unwrap();
            assert_eq!(on_pool.to_bits(), score.to_bits());
        }
    }
}
