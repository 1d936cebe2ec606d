//! What the paper reports: Toschi et al., "Relight My NeRF", CVPR 2023; the ablation on the validation split, the benchmark
//! on easy and hard.

use relight_scene::Split;
use relight_train::evaluation::Scores;

/// Where the figures are from.
pub(crate) const SOURCE: &str = "Toschi et al., Relight My NeRF, CVPR 2023";
/// The size at which the paper scores, pixels.
pub(crate) const SIZE: [u32; 2] = [1440, 1080];
/// Views and lights of the official scenes.
pub(crate) const CAPTURED: [usize; 2] = [50, 40];

/// PSNR and SSIM of V1 to V5 on the validation split.
const ABLATION: [(&str, [[f64; 2]; 5]); 4] = [
    ("cube", [[24.37, 0.52], [24.73, 0.54], [25.38, 0.56], [25.41, 0.57], [26.11, 0.61]]),
    ("savannah", [[22.53, 0.44], [23.70, 0.52], [24.39, 0.55], [24.79, 0.58], [25.23, 0.61]]),
    ("reflective", [[23.57, 0.51], [23.68, 0.52], [24.65, 0.58], [24.24, 0.56], [25.00, 0.59]]),
    ("flipflop", [[24.12, 0.51], [24.42, 0.56], [25.06, 0.57], [25.27, 0.58], [25.46, 0.60]]),
];

/// PSNR and SSIM: V5 on easy and hard, V0 (Instant-NGP) on easy and hard.
const BENCHMARK: [(&str, [[f64; 2]; 4]); 20] = [
    ("apple", [[26.44, 0.62], [26.25, 0.62], [20.89, 0.45], [20.95, 0.45]]),
    ("cheetah", [[25.66, 0.61], [24.64, 0.60], [19.37, 0.44], [19.60, 0.44]]),
    ("cube", [[24.90, 0.54], [23.98, 0.53], [20.14, 0.42], [20.31, 0.42]]),
    ("dinosaurs", [[25.75, 0.65], [24.98, 0.64], [19.58, 0.42], [19.66, 0.41]]),
    ("flipflop", [[25.85, 0.61], [25.42, 0.61], [20.38, 0.45], [20.36, 0.45]]),
    ("fruits", [[25.93, 0.62], [25.72, 0.62], [20.16, 0.45], [20.21, 0.44]]),
    ("garden", [[25.74, 0.66], [25.08, 0.66], [19.76, 0.45], [19.70, 0.45]]),
    ("helicopters", [[25.12, 0.61], [24.73, 0.61], [19.34, 0.37], [19.37, 0.37]]),
    ("kittens", [[25.90, 0.64], [24.96, 0.63], [18.52, 0.37], [18.65, 0.37]]),
    ("lego", [[26.07, 0.61], [25.77, 0.61], [20.75, 0.46], [20.76, 0.46]]),
    ("lunch", [[25.84, 0.60], [24.71, 0.59], [19.32, 0.46], [19.38, 0.45]]),
    ("plant", [[26.55, 0.67], [25.93, 0.67], [20.62, 0.44], [20.66, 0.44]]),
    ("reflective", [[25.79, 0.61], [25.28, 0.61], [20.09, 0.43], [20.11, 0.42]]),
    ("robotoy", [[26.24, 0.65], [25.55, 0.65], [20.77, 0.50], [20.78, 0.50]]),
    ("savannah", [[25.15, 0.62], [24.31, 0.61], [19.08, 0.40], [19.18, 0.40]]),
    ("shark", [[25.59, 0.57], [25.32, 0.56], [20.54, 0.42], [20.53, 0.41]]),
    ("stegosaurus", [[25.87, 0.63], [25.65, 0.63], [20.84, 0.43], [20.91, 0.42]]),
    ("tapes", [[25.84, 0.58], [25.41, 0.57], [19.34, 0.41], [19.55, 0.41]]),
    ("trucks", [[25.80, 0.67], [25.16, 0.66], [19.81, 0.44], [19.87, 0.44]]),
    ("wooden", [[25.69, 0.61], [25.24, 0.60], [20.19, 0.48], [20.22, 0.48]]),
];

/// Whether a scene is called as one of the official release.
pub(crate) fn is_name(scene: &str) -> bool {
    BENCHMARK.iter().any(|(name, _)| *name == scene)
}

/// What the paper reports of a model on a split of an official scene.
pub(crate) fn scores(scene: &str, model: &str, split: Split) -> Option<Scores> {
    let [psnr, ssim] = match split {
        Split::Val => {
            let (_, models) = ABLATION.iter().find(|(name, _)| *name == scene)?;
            let model: usize = model.strip_prefix('v')?.parse().ok()?;
            *models.get(model.checked_sub(1)?)?
        }
        Split::Easy | Split::Hard => {
            let (_, columns) = BENCHMARK.iter().find(|(name, _)| *name == scene)?;
            let first = match model {
                "v5" => 0,
                "v0" => 2,
                _ => return None,
            };
            columns[first + usize::from(split == Split::Hard)]
        }
        Split::Train => return None,
    };
    Some(Scores { psnr, ssim })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scenes_average_to_what_the_paper_says() {
        // Its last row: V5 and Instant-NGP, easy and hard.
        let averages = [[25.79, 0.62], [25.20, 0.61], [19.97, 0.43], [20.04, 0.43]];
        for (column, average) in averages.iter().enumerate() {
            for (metric, (&average, digit)) in average.iter().zip([0.01, 0.01]).enumerate() {
                let mean = BENCHMARK.iter().map(|(_, columns)| columns[column][metric]).sum::<f64>() / 20.0;
                assert!((mean - average).abs() < digit, "column {column}: {mean} against {average}");
            }
        }
    }

    #[test]
    fn figures_are_found_by_scene_model_and_split() {
        let psnr = |scene, model, split| scores(scene, model, split).map(|s| s.psnr);
        assert_eq!(psnr("cube", "v1", Split::Val), Some(24.37));
        assert_eq!(psnr("flipflop", "v5", Split::Val), Some(25.46));
        assert_eq!(psnr("wooden", "v5", Split::Hard), Some(25.24));
        assert_eq!(psnr("wooden", "v0", Split::Easy), Some(20.19));
        for (scene, model, split) in [
            ("cube", "v0", Split::Val),
            ("cube", "v6", Split::Val),
            ("apple", "v5", Split::Val),
            ("apple", "v4", Split::Easy),
            ("Apple", "v5", Split::Easy),
            ("empty", "v5", Split::Easy),
            ("cube", "v5", Split::Train),
        ] {
            assert_eq!(psnr(scene, model, split), None, "{scene} {model} {split}");
        }
    }
}
