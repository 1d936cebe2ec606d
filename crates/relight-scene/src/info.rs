//! What a scene holds, in short.

use std::path::PathBuf;

use rayon::prelude::*;
use serde::Serialize;

use crate::bounds::{Bounds, scene_bounds};
use crate::error::SceneError;
use crate::scene::{Layout, Scene};
use crate::splits::Splits;

/// Frames in each split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SplitCounts {
    /// Training images.
    pub train: usize,
    /// Validation images.
    pub val: usize,
    /// Test images under training lights.
    pub easy: usize,
    /// Test images under test lights.
    pub hard: usize,
}

/// A summary of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneInfo {
    /// The folder's name.
    pub name: String,
    /// The folder.
    pub path: PathBuf,
    /// How it lies on disk.
    pub layout: Layout,
    /// Viewpoints.
    pub views: usize,
    /// Lights.
    pub lights: usize,
    /// Images.
    pub images: usize,
    /// Width and height of the first camera's images, pixels.
    pub size: [u32; 2],
    /// Whether all cameras have that size.
    pub same_size: bool,
    /// Whether any lens distorts.
    pub distorted: bool,
    /// The box found from cameras and lights, metres. Surfaces that stereo finds in it may make a training's box tighter.
    pub bounds: Bounds,
    /// Images in each split.
    pub splits: SplitCounts,
    /// Test images that are black, as the official release has them: they cannot be scored.
    pub black_test_images: usize,
    /// Bytes of the training pixels.
    pub training_bytes: u64,
}

impl SceneInfo {
    /// Sums a scene up. Its test images are decoded to see which are black; nothing is written.
    ///
    /// # Errors
    /// If the splits cannot be had or a test image cannot be decoded.
    pub fn of(scene: &Scene) -> Result<SceneInfo, SceneError> {
        let splits = Splits::peek(scene)?;
        let tests: Vec<usize> = splits.easy.iter().chain(&splits.hard).copied().collect();
        let black: Vec<bool> = tests
            .into_par_iter()
            .map(|frame| Ok(scene.read_frame(frame)?.is_black()))
            .collect::<Result<_, SceneError>>()?;
        let sizes: Vec<[u32; 2]> =
            scene.cameras.iter().map(|camera| [camera.intrinsics.width, camera.intrinsics.height]).collect();
        let size = sizes.first().copied().unwrap_or_default();
        let bytes = |&frame: &usize| {
            sizes[scene.frames[frame].camera].iter().map(|&side| u64::from(side)).product::<u64>()
        };
        Ok(SceneInfo {
            name: scene.name.clone(),
            path: scene.root.clone(),
            layout: scene.layout,
            views: scene.cameras.len(),
            lights: scene.lights.len(),
            images: scene.frames.len(),
            size,
            same_size: sizes.iter().all(|&other| other == size),
            distorted: scene
                .cameras
                .iter()
                .any(|camera| camera.intrinsics.distortion.iter().any(|&k| k != 0.0)),
            bounds: scene_bounds(scene),
            splits: SplitCounts {
                train: splits.train.len(),
                val: splits.val.len(),
                easy: splits.easy.len(),
                hard: splits.hard.len(),
            },
            black_test_images: black.into_iter().filter(|&is_black| is_black).count(),
            training_bytes: 3 * splits.train.iter().map(bytes).sum::<u64>(),
        })
    }
}
