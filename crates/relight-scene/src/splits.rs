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

use crate::error::SceneError;
use crate::scene::{Layout, Scene};

/// Views and lights of the official release.
const RENE_SIZE: (usize, usize) = (50, 40);
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
    /// The splits of a scene: the published ones for a folder of the official size (50 views, 40 lights); those that the
    /// folder declares; else those in `splits.json` beside the scene; else splits drawn from a fixed seed by the same
    /// scheme, which are then written there (if that cannot be done a warning is logged).
    ///
    /// # Errors
    /// If `splits.json` is of an unknown version or does not fit the scene.
    pub fn of(scene: &Scene) -> Result<Splits, SceneError> {
        if let Some(splits) = Splits::settled(scene)? {
            return Ok(splits);
        }
        let splits = drawn::draw(scene);
        if let Err(error) = file::write(scene, &splits) {
            tracing::warn!("the splits are drawn anew in each run, always the same: {error}");
        }
        Ok(splits)
    }

    /// As [`of`](Splits::of), but nothing is written.
    pub(crate) fn peek(scene: &Scene) -> Result<Splits, SceneError> {
        Ok(Splits::settled(scene)?.unwrap_or_else(|| drawn::draw(scene)))
    }

    /// The splits that need not be drawn.
    fn settled(scene: &Scene) -> Result<Option<Splits>, SceneError> {
        if is_rene_sized(scene) {
            return Ok(Some(published(scene)));
        }
        match &scene.declared {
            Some(declared) => Ok(Some(drawn::with_validation(declared.clone()))),
            None => file::read(scene),
        }
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

fn is_rene_sized(scene: &Scene) -> bool {
    scene.layout == Layout::Rene
        && scene.cameras.iter().map(|camera| camera.label).eq(0..RENE_SIZE.0)
        && scene.lights.iter().map(|light| light.label).eq(0..RENE_SIZE.1)
}

fn published(scene: &Scene) -> Splits {
    by_held_out(
        scene,
        &HeldOut {
            test_cameras: RENE_TEST_CAMERAS.into(),
            test_lights: RENE_TEST_LIGHTS.into(),
            val: RENE_VAL.map(|(camera, lights)| (camera, lights.into())).into(),
        },
    )
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
