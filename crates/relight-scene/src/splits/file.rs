//! `splits.json`: `{"format": "relight-splits", "version": 1, "train": [[camera, light], …], "val": …}` by label. Where
//! labels are the order of frames in a file (`transforms.json`), entries are `[camera, light, "image"]`, and the image tells.

use std::collections::HashMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Split, Splits};
use crate::error::{FaultKind, SceneError};
use crate::files;
use crate::scene::{Layout, Scene};

const FORMAT: &str = "relight-splits";
const VERSION: u64 = 1;
const LONGEST: u64 = 1 << 26;

/// A frame: its camera's and its light's label, and its image where labels do not tell for sure.
#[derive(Serialize, Deserialize)]
struct Entry(usize, usize, #[serde(default, skip_serializing_if = "Option::is_none")] Option<String>);

type Entries = Vec<Entry>;

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
    train: Entries,
    val: Entries,
    easy: Entries,
    hard: Entries,
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
    // Labels of the images of a scene in which these may have changed.
    let named: HashMap<String, (usize, usize)> = match scene.layout {
        Layout::Rene => HashMap::new(),
        Layout::Transforms => labels(scene).enumerate().map(|(i, pair)| (name(scene, i), pair)).collect(),
    };
    let mut splits = Splits::default();
    let parts = [
        (Split::Train, file.train),
        (Split::Val, file.val),
        (Split::Easy, file.easy),
        (Split::Hard, file.hard),
    ];
    for (split, entries) in parts {
        for Entry(camera, light, image) in entries {
            let labels = match &image {
                Some(image) => named.get(image).copied(),
                None => Some((camera, light)),
            };
            let frame = labels.and_then(|labels| frames.remove(&labels)).ok_or_else(|| {
                let what = image.unwrap_or_else(|| format!("camera {camera} under light {light}"));
                let problem = format!("{what} is named twice or is not in the scene");
                fault(FaultKind::Inconsistent, problem)
            })?;
            splits.get_mut(split).push(frame);
        }
        splits.get_mut(split).sort_unstable();
    }
    Ok(Some(splits))
}

/// A frame's image, relative to the scene.
fn name(scene: &Scene, frame: usize) -> String {
    let path = &scene.frames[frame].path;
    path.strip_prefix(&scene.root).unwrap_or(path).display().to_string()
}

/// The bytes of the file.
pub(super) fn bytes(scene: &Scene, splits: &Splits) -> Result<Vec<u8>, SceneError> {
    let labels: Vec<(usize, usize)> = labels(scene).collect();
    let entry = |frame: usize| {
        let (camera, light) = labels[frame];
        Entry(camera, light, (scene.layout == Layout::Transforms).then(|| name(scene, frame)))
    };
    let entries = |split| splits.get(split).iter().map(|&frame| entry(frame)).collect();
    let file = File {
        format: FORMAT.to_owned(),
        version: VERSION,
        train: entries(Split::Train),
        val: entries(Split::Val),
        easy: entries(Split::Easy),
        hard: entries(Split::Hard),
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
