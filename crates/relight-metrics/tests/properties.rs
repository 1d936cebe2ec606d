//! What scores must obey whatever the pictures, and what they refuse.

use proptest::prelude::*;
use relight_metrics::{MetricError, psnr, ssim, ssim_uniform7};

/// Two RGB8 pictures of one size, neither all black.
fn pictures() -> impl Strategy<Value = (Vec<u8>, Vec<u8>, u32, u32)> {
    (11..24u32, 11..24u32).prop_flat_map(|(width, height)| {
        let bytes = 3 * (width * height) as usize;
        let picture = || {
            proptest::collection::vec(any::<u8>(), bytes)
                .prop_filter("black is refused", |picture| picture.iter().any(|&byte| byte > 0))
        };
        (picture(), picture(), Just(width), Just(height))
    })
}

fn rows_reversed(picture: &[u8], width: u32) -> Vec<u8> {
    picture.chunks(3 * width as usize).rev().flatten().copied().collect()
}

fn columns_reversed(picture: &[u8], width: u32) -> Vec<u8> {
    picture.chunks(3 * width as usize).flat_map(|row| row.chunks(3).rev().flatten()).copied().collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn symmetric_bounded_and_blind_to_flips((a, b, width, height) in pictures()) {
        type Score = fn(&[u8], &[u8], u32, u32) -> Result<f64, MetricError>;
        let scores: [(Score, f64); 3] =
            [(|a, b, _, _| psnr(a, b), f64::INFINITY), (ssim, 1.0), (ssim_uniform7, 1.0)];
        for (score, best) in scores {
            let value = score(&a, &b, width, height).unwrap();
            prop_assert_eq!(value, score(&b, &a, width, height).unwrap());
            prop_assert_eq!(score(&a, &a, width, height).unwrap(), best);
            prop_assert!(value <= best && value > -1.0);
            for flip in [rows_reversed, columns_reversed] {
                let flipped = score(&flip(&a, width), &flip(&b, width), width, height).unwrap();
                prop_assert!((flipped == value) || (flipped - value).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn wrong_sizes_are_refused(bytes in 0..2000usize, width in 0..40u32, height in any::<u32>()) {
        let picture = vec![7; bytes];
        if bytes as u64 != 3 * u64::from(width) * u64::from(height) {
            prop_assert!(ssim(&picture, &picture, width, height).is_err());
        }
    }
}

/// SSIM as its definition reads, in double precision: all weights of each window, one window after another.
fn plain_ssim(a: &[u8], b: &[u8], (w, h): (usize, usize), window: &[f64], scale: f64, margin: usize) -> f64 {
    let radius = window.len() / 2;
    let mirror = |i: usize, n: usize| {
        let i = i.abs_diff(radius);
        if i < n { i } else { 2 * (n - 1) - i }
    };
    let (c1, c2) = ((0.01f64 * 255.0).powi(2), (0.03f64 * 255.0).powi(2));
    let (mut sum, mut windows) = (0.0, 0.0);
    for (y, x, channel) in (margin..h - margin)
        .flat_map(|y| (margin..w - margin).flat_map(move |x| (0..3).map(move |c| (y, x, c))))
    {
        let [mut ma, mut mb, mut aa, mut bb, mut ab] = [0.0; 5];
        for (i, j) in (0..window.len()).flat_map(|i| (0..window.len()).map(move |j| (i, j))) {
            let weight = window[i] * window[j];
            let at = 3 * (mirror(y + i, h) * w + mirror(x + j, w)) + channel;
            let (a, b) = (f64::from(a[at]), f64::from(b[at]));
            ma += weight * a;
            mb += weight * b;
            aa += weight * a * a;
            bb += weight * b * b;
            ab += weight * a * b;
        }
        let (va, vb, cov) = (scale * (aa - ma * ma), scale * (bb - mb * mb), scale * (ab - ma * mb));
        sum += (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
        windows += 1.0;
    }
    sum / windows
}

#[test]
fn ssim_is_its_definition_at_any_size_and_contrast() {
    let gauss: Vec<f64> = (-5..=5).map(|d| (-0.5 * (f64::from(d) / 1.5).powi(2)).exp()).collect();
    let gauss: Vec<f64> = gauss.iter().map(|g| g / gauss.iter().sum::<f64>()).collect();
    // Round the sizes of what is scored together: 4 pixels, 32 new ones, 16 rows.
    for (w, h) in [(11, 11), (13, 132), (31, 16), (32, 17), (49, 15), (97, 33), (150, 121)] {
        let noise = |i: usize, seed: u32| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 16;
        let textures: [&dyn Fn(usize) -> (u8, u8); 5] = [
            &|i| (noise(i, 3) as u8, noise(i, 900_000) as u8),
            &|i| ((i / 40 % 200) as u8, (i / 40 % 200 + noise(i, 1) as usize % 4) as u8),
            &|i| ((250 + noise(i, 1) % 3) as u8, 251),
            &|i| ((noise(i, 1) % 2) as u8, (1 + noise(i, 1) % 3) as u8),
            &|i| (if i / 30 % 2 == 0 { 255 } else { 0 }, if i / 31 % 2 == 0 { 250 } else { 3 }),
        ];
        for (n, texture) in textures.iter().enumerate() {
            let (a, b): (Vec<u8>, Vec<u8>) = (0..3 * w * h).map(texture).unzip();
            let size = (w as u32, h as u32);
            let plain = plain_ssim(&a, &b, (w, h), &gauss, 1.0, 0);
            let fast = ssim(&a, &b, size.0, size.1).unwrap();
            assert!((fast - plain).abs() < 1e-6, "{w}x{h}, {n}: {fast} is not {plain}");
            let plain = plain_ssim(&a, &b, (w, h), &[1.0 / 7.0; 7], 49.0 / 48.0, 3);
            let fast = ssim_uniform7(&a, &b, size.0, size.1).unwrap();
            assert!((fast - plain).abs() < 1e-6, "{w}x{h}, {n}: {fast} is not {plain}, uniform");
        }
    }
}

#[test]
fn psnr_of_a_known_error() {
    // One level in one of three channels: mse 1/3.
    let score = psnr(&[10, 20, 31], &[10, 20, 30]).unwrap();
    assert!((score - 10.0 * (3.0 * 255.0 * 255.0f64).log10()).abs() < 1e-12);
}

#[test]
fn refusals_say_why() {
    let grey = vec![90; 3 * 12 * 10];
    let black = vec![0; grey.len()];
    assert_eq!(ssim(&grey, &grey, 12, 10), Err(MetricError::TooSmall { width: 12, height: 10, window: 11 }));
    assert!(ssim_uniform7(&grey, &grey, 12, 10).is_ok());
    assert_eq!(
        ssim_uniform7(&grey, &grey, 60, 2),
        Err(MetricError::TooSmall { width: 60, height: 2, window: 7 })
    );
    assert_eq!(ssim(&grey, &grey, 12, 11), Err(MetricError::Length { bytes: 360, width: 12, height: 11 }));
    assert_eq!(psnr(&grey[3..], &grey), Err(MetricError::Sizes { picture: 357, truth: 360 }));
    assert_eq!(psnr(&[1, 2, 3, 4], &[1, 2, 3, 4]), Err(MetricError::NotRgb(4)));
    assert_eq!(psnr(&[], &[]), Err(MetricError::NotRgb(0)));
    for trace in [0, 2] {
        assert_eq!(psnr(&grey, &vec![trace; grey.len()]), Err(MetricError::BlackTruth));
    }
    assert!(psnr(&grey, &vec![3; grey.len()]).is_ok());
    assert!(psnr(&black, &grey).is_ok(), "only the truth must not be black");
    assert!(MetricError::BlackTruth.to_string().contains("official ReNe release"));
}
