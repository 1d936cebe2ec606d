//! Which frames train, which validate, which score.
//!
//! ReNe's scheme (paper, section 3.4): some cameras and some lights are held out for the test. `easy` is test cameras
//! under the other lights, `hard` test cameras under test lights; training cameras under test lights are never used. A
//! few more cameras are held out for validation, each under a few lights.

mod drawn;
mod file;

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Fault, FaultKind, SceneError, Severity};
use crate::frame::Frame;
use crate::scene::{Layout, Scene};

/// Views and lights of the official release.
const RENE_SIZE: (usize, usize) = (50, 40);
/// With so many of them a folder is taken for an official scene that was not fetched whole.
const RENE_MOST: (usize, usize) = (45, 30);
/// Images looked at to tell whether the test is blacked out.
const WITNESSES: usize = 3;
const RENE_TEST_CAMERAS: [usize; 3] = [4, 8, 15];
const RENE_TEST_LIGHTS: [usize; 3] = [2, 21, 34];
/// Validation cameras with their lights, as published.
const RENE_VAL: [(usize, [usize; 3]); 3] = [(25, [10, 12, 27]), (42, [3, 20, 23]), (47, [26, 30, 39])];

/// A part of a scene's frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// What is learnt from.
    Train,
    /// What training is watched on.
    Val,
    /// Test cameras under training lights.
    Easy,
    /// Test cameras under test lights.
    Hard,
}

impl FromStr for Split {
    type Err = SceneError;

    fn from_str(name: &str) -> Result<Split, SceneError> {
        match name {
            "train" => Ok(Split::Train),
            "val" => Ok(Split::Val),
            "easy" => Ok(Split::Easy),
            "hard" => Ok(Split::Hard),
            other => Err(SceneError::NoSuchSplit(other.to_owned())),
        }
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Split::Train => "train",
            Split::Val => "val",
            Split::Easy => "easy",
            Split::Hard => "hard",
        })
    }
}

/// A scene's splits: indices of frames, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Splits {
    /// What is learnt from.
    pub train: Vec<usize>,
    /// What training is watched on.
    pub val: Vec<usize>,
    /// Test cameras under training lights.
    pub easy: Vec<usize>,
    /// Test cameras under test lights.
    pub hard: Vec<usize>,
}

impl Splits {
    /// The splits of a scene: the published ones for an official scene, whole or not; else those that the folder
    /// declares; else those in `splits.json` beside the scene; else splits drawn from a fixed seed by the same scheme,
    /// which are then written there (if that cannot be done a warning is logged).
    ///
    /// Official is a ReNe folder whose numbers are all below 50 (views) and 40 (lights), and either at least 45 views
    /// and 30 lights are there or the images of the published test views are black, as only the official release has
    /// them: up to three are decoded to see. A capture of one's own of such a size has the published splits too: they
    /// follow the same scheme.
    ///
    /// # Errors
    /// If `splits.json` is of an unknown version or does not fit the scene, or if no image is left to train on.
    pub fn of(scene: &Scene) -> Result<Splits, SceneError> {
        if let Some(splits) = Splits::settled(scene)? {
            splits.check_training(scene)?;
            return Ok(splits);
        }
        let splits = drawn::draw(scene);
        if let Err(error) = file::write(scene, &splits) {
            tracing::warn!("the splits are drawn anew in each run, always the same: {error}");
        }
        Ok(splits)
    }

    /// As [`of`](Splits::of), but nothing is written: for looking at a scene that is not trained on.
    ///
    /// # Errors
    /// As [`of`](Splits::of), but splits without training images are looked at too.
    pub fn peek(scene: &Scene) -> Result<Splits, SceneError> {
        Ok(Splits::settled(scene)?.unwrap_or_else(|| drawn::draw(scene)))
    }

    /// These splits as the bytes of a `splits.json`, for a scene that is to carry them.
    ///
    /// # Errors
    /// If they cannot be encoded.
    pub fn to_json(&self, scene: &Scene) -> Result<Vec<u8>, SceneError> {
        file::bytes(scene, self)
    }

    /// Refuses splits that leave nothing to learn from.
    pub(crate) fn check_training(&self, scene: &Scene) -> Result<(), SceneError> {
        if !self.train.is_empty() {
            return Ok(());
        }
        let (path, mend) = if is_of_file(scene) {
            (file::path(scene), "Remove the file to draw splits anew.")
        } else if scene.declared.is_some() {
            (
                scene.root.clone(),
                "List the training images in transforms_train.json, beside transforms_test.json.",
            )
        } else {
            (scene.root.clone(), "Add images of cameras and under lights that are not held out for the test.")
        };
        Err(SceneError::fault(FaultKind::Split, &path, "leaves no image to train on", mend))
    }

    /// What a `splits.json` leaves out, perhaps because it was not there when the file was made: images of cameras, or under
    /// lights, of which no split knows.
    pub fn left_out(&self, scene: &Scene) -> Option<Fault> {
        if !is_of_file(scene) {
            return None;
        }
        let all = [&self.train, &self.val, &self.easy, &self.hard].into_iter().flatten();
        let (cameras, lights): (HashSet<usize>, HashSet<usize>) =
            all.map(|&frame| (scene.frames[frame].camera, scene.frames[frame].light)).unzip();
        let is_new = |frame: &&Frame| !cameras.contains(&frame.camera) || !lights.contains(&frame.light);
        let left_out = scene.frames.iter().filter(is_new).count();
        (left_out > 0).then(|| Fault {
            severity: Severity::Warning,
            kind: FaultKind::Split,
            path: file::path(scene),
            problem: format!(
                "{left_out} images stand in no split: it knows nothing of their views or lights"
            ),
            mend: "They are not used. Remove the file to draw splits anew.".to_owned(),
        })
    }

