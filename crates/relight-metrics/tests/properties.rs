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
                prop_assert!((flipped == value) || (flipped - value).abs() < 1e-12);
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
    assert_eq!(psnr(&grey, &black), Err(MetricError::BlackTruth));
    assert!(psnr(&black, &grey).is_ok(), "only the truth must not be black");
    assert!(MetricError::BlackTruth.to_string().contains("official ReNe release"));
}
