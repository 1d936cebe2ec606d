//! Scores of a trained run on every split that can be scored, and pictures of one image.

use std::ops::ControlFlow;
use std::path::Path;

use relight_field::engine::{Engine, RenderSettings};
use relight_metrics::error_map;
use relight_render::{Map, render};
use relight_scene::{Frame, Image, Scene, Split, Splits};
use relight_train::TrainError;
use relight_train::evaluation::{Evaluation, Scores, evaluate};
use relight_train::run::RunConfig;

use crate::error::BenchError;
use crate::pictures::{BRIGHTEST_ERROR, keep};
use crate::record::{Outcome, Shown, SplitRecord};

/// The splits, in the order of the tables.
pub(crate) const SPLITS: [Split; 3] = [Split::Val, Split::Easy, Split::Hard];

/// What came of scoring.
pub struct Scored {
    /// Validation, easy and hard.
    pub splits: Vec<SplitRecord>,
    /// One image, to look at; `None` if no split could be scored.
    pub shown: Option<Shown>,
}

/// The image to be shown.
struct Chosen {
    split: Split,
    frame: usize,
    image: Image,
    scores: Scores,
}

/// Scores `engine` on validation, easy and hard, and keeps pictures of one image of the hardest split that can be scored in
/// `folder`. `mean_image` is that of the training images, a baseline. Test images that are black, as the official release has them, are not scored: their split says why. `seen`
/// is told how many images are done, and of how many. `None` if it breaks off.
///
/// # Errors
/// [`BenchError::Train`] if an image cannot be read, drawn or compared; [`BenchError::Render`] if the visibility cannot be
/// drawn; whatever keeps pictures from being written.
pub fn score(
    scene: &Scene,
    splits: &Splits,
    mean_image: Option<&Image>,
    config: &RunConfig,
    engine: &dyn Engine,
    folder: &Path,
    seen: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Option<Scored>, BenchError> {
    let all: usize = SPLITS.iter().map(|&split| splits.get(split).len()).sum();
    let mut before = 0;
    let mut records = Vec::new();
    let mut chosen = None;
    for split in SPLITS {
        let frames = splits.get(split);
        let (mut picture, settings) = (None, RenderSettings::default());
        let scored =
            evaluate(scene, splits, split, mean_image, &config.model, (engine, &settings), &mut |drawn| {
                if frames.get(frames.len() / 2) == Some(&drawn.frame) {
                    picture = Some((drawn.frame, drawn.image.clone()));
                }
                Ok(seen(before + drawn.done, all))
            });
        let outcome = match scored {
            Ok(Some(evaluation)) => {
                if let Some((frame, image)) = picture {
                    let scores = scores_of(scene, frame, &evaluation);
                    chosen = Some(Chosen { split, frame, image, scores });
                }
                Outcome::Scored(evaluation)
            }
            Ok(None) => return Ok(None),
            Err(TrainError::BlackGroundTruth { count, total, .. }) => {
                let black = if count == total { "all".to_owned() } else { format!("{count} of {total}") };
                Outcome::Skipped(format!(
                    "{black} images are black: the official release withholds them, and its benchmark's server scores them"
                ))
            }
            Err(TrainError::Data(_)) if frames.is_empty() => {
                Outcome::Skipped("the split holds no images".to_owned())
            }
            Err(error) => return Err(error.into()),
        };
        before += frames.len();
        records.push(SplitRecord { split, outcome });
    }
    let shown = chosen.map(|chosen| show(scene, chosen, config, engine, folder)).transpose()?;
    Ok(Some(Scored { splits: records, shown }))
}

fn scores_of(scene: &Scene, frame: usize, evaluation: &Evaluation) -> Scores {
    let frame = &scene.frames[frame];
    let labels = (scene.cameras[frame.camera].label, scene.lights[frame.light].label);
    let found = evaluation.images.iter().find(|image| (image.camera, image.light) == labels);
    found.map_or(evaluation.mean, |image| image.scores)
}

/// Keeps the pictures of an image.
fn show(
    scene: &Scene,
    chosen: Chosen,
    config: &RunConfig,
    engine: &dyn Engine,
    folder: &Path,
) -> Result<Shown, BenchError> {
    let Chosen { split, frame, image, scores } = chosen;
    let truth = scene.read_frame(frame)?;
    let frame = &scene.frames[frame];
    let visibility = if config.field()?.architecture.visibility {
        Some(keep(folder, "visibility", &visibility(scene, frame, engine)?)?)
    } else {
        None
    };
    let data = error_map(&image.data, &truth.data, BRIGHTEST_ERROR)?;
    let errors = Image { width: truth.width, height: truth.height, data };
    Ok(Shown {
        split,
        camera: scene.cameras[frame.camera].label,
        light: scene.lights[frame.light].label,
        scores,
        truth: keep(folder, "truth", &truth)?,
        prediction: keep(folder, "prediction", &image)?,
        error: keep(folder, "error", &errors)?,
        visibility,
    })
}

/// How much of the light arrives, as the field has it.
fn visibility(scene: &Scene, frame: &Frame, engine: &dyn Engine) -> Result<Image, BenchError> {
    let (camera, light) = (&scene.cameras[frame.camera], &scene.lights[frame.light]);
    let (settings, outputs) = (RenderSettings::default(), Map::Visibility.outputs());
    let progress = &mut |_: usize, _: usize| ControlFlow::Continue(());
    let picture =
        render(engine, &camera.intrinsics, &camera.pose, &light.pose, outputs, &settings, progress)?;
    Ok(picture.image(Map::Visibility, None)?)
}
