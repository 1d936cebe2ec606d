//! Path files: keyframes of camera and light as JSON.

use std::path::Path;

use relight_scene::{Pose, read_text};
use serde::Deserialize;

use crate::error::RenderError;
use crate::paths::Shot;
use crate::placement::{checked, pose_of};

/// The format and version that this program reads.
const FORMAT: &str = "relight-path";
const VERSION: u64 = 1;
/// A path file's longest length, bytes.
const LONGEST_FILE: u64 = 1 << 26;

#[derive(Deserialize)]
struct Header {
    /// Files from before it was asked for have a version alone.
    format: Option<String>,
    version: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathFile {
    #[serde(rename = "format")]
    _format: Option<String>,
    #[serde(rename = "version")]
    _version: u64,
    keyframes: Vec<Keyframe>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keyframe {
    camera: Vec<f64>,
    light: Vec<f64>,
}

/// The keyframes of a path file, at least one.
pub(crate) fn read(path: &Path, focus: [f64; 3]) -> Result<Vec<Shot>, RenderError> {
    let text = read_text(path, LONGEST_FILE)?;
    let malformed = |error: serde_json::Error| {
        let form = "{\"format\": \"relight-path\", \"version\": 1, \"keyframes\": [{\"camera\": [16 numbers], \"light\": \
                    [16 numbers or x, y, z]}]}";
        RenderError::file(path, format!("is no camera and light path: {error}. A path looks like {form}"))
    };
    let Header { format, version } = serde_json::from_str(&text).map_err(malformed)?;
    let format = format.as_deref().unwrap_or(FORMAT);
    if (format, version) != (FORMAT, VERSION) {
        let problem = format!(
            "is of format {format:?} version {version}, and only {FORMAT:?} version {VERSION} is known"
        );
        return Err(RenderError::file(path, problem));
    }
    let file: PathFile = serde_json::from_str(&text).map_err(malformed)?;
    if file.keyframes.is_empty() {
        return Err(RenderError::file(path, "has no keyframes: give at least one"));
    }
    let keyframe = |(i, keyframe): (usize, &Keyframe)| {
        let fault = |what: &str, problem: String| {
            RenderError::file(path, format!("{what} of keyframe {i}: {problem}"))
        };
        let camera = pose_of(&keyframe.camera).map_err(|problem| fault("camera", problem))?;
        let light = match *keyframe.light.as_slice() {
            [x, y, z] => checked([x, y, z]).map(|position| Pose::look_at(position, focus)),
            ref numbers => pose_of(numbers),
        };
        Ok(Shot { camera, light: light.map_err(|problem| fault("light", problem))? })
    };
    file.keyframes.iter().enumerate().map(keyframe).collect()
}
