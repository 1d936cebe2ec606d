//! A scene: who looked, what shone, and the images.

use std::path::{Path, PathBuf};

use crate::camera::Camera;
use crate::error::{Fault, FaultKind, SceneError, Severity};
use crate::formats;
use crate::frame::Frame;
use crate::image_file::{Image, read_sized};
use crate::light::Light;
use crate::splits::Splits;

/// How a scene lies on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// The official ReNe release: one folder a light.
    Rene,
    /// Blender's and nerfstudio's `transforms.json` with a light position a frame.
    Transforms,
}

/// A one-light-at-a-time capture. Nothing here holds pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub root: PathBuf,
    /// How it lies on disk.
    pub layout: Layout,
    /// All viewpoints, by label.
    pub cameras: Vec<Camera>,
    /// All lights, by label.
    pub lights: Vec<Light>,
    /// All images, by light and camera (ReNe) or in the order of the file (transforms).
    pub frames: Vec<Frame>,
    /// The splits that the folder itself declares, as pairs of `transforms_train.json` and `transforms_test.json` do.
    pub declared: Option<Splits>,
}

impl Scene {
    /// Reads a scene's cameras, lights and list of images; no image is decoded.
    ///
    /// # Errors
    /// The first fault that makes the scene unusable. [`check`](fn@crate::check) lists all.
    pub fn open(path: &Path) -> Result<Scene, SceneError> {
        Ok(Scene::open_with_warnings(path)?.0)
    }

    /// As [`open`](Scene::open), with what may be wrong about it.
    ///
    /// # Errors
    /// As [`open`](Scene::open).
    pub fn open_with_warnings(path: &Path) -> Result<(Scene, Vec<Fault>), SceneError> {
        let (scene, faults) = formats::read(path);
        if let Some(fault) = faults.first_error() {
            return Err(SceneError::Fault(fault.clone()));
        }
        let warnings = faults.0.into_iter().filter(|fault| fault.severity == Severity::Warning).collect();
        scene
            .map(|scene| (scene, warnings))
            .ok_or_else(|| SceneError::fault(FaultKind::Missing, path, "holds no scene", "Check the path."))
    }

    /// The index of the frame that shows a camera's view under a light, both given by index.
    pub fn frame(&self, camera: usize, light: usize) -> Option<usize> {
        self.frames.iter().position(|frame| frame.camera == camera && frame.light == light)
    }

    /// Reads a frame's image.
    ///
    /// # Errors
    /// As [`read_image`](crate::read_image); also if the image is not of its camera's size or there is no such frame.
    pub fn read_frame(&self, frame: usize) -> Result<Image, SceneError> {
        let frames = self.frames.len();
        let frame = self.frames.get(frame).ok_or(SceneError::NoSuchFrame { frame, frames })?;
        let lens = &self.cameras[frame.camera].intrinsics;
        read_sized(&frame.path, Some((lens.width, lens.height)))
    }
}
