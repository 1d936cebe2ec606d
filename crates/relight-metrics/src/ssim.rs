//! Structural similarity (Wang et al. 2004), in the two forms that published tables use.

use rayon::prelude::*;

use crate::error::{MetricError, check};

/// `(k1 L)^2` and `(k2 L)^2` for the data range `L` = 255.
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// SSIM with an 11x11 Gaussian window of sigma 1.5, mean over pixels and channels: the defaults of torchmetrics'
/// `StructuralSimilarityIndexMeasure` with data range 1. The window is centred on every pixel and the pictures are
/// mirrored at their borders without repeating the outermost pixel, as torchmetrics does since release 1.4.2; earlier
/// releases left out a border of 5 pixels.
///
/// `picture` and `truth` are RGB8 of `width` x `height` pixels.
///
/// # Errors
/// [`MetricError`] if lengths and sizes disagree, a side is below 11 pixels, or the truth is all black.
pub fn ssim(picture: &[u8], truth: &[u8], width: u32, height: u32) -> Result<f64, MetricError> {
    let gauss: Vec<f64> = (-5..=5).map(|d| (-0.5 * (f64::from(d) / 1.5).powi(2)).exp()).collect();
    let sum: f64 = gauss.iter().sum();
    let window = Window {
        taps: gauss.iter().map(|g| g / sum).collect(),
        covariance_scale: 1.0,
        border: Border::Mirrored,
    };
    window.mean_ssim(picture, truth, width, height)
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
    let window = Window { taps: vec![1.0 / 7.0; 7], covariance_scale: 49.0 / 48.0, border: Border::LeftOut };
    window.mean_ssim(picture, truth, width, height)
}

/// What happens where a window centred on a pixel reaches over the border.
#[derive(Clone, Copy, PartialEq)]
enum Border {
    /// Pixels beyond the border are the mirrored ones within; the border pixel is not repeated.
    Mirrored,
    /// There is no window there.
    LeftOut,
}

/// A separable window.
struct Window {
    /// The weights along one axis; an odd number, sum 1.
    taps: Vec<f64>,
    /// Factor from population to the wanted (co)variances.
    covariance_scale: f64,
    border: Border,
}

/// Weighted means of a row: of a, of b, of a^2 + b^2 and of ab. SSIM needs the variances only as a sum.
type Moments = [Vec<f64>; 4];

impl Window {
    fn mean_ssim(&self, picture: &[u8], truth: &[u8], width: u32, height: u32) -> Result<f64, MetricError> {
        check(picture, truth)?;
        let (w, h) = (width as usize, height as usize);
        if w.checked_mul(h).and_then(|pixels| pixels.checked_mul(3)) != Some(truth.len()) {
            return Err(MetricError::Length { bytes: truth.len(), width, height });
        }
        if w.min(h) < self.taps.len() {
            return Err(MetricError::TooSmall { width, height, window: self.taps.len() as u32 });
        }
        let margin = match self.border {
            Border::Mirrored => 0,
            Border::LeftOut => self.radius(),
        };
        let centres = margin..h - margin;
        let scored = centres.len() * (w - 2 * margin) * 3;
        // Rows are summed in order, so that the score does not depend on the number of threads.
        let rows: Vec<f64> = centres
            .into_par_iter()
            .map_init(
                || std::array::from_fn(|_| vec![0.0; 3 * (w + 2 * (self.radius() - margin))]),
                |moments, y| {
                    self.filter_columns(picture, truth, w, h, y, moments);
                    self.row_sum(moments)
                },
            )
            .collect();
        Ok(rows.iter().sum::<f64>() / scored as f64)
    }

    fn radius(&self) -> usize {
        self.taps.len() / 2
    }

    /// Filters along the columns round row `y`, and extends the filtered row over its ends where the border is mirrored.
    fn filter_columns(&self, a: &[u8], b: &[u8], w: usize, h: usize, y: usize, moments: &mut Moments) {
        let radius = self.radius();
        let padding = (moments[0].len() / 3 - w) / 2;
        let [mean_a, mean_b, squares, product] =
            moments.each_mut().map(|m| &mut m[3 * padding..3 * (padding + w)]);
        for m in [&mut *mean_a, mean_b, squares, product] {
            m.fill(0.0);
        }
        for (k, &tap) in self.taps.iter().enumerate() {
            let row = 3 * w * mirrored(y + k, radius, h);
            let pixels = a[row..row + 3 * w].iter().zip(&b[row..row + 3 * w]);
            let sums =
                mean_a.iter_mut().zip(mean_b.iter_mut()).zip(squares.iter_mut().zip(product.iter_mut()));
            for ((&a, &b), ((mean_a, mean_b), (squares, product))) in pixels.zip(sums) {
                let (a, b) = (f64::from(a), f64::from(b));
                *mean_a += tap * a;
                *mean_b += tap * b;
                *squares += tap * (a * a + b * b);
                *product += tap * (a * b);
            }
        }
        for m in moments {
            for i in (0..padding).chain(padding + w..w + 2 * padding) {
                let source = padding + mirrored(i, padding, w);
                m.copy_within(3 * source..3 * source + 3, 3 * i);
            }
        }
    }

    /// Filters along the row and sums SSIM over its windows and channels.
    fn row_sum(&self, moments: &Moments) -> f64 {
        let windows = moments[0].len() - 3 * (self.taps.len() - 1);
        (0..windows)
            .map(|i| {
                let [a, b, squares, product] = moments.each_ref().map(|m| {
                    let row = m[i..].iter().step_by(3);
                    self.taps.iter().zip(row).map(|(tap, value)| tap * value).sum::<f64>()
                });
                let variances = self.covariance_scale * (squares - (a * a + b * b));
                let covariance = self.covariance_scale * (product - a * b);
                ((2.0 * a * b + C1) * (2.0 * covariance + C2)) / ((a * a + b * b + C1) * (variances + C2))
            })
            .sum()
    }
}

/// The index `i - offset`, mirrored into `0..n` about the first and the last element.
fn mirrored(i: usize, offset: usize, n: usize) -> usize {
    let i = i.abs_diff(offset);
    if i < n { i } else { 2 * (n - 1) - i }
}
