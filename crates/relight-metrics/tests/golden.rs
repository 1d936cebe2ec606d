//! Scores against torchmetrics and scikit-image; `tools/golden_metrics.py` made the values.

use std::path::{Path, PathBuf};

use relight_metrics::{psnr, ssim, ssim_uniform7};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

#[test]
fn agrees_with_torchmetrics_and_scikit_image() {
    let scores = std::fs::read_to_string(golden("scores.txt")).unwrap();
    for line in scores.lines() {
        let fields: Vec<&str> = line.split(' ').collect();
        let picture = std::fs::read(golden(&format!("{}.rgb", fields[0]))).unwrap();
        let truth = std::fs::read(golden(&format!("{}.rgb", fields[1]))).unwrap();
        let (width, height): (u32, u32) = (fields[2].parse().unwrap(), fields[3].parse().unwrap());
        let ours = [
            psnr(&picture, &truth).unwrap(),
            ssim(&picture, &truth, width, height).unwrap(),
            ssim_uniform7(&picture, &truth, width, height).unwrap(),
        ];
        // Squared errors are summed in whole numbers, SSIM's windows in single precision.
        for ((ours, field), tolerance) in ours.iter().zip(&fields[4..]).zip([1e-9, 1e-6, 1e-6]) {
            let theirs: f64 = field.parse().unwrap();
            assert!((ours - theirs).abs() < tolerance, "{line}: {ours} is not {theirs}");
        }
    }
    assert_eq!(scores.lines().count(), 18);
}
