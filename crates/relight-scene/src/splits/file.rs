//! `splits.json`: `{"format": "relight-splits", "version": 1, "train": [[camera, light], …], "val": …}` by label.

use std::collections::HashMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Split, Splits};
use crate::error::{FaultKind, SceneError};
use crate::files;
use crate::scene::Scene;

const FORMAT: &str = "relight-splits";
const VERSION: u64 = 1;
const LONGEST: u64 = 1 << 26;

/// Pairs of a camera's and a light's label.
type Pairs = Vec<(usize, usize)>;

/// What every version states; other keys are skipped.
#[derive(Deserialize)]
struct Version {
    format: String,
    version: u64,
}

#[derive(Serialize, Deserialize)]
struct File {
    format: String,
    version: u64,
    train: Pairs,
    val: Pairs,
    easy: Pairs,
    hard: Pairs,
}

pub(super) fn path(scene: &Scene) -> PathBuf {
    scene.root.join("splits.json")
}

/// Reads the file, if there is one.
pub(super) fn read(scene: &Scene) -> Result<Option<Splits>, SceneError> {
    let path = path(scene);
    if !path.exists() {
        return Ok(None);
    }
    let text = files::read_text(&path, LONGEST)?;
    let fault = |kind, problem: String| {
        SceneError::fault(kind, &path, problem, "Remove the file to draw splits anew.")
    };
    let malformed =
        |error: serde_json::Error| fault(FaultKind::Malformed, format!("is not a splits file: {error}"));
    let Version { format, version } = serde_json::from_str(&text).map_err(malformed)?;
    if format != FORMAT || version != VERSION {
        let problem = format!(
            "is of format {format:?} version {version}, and only {FORMAT:?} version {VERSION} is known"
        );
        return Err(SceneError::fault(
            FaultKind::Version,
            &path,
            problem,
            "Use the program that wrote it, or remove it.",
        ));
    }
    let file: File = serde_json::from_str(&text).map_err(malformed)?;
    let mut frames: HashMap<(usize, usize), usize> =
        labels(scene).enumerate().map(|(i, pair)| (pair, i)).collect();
    let mut splits = Splits::default();
    let parts = [
        (Split::Train, file.train),
        (Split::Val, file.val),
        (Split::Easy, file.easy),
        (Split::Hard, file.hard),
    ];
    for (split, pairs) in parts {
        for (camera, light) in pairs {
            let frame = frames.remove(&(camera, light)).ok_or_else(|| {
                let problem =
                    format!("camera {camera} under light {light} is named twice or is not in the scene");
                fault(FaultKind::Inconsistent, problem)
            })?;
            splits.get_mut(split).push(frame);
        }
        splits.get_mut(split).sort_unstable();
    }
    Ok(Some(splits))
}

/// The bytes of the file.
pub(super) fn bytes(scene: &Scene, splits: &Splits) -> Result<Vec<u8>, SceneError> {
    let labels: Vec<(usize, usize)> = labels(scene).collect();
    let pairs = |split| splits.get(split).iter().map(|&frame| labels[frame]).collect();
    let file = File {
        format: FORMAT.to_owned(),
        version: VERSION,
        train: pairs(Split::Train),
        val: pairs(Split::Val),
        easy: pairs(Split::Easy),
        hard: pairs(Split::Hard),
    };
    serde_json::to_vec(&file).map_err(|error| SceneError::io(&path(scene), "be written", &error.into()))
}

/// Writes the file.
pub(super) fn write(scene: &Scene, splits: &Splits) -> Result<(), SceneError> {
    files::write(&path(scene), &bytes(scene, splits)?)
}

/// Each frame's camera and light label.
fn labels(scene: &Scene) -> impl Iterator<Item = (usize, usize)> {
    scene.frames.iter().map(|frame| (scene.cameras[frame.camera].label, scene.lights[frame.light].label))
}
