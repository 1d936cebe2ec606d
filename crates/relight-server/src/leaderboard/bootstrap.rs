//! Bootstrap intervals of mean scores: the percentile interval of Efron and Tibshirani (An Introduction to the Bootstrap, 1993,
//! chapter 13).
//!
//! Scenes are fixed, for they are the benchmark; images are drawn again, with replacement, within each scene. The draws depend on
//! nothing but the numbers of scenes and images: all entries of a table are measured on the same resamples, and the same scores
//! have the same interval for ever.

use std::collections::BTreeMap;

use relight_field::random::Random;
use relight_scene::Split;

use crate::scoring::ImageScore;

/// Resamples. One below a round number, so that the ends of the interval are order statistics: the 50th from either side.
pub const RESAMPLES: usize = 1999;
/// How likely the interval is to hold the mean of very many such images.
pub const CONFIDENCE: f64 = 0.95;
/// Seed of the draws; the stream is the scene's place in alphabetical order.
const SEED: u64 = 5;

/// How far from the mean over images, then scenes, the two ends of its interval lie: of PSNR and of SSIM, `None` if not all scores
/// are finite. The order of `images` does not matter.
pub(super) fn deviations(images: &[ImageScore], split: Split) -> [Option<(f64, f64)>; 2] {
    let mut scenes = BTreeMap::<&str, Vec<&ImageScore>>::new();
    for image in images.iter().filter(|image| image.split == split) {
        scenes.entry(&image.scene).or_default().push(image);
    }
    // Deviations rather than means: equal scores then have an interval of no width, whatever their last digits.
    let mut sums = vec![[0.0; 2]; RESAMPLES];
    for (stream, images) in scenes.values_mut().enumerate() {
        images.sort_by_key(|image| (image.camera, image.light));
        let n = images.len() as f64;
        let mean = images.iter().fold([0.0; 2], |[p, s], image| [p + image.psnr / n, s + image.ssim / n]);
        let from_mean: Vec<[f64; 2]> =
            images.iter().map(|image| [image.psnr - mean[0], image.ssim - mean[1]]).collect();
        let random = Random::new(SEED, stream as u64);
        let mut index = 0;
        for sum in &mut sums {
            for _ in &from_mean {
                let drawn = from_mean[random.below_at(index, from_mean.len() as u32) as usize];
                *sum = [sum[0] + drawn[0] / n, sum[1] + drawn[1] / n];
                index += 1;
            }
        }
    }
    let scenes = scenes.len().max(1) as f64;
    let tail = ((1.0 - CONFIDENCE) / 2.0 * (RESAMPLES + 1) as f64).round() as usize;
    [0, 1].map(|metric| {
        let mut means: Vec<f64> = sums.iter().map(|sum| sum[metric] / scenes).collect();
        means.sort_by(f64::total_cmp);
        let finite = means.iter().all(|mean| mean.is_finite());
        finite.then(|| (means[tail - 1], means[RESAMPLES - tail]))
    })
}
