//! Scores of a trained field on a split, with the trivial baselines beside.

use std::ops::ControlFlow;

use rayon::prelude::*;
use relight_field::engine::{Engine, RenderSettings};
use relight_metrics::{MetricError, psnr, ssim};
use relight_scene::{Image, Scene, Split, Splits};
use serde::{Deserialize, Deserializer, Serialize};

use crate::TrainError;
use crate::baselines::NearestLight;
use crate::picture::draw;

/// PSNR and SSIM, of an image or as mean over images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Peak signal-to-noise ratio, dB; infinite for equal pictures, which JSON holds as null.
    #[serde(deserialize_with = "infinite_if_null")]
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
}

fn infinite_if_null<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// Scores of one image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageScores {
    /// Label of the camera: its number in the folder.
    pub camera: usize,
    /// Label of the light.
    pub light: usize,
    /// Its scores.
    #[serde(flatten)]
    pub scores: Scores,
}

/// Mean scores of the trivial baselines; `None` where the scene does not allow one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Baselines {
    /// The mean of all training images.
    pub mean_image: Option<Scores>,
    /// The nearest training camera under the nearest training light, copied.
    pub nearest_light: Option<Scores>,
}

/// Scores on a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Name of the scene.
    pub scene: String,
    /// Name of the model.
    pub model: String,
    /// Name of the split.
    pub split: String,
    /// Means over the images.
    #[serde(flatten)]
    pub mean: Scores,
    /// Each image.
    pub images: Vec<ImageScores>,
    /// The baselines on the same images.
    pub baselines: Baselines,
}

/// An image that was just drawn and scored.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    /// Index of its frame in the scene.
    pub frame: usize,
    /// The rendering.
    pub image: &'a Image,
    /// Images done, this one included.
    pub done: usize,
    /// Images in the split.
    pub all: usize,
}

/// Draws each image of `split` by `settings` and scores it; each is shown to `seen`. Beside it stands `mean_image`, that of the training
/// images, as a baseline. `None` if `seen` breaks off. The split's photographs are held in memory.
///
/// # Errors
/// [`TrainError::Data`] if the split is empty; [`TrainError::BlackGroundTruth`] if an image is all black (nothing is
/// scored then); [`TrainError::Metric`] if images are too small to score; whatever `seen` returns.
pub fn evaluate(
    scene: &Scene,
    splits: &Splits,
    split: Split,
    mean_image: Option<&Image>,
    model: &str,
    (engine, settings): (&dyn Engine, &RenderSettings),
    seen: &mut dyn FnMut(Drawn<'_>) -> Result<ControlFlow<()>, TrainError>,
) -> Result<Option<Evaluation>, TrainError> {
    let frames = splits.get(split);
    if frames.is_empty() {
        return Err(TrainError::Data(format!("{}: the split {split} holds no images", scene.root.display())));
    }
    // Before anything is drawn.
    let truths = read_truth(scene, frames, |image| image)?;
    let nearest = NearestLight::new(scene, &splits.train);
    let mut images = Vec::with_capacity(frames.len());
    let (mut mean_scores, mut nearest_scores) = (Vec::new(), Vec::new());
    for (done, (&index, truth)) in frames.iter().zip(truths).enumerate() {
        let frame = &scene.frames[index];
        let (camera, light) = (&scene.cameras[frame.camera], &scene.lights[frame.light]);
        let drawn = draw((engine, settings), &camera.intrinsics, &camera.pose, &light.pose)?;
        let compare = |image| compare(&truth, image).map_err(TrainError::metric(&frame.path));
        let scores = compare(&drawn)?;
        images.push(ImageScores { camera: camera.label, light: light.label, scores });
        if let Some(image) = mean_image.filter(|i| same_size(i, &truth)) {
            mean_scores.push(compare(image)?);
        }
        if let Some(image) = nearest.image(index)?.filter(|i| same_size(i, &truth)) {
            nearest_scores.push(compare(&image)?);
        }
        let drawn = Drawn { frame: index, image: &drawn, done: done + 1, all: frames.len() };
        if seen(drawn)?.is_break() {
            return Ok(None);
        }
    }
    let all = |scores: &[Scores]| (scores.len() == frames.len()).then(|| mean(scores));
    let own: Vec<Scores> = images.iter().map(|i| i.scores).collect();
    Ok(Some(Evaluation {
        scene: scene.name.clone(),
        model: model.to_owned(),
        split: split.to_string(),
        mean: mean(&own),
        images,
        baselines: Baselines { mean_image: all(&mean_scores), nearest_light: all(&nearest_scores) },
    }))
}

/// Reads the ground truth of all `frames`, refuses it if any is all black, and returns what `keep` keeps of each image.
pub(crate) fn read_truth<T: Send>(
    scene: &Scene,
    frames: &[usize],
    keep: impl Fn(Image) -> T + Sync,
) -> Result<Vec<T>, TrainError> {
    let read = |&frame: &usize| {
        let image = scene.read_frame(frame)?;
        let is_black = image.is_black();
        Ok((keep(image), is_black))
    };
    let read: Vec<(T, bool)> = frames.par_iter().map(read).collect::<Result<_, TrainError>>()?;
    match read.iter().position(|(_, black)| *black) {
        None => Ok(read.into_iter().map(|(kept, _)| kept).collect()),
        Some(first) => Err(TrainError::BlackGroundTruth {
            path: scene.frames[frames[first]].path.clone(),
            count: read.iter().filter(|(_, black)| *black).count(),
            total: frames.len(),
        }),
    }
}

fn same_size(a: &Image, b: &Image) -> bool {
    (a.width, a.height) == (b.width, b.height)
}

fn compare(truth: &Image, image: &Image) -> Result<Scores, MetricError> {
    Ok(Scores {
        psnr: psnr(&image.data, &truth.data)?,
        ssim: ssim(&image.data, &truth.data, truth.width, truth.height)?,
    })
}

fn mean(scores: &[Scores]) -> Scores {
    let n = scores.len() as f64;
    Scores {
        psnr: scores.iter().map(|s| s.psnr).sum::<f64>() / n,
        ssim: scores.iter().map(|s| s.ssim).sum::<f64>() / n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evaluations_come_back_from_json_perfect_ones_too() {
        let scores = Scores { psnr: f64::INFINITY, ssim: 1.0 };
        let evaluation = Evaluation {
            scene: "cube".into(),
            model: "v5".into(),
            split: "easy".into(),
            mean: Scores { psnr: 25.123456789012345, ssim: 0.5 },
            images: vec![ImageScores { camera: 4, light: 0, scores }],
            baselines: Baselines { mean_image: Some(scores), nearest_light: None },
        };
        let json = serde_json::to_string(&evaluation).unwrap();
        assert_eq!(serde_json::from_str::<Evaluation>(&json).unwrap(), evaluation, "{json}");
    }
}
