//! Structural similarity (Wang et al. 2004), in the two forms that published tables use.

use std::ops::Range;

use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

use crate::error::{MetricError, check};

/// `2 (k1 L)^2` and `2 (k2 L)^2` for the data range `L` = 255.
const TWICE_C1: f32 = 2.0 * (0.01 * 255.0) * (0.01 * 255.0);
const TWICE_C2: f32 = 2.0 * (0.03 * 255.0) * (0.03 * 255.0);

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

/// Rows that are filtered together. Sums are over such bands, then over all, so that the score does not depend on threads.
const BAND: usize = 120;
/// Pixels of a row that are filtered together: what is kept of the rows round one fits into the nearest cache.
const STRIP: usize = 48;
/// Samples of those pixels; few enough for the sum of their bytes to fit into 16 bits.
const SAMPLES: usize = 3 * STRIP;
/// With those of the pixels to both sides that the widest window needs.
const PADDED: usize = SAMPLES + 2 * 3 * 5;
/// Partial sums of a row, whatever the width of the machine's registers.
const LANES: usize = 16;

/// Of the two pictures' sum and difference, sample by sample: both, then both squared. With `s = a + b` and `d = a - b`, `s^2 + d^2`
/// is twice `a^2 + b^2` and `s^2 - d^2` four times `ab`, so these are all that SSIM needs; and where the pictures are alike `d` is
/// small, so that little is lost where the squares' means cancel.
type Moments<const N: usize> = [[f32; N]; 4];

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

    fn bands(&self) -> Vec<Range<usize>> {
        let rows = self.centres().1;
        (0..rows).step_by(BAND).map(|first| first..(first + BAND).min(rows)).collect()
    }

    /// The score, from the sums of all bands.
    fn mean(&self, bands: Vec<f64>) -> f64 {
        let (columns, rows) = self.centres();
        bands.iter().sum::<f64>() / (3 * columns * rows) as f64
    }

    /// Sums SSIM over the windows of some rows.
    fn band_sum(&self, rows: Range<usize>) -> f64 {
        dispatch!(self.level, _simd => self.band_sum_simd(rows.clone()))
    }

    /// Plain loops over arrays: the compiler makes the widest instructions of them that the dispatch allows. Products and sums
    /// are fused by name, so that every machine rounds alike.
    #[inline(always)]
    fn band_sum_simd(&self, rows: Range<usize>) -> f64 {
        let side = 2 * Self::RADIUS + 1;
        let mut ring: Vec<Moments<SAMPLES>> = vec![[[0.0; SAMPLES]; 4]; side];
        let mut unfiltered: Moments<PADDED> = [[0.0; PADDED]; 4];
        let mut sum = 0.0;
        for first in (0..self.centres().0).step_by(STRIP) {
            let samples = 3 * STRIP.min(self.centres().0 - first);
            let centre = self.centre(first, samples, rows.clone());
            let mut lanes = [0.0; LANES];
            for row in rows.start..rows.end + side - 1 {
                let y = mirrored(row + self.window.margin, Self::RADIUS, self.height);
                self.moments(first, y, centre, &mut unfiltered);
                let filtered = &mut ring[row % side];
                for (from, to) in unfiltered.iter().zip(filtered) {
                    self.filter_row(from, to);
                }
                if let Some(top) = row.checked_sub(side - 1).filter(|top| *top >= rows.start) {
                    let under: [&Moments<SAMPLES>; 11] = std::array::from_fn(|k| &ring[(top + k) % side]);
                    self.add_scores(under, samples, centre as f32, &mut lanes);
                }
            }
            sum += lanes.iter().sum::<f64>();
        }
        sum
    }

    /// About the mean of the pictures' sum over a strip. Variances do not depend on what sums are taken from; from this they lose least.
    #[inline(always)]
    fn centre(&self, first: usize, samples: usize, rows: Range<usize>) -> i32 {
        let margin = self.window.margin;
        let mut sum = 0_u64;
        for y in rows.start + margin..rows.end + margin {
            let from = 3 * (y * self.width + first + margin);
            for picture in [self.picture, self.truth] {
                sum +=
                    u64::from(picture[from..from + samples].iter().map(|&byte| u16::from(byte)).sum::<u16>());
            }
        }
        (sum / (samples * rows.len()) as u64) as i32
    }

    /// The moments of a strip's pixels of row `y`, and of those to both sides.
    #[inline(always)]
    fn moments(&self, first: usize, y: usize, centre: i32, to: &mut Moments<PADDED>) {
        let pixels = STRIP + 2 * Self::RADIUS;
        let start = first + self.window.margin;
        let row = 3 * y * self.width;
        let mut bytes = [[0_u8; PADDED]; 2];
        for (picture, bytes) in [self.picture, self.truth].into_iter().zip(&mut bytes) {
            let row = &picture[row..row + 3 * self.width];
            if start >= Self::RADIUS && start - Self::RADIUS + pixels <= self.width {
                let from = 3 * (start - Self::RADIUS);
                bytes[..3 * pixels].copy_from_slice(&row[from..from + 3 * pixels]);
            } else {
                for (p, pixel) in bytes.chunks_exact_mut(3).take(pixels).enumerate() {
                    // Beyond the last window of a row anything will do.
                    let last = self.width - 1 + Self::RADIUS;
                    let x = mirrored((start + p).min(last + Self::RADIUS), Self::RADIUS, self.width);
                    pixel.copy_from_slice(&row[3 * x..3 * x + 3]);
                }
            }
        }
        let [a, b] = &bytes;
        let [sums, differences, sums2, differences2] = to;
        for i in 0..PADDED {
            let (a, b) = (i32::from(a[i]), i32::from(b[i]));
            let (s, d) = ((a + b - centre) as f32, (a - b) as f32);
            (sums[i], differences[i], sums2[i], differences2[i]) = (s, d, s * s, d * d);
        }
    }

    /// Filters along a row.
    #[inline(always)]
    fn filter_row(&self, from: &[f32; PADDED], to: &mut [f32; SAMPLES]) {
        let middle = 3 * Self::RADIUS;
        for (i, to) in to.iter_mut().enumerate() {
            let mut sum = self.window.taps[0] * from[i + middle];
            for k in 1..TAPS {
                sum = (from[i + middle - 3 * k] + from[i + middle + 3 * k]).mul_add(self.window.taps[k], sum);
            }
            *to = sum;
        }
    }

    /// Filters along the columns of the rows under a window, and adds up the scores of the first so many samples.
    #[inline(always)]
    fn add_scores(
        &self,
        under: [&Moments<SAMPLES>; 11],
        samples: usize,
        centre: f32,
        lanes: &mut [f64; LANES],
    ) {
        let mut scores = [0.0_f32; SAMPLES];
        for i in 0..SAMPLES {
            let mean = |moment: usize| {
                let mut sum = self.window.taps[0] * under[Self::RADIUS][moment][i];
                for k in 1..TAPS {
                    let pair = under[Self::RADIUS - k][moment][i] + under[Self::RADIUS + k][moment][i];
                    sum = pair.mul_add(self.window.taps[k], sum);
                }
                sum
            };
            let (s, d) = (mean(0), mean(1));
            let scale = self.window.covariance_scale;
            let (variance_s, variance_d) = (scale * (mean(2) - s * s), scale * (mean(3) - d * d));
            let (s2, d2) = ((s + centre) * (s + centre), d * d);
            scores[i] = ((s2 - d2 + TWICE_C1) * (variance_s - variance_d + TWICE_C2))
                / ((s2 + d2 + TWICE_C1) * (variance_s + variance_d + TWICE_C2));
        }
        let scores = &scores[..samples.min(SAMPLES)];
        let chunks = scores.chunks_exact(LANES);
        let rest = chunks.remainder();
        for chunk in chunks {
            for (lane, score) in lanes.iter_mut().zip(chunk) {
                *lane += f64::from(*score);
            }
        }
        for (lane, score) in lanes.iter_mut().zip(rest) {
            *lane += f64::from(*score);
        }
    }
}

/// The index `i - offset`, mirrored into `0..n` about the first and the last element.
fn mirrored(i: usize, offset: usize, n: usize) -> usize {
    let i = i.abs_diff(offset);
    if i < n { i } else { 2 * (n - 1) - i }
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