    /// The splits that need not be drawn.
    fn settled(scene: &Scene) -> Result<Option<Splits>, SceneError> {
        if is_official(scene) {
            let published = published(scene);
            if let Ok(Some(own)) = file::read(scene)
                && own != published
            {
                tracing::warn!(
                    "{}: is not used: a scene with the views and lights of the official release has the published splits",
                    file::path(scene).display()
                );
            }
            return Ok(Some(published));
        }
        match &scene.declared {
            Some(declared) => Ok(Some(drawn::with_validation(declared.clone()).told_by_light(scene))),
            None => file::read(scene),
        }
    }

    /// These splits, with all test frames under lights that training does not see in `hard`, and the others in `easy`.
    fn told_by_light(mut self, scene: &Scene) -> Splits {
        let light = |frame: &usize| scene.frames[*frame].light;
        let seen: HashSet<usize> = self.train.iter().map(light).collect();
        let tests = std::mem::take(&mut self.easy).into_iter().chain(std::mem::take(&mut self.hard));
        (self.easy, self.hard) = tests.partition(|frame| seen.contains(&light(frame)));
        self.easy.sort_unstable();
        self.hard.sort_unstable();
        self
    }

    /// The frames of one split.
    pub fn get(&self, split: Split) -> &[usize] {
        match split {
            Split::Train => &self.train,
            Split::Val => &self.val,
            Split::Easy => &self.easy,
            Split::Hard => &self.hard,
        }
    }

    pub(crate) fn get_mut(&mut self, split: Split) -> &mut Vec<usize> {
        match split {
            Split::Train => &mut self.train,
            Split::Val => &mut self.val,
            Split::Easy => &mut self.easy,
            Split::Hard => &mut self.hard,
        }
    }
}

/// Whether a scene's splits are those of the `splits.json` beside it.
fn is_of_file(scene: &Scene) -> bool {
    scene.declared.is_none() && !is_official(scene) && file::path(scene).exists()
}

/// Whether a scene is of the official release, perhaps not all of it.
fn is_official(scene: &Scene) -> bool {
    scene.layout == Layout::Rene
        && scene.cameras.iter().all(|camera| camera.label < RENE_SIZE.0)
        && scene.lights.iter().all(|light| light.label < RENE_SIZE.1)
        && (scene.cameras.len() >= RENE_MOST.0 && scene.lights.len() >= RENE_MOST.1 || is_blacked_out(scene))
}

/// Whether the images of the published test views are black, as far as a few of them tell.
fn is_blacked_out(scene: &Scene) -> bool {
    let is_test =
        |frame: &usize| RENE_TEST_CAMERAS.contains(&scene.cameras[scene.frames[*frame].camera].label);
    let tests: Vec<usize> = (0..scene.frames.len()).filter(is_test).collect();
    let mut witnesses = tests.iter().step_by(tests.len().div_ceil(WITNESSES).max(1)).peekable();
    witnesses.peek().is_some()
        && witnesses.all(|&frame| scene.read_frame(frame).is_ok_and(|image| image.is_black()))
}

/// The published splits of what is there; should all validation views be missing others stand in.
fn published(scene: &Scene) -> Splits {
    let camera = |label| scene.cameras.iter().position(|camera| camera.label == label);
    let light = |label| scene.lights.iter().position(|light| light.label == label);
    let val = RENE_VAL
        .iter()
        .filter_map(|&(view, lights)| Some((camera(view)?, lights.into_iter().filter_map(light).collect())));
    drawn::with_validation(by_held_out(
        scene,
        &HeldOut {
            test_cameras: RENE_TEST_CAMERAS.into_iter().filter_map(camera).collect(),
            test_lights: RENE_TEST_LIGHTS.into_iter().filter_map(light).collect(),
            val: val.collect(),
        },
    ))
}

/// What the scheme keeps from training, by index.
struct HeldOut {
    test_cameras: HashSet<usize>,
    test_lights: HashSet<usize>,
    /// Validation cameras, each with its lights.
    val: HashMap<usize, HashSet<usize>>,
}

/// ReNe's scheme.
fn by_held_out(scene: &Scene, held_out: &HeldOut) -> Splits {
    let mut splits = Splits::default();
    for (index, frame) in scene.frames.iter().enumerate() {
        let test_light = held_out.test_lights.contains(&frame.light);
        let split = if held_out.test_cameras.contains(&frame.camera) {
            Some(if test_light { Split::Hard } else { Split::Easy })
        } else if test_light {
            None
        } else if let Some(lights) = held_out.val.get(&frame.camera) {
            lights.contains(&frame.light).then_some(Split::Val)
        } else {
            Some(Split::Train)
        };
        if let Some(split) = split {
            splits.get_mut(split).push(index);
        }
    }
    splits
}
