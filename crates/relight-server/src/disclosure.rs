//! What of a submission's scores is told, and to whom.
//!
//! Hidden splits are told in the digits of the published tables and no finer, and per scene, never per image: finer answers
//! would let submissions probe the ground truth.

use relight_scene::Split;
use serde::{Deserialize, Serialize};

use crate::scoring::{ImageScore, Mean, Scores};

/// Whether the ground truth of a split is public.
pub fn is_public(split: Split) -> bool {
    split == Split::Val
}

/// Scores as they are told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToldScores {
    /// Means over scenes, of each split.
    pub means: Vec<ToldMean>,
    /// Means of each scene.
    pub scenes: Vec<ToldScene>,
    /// Images of the splits whose ground truth is public.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<ToldImage>,
}

/// The mean over a split.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToldMean {
    /// The split.
    pub split: Split,
    /// Number of images.
    pub images: usize,
    /// PSNR in decibels; null if infinite.
    pub psnr: Option<f64>,
    /// SSIM.
    pub ssim: f64,
}

/// The means of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToldScene {
    /// The scene's name.
    pub scene: String,
    /// Of each split.
    pub means: Vec<ToldMean>,
}

/// The score of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToldImage {
    /// The scene's name.
    pub scene: String,
    /// The camera's label.
    pub camera: usize,
    /// The light's label.
    pub light: usize,
    /// PSNR in decibels; null if infinite.
    pub psnr: Option<f64>,
    /// SSIM.
    pub ssim: f64,
}

/// Digits behind the point: PSNR, SSIM.
#[derive(Clone, Copy)]
struct Digits(i32, i32);

/// Where the ground truth is hidden.
const TABLE: Digits = Digits(2, 3);
/// Where everyone can work the scores out.
const OPEN: Digits = Digits(4, 4);

impl Digits {
    fn of(split: Split) -> Digits {
        if is_public(split) { OPEN } else { TABLE }
    }
}

/// To so many digits behind the point; `None` if not finite.
fn rounded(value: f64, digits: i32) -> Option<f64> {
    let scale = 10f64.powi(digits);
    value.is_finite().then(|| (value * scale).round() / scale)
}

/// A mean as it is told.
pub fn tell_mean(mean: &Mean) -> ToldMean {
    let Digits(psnr, ssim) = Digits::of(mean.split);
    ToldMean {
        split: mean.split,
        images: mean.images,
        psnr: rounded(mean.psnr, psnr),
        ssim: rounded(mean.ssim, ssim).unwrap_or(0.0),
    }
}

fn tell_image(image: &ImageScore) -> ToldImage {
    let Digits(psnr, ssim) = OPEN;
    ToldImage {
        scene: image.scene.clone(),
        camera: image.camera,
        light: image.light,
        psnr: rounded(image.psnr, psnr),
        ssim: rounded(image.ssim, ssim).unwrap_or(0.0),
    }
}

/// Scores as they are told to anyone, their own user too.
pub fn tell(scores: &Scores) -> ToldScores {
    ToldScores {
        means: scores.means.iter().map(tell_mean).collect(),
        scenes: scores
            .scenes
            .iter()
            .map(|scene| ToldScene {
                scene: scene.scene.clone(),
                means: scene.means.iter().map(tell_mean).collect(),
            })
            .collect(),
        images: scores.images.iter().filter(|image| is_public(image.split)).map(tell_image).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_scores_are_told_in_the_tables_digits_and_never_by_image() {
        let mean = |split| Mean { split, images: 3, psnr: 25.123_456_78, ssim: 0.612_345_678 };
        let image = |split| ImageScore {
            scene: "cube".into(),
            split,
            camera: 4,
            light: 2,
            psnr: 25.123_456_78,
            ssim: 0.612_345_678,
        };
        let splits = [Split::Val, Split::Easy, Split::Hard];
        let scores = Scores {
            evaluator: "e".into(),
            means: splits.map(mean).into(),
            scenes: vec![crate::scoring::SceneScores {
                scene: "cube".into(),
                means: splits.map(mean).into(),
            }],
            images: splits.map(image).into(),
        };
        let told = tell(&scores);
        assert_eq!(told.images.len(), 1);
        for means in [&told.means, &told.scenes[0].means] {
            assert_eq!((means[0].psnr, means[0].ssim), (Some(25.1235), 0.6123));
            assert_eq!((means[1].psnr, means[1].ssim), (Some(25.12), 0.612));
            assert_eq!((means[2].psnr, means[2].ssim), (Some(25.12), 0.612));
        }
        // No form of the hidden digits survives in the text that leaves the server.
        let text = serde_json::to_string(&told).unwrap();
        assert!(!text.contains("25.1234") && !text.contains("0.61234"), "{text}");
    }

    #[test]
    fn infinite_scores_are_null() {
        let mean = Mean { split: Split::Easy, images: 1, psnr: f64::INFINITY, ssim: 1.0 };
        assert_eq!(tell_mean(&mean).psnr, None);
    }
}
