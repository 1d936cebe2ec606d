//! What can be had without learning anything: scores that a trained field must beat.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use relight_scene::{Image, Pose, Scene, SceneError};

/// The mean of the images of the frames numbered `frames`, rounded; `None` where they differ in size or there are none.
/// Each is read and forgotten, so that nothing but sums is held. `progress` is told how many are done, and of how many.
///
/// # Errors
/// [`SceneError`] if one cannot be read; [`SceneError::Cancelled`] if `progress` breaks off.
pub fn mean_image(
    scene: &Scene,
    frames: &[usize],
    progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
) -> Result<Option<Image>, SceneError> {
    let Some(&first) = frames.first() else { return Ok(None) };
    let size = |frame: usize| {
        let camera = &scene.cameras[scene.frames[frame].camera].intrinsics;
        (camera.width, camera.height)
    };
    let (width, height) = size(first);
    if frames.iter().any(|&frame| size(frame) != (width, height)) {
        return Ok(None);
    }
    let nothing = || vec![0u64; 3 * width as usize * height as usize];
    let done = AtomicUsize::new(0);
    let sums = frames
        .par_iter()
        .try_fold(nothing, |mut sums, &frame| {
            let image = scene.read_frame(frame)?;
            if progress(done.fetch_add(1, Ordering::Relaxed) + 1, frames.len()).is_break() {
                return Err(SceneError::Cancelled);
            }
            sums.iter_mut().zip(&image.data).for_each(|(sum, &byte)| *sum += u64::from(byte));
            Ok::<_, SceneError>(sums)
        })
        .try_reduce(nothing, |mut sums, others| {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += other);
            Ok(sums)
        })?;
    let count = frames.len() as u64;
    let data = sums.into_iter().map(|sum| ((sum + count / 2) / count) as u8).collect();
    Ok(Some(Image { width, height, data }))
}

/// The training images by camera, to copy from.
pub struct NearestLight<'a> {
    scene: &'a Scene,
    /// Training frames of each training camera.
    frames: BTreeMap<usize, Vec<usize>>,
}

impl<'a> NearestLight<'a> {
    /// Copies from the frames numbered `train`.
    pub fn new(scene: &'a Scene, train: &[usize]) -> Self {
        let mut frames = BTreeMap::<usize, Vec<usize>>::new();
        for &frame in train {
            frames.entry(scene.frames[frame].camera).or_default().push(frame);
        }
        Self { scene, frames }
    }

    /// The training frame that stands in for `frame`: of the nearest training camera, the image under the nearest of
    /// its training lights. `None` if there are no training frames.
    pub fn stand_in(&self, frame: usize) -> Option<usize> {
        let target = &self.scene.frames[frame];
        let (cameras, lights) = (&self.scene.cameras, &self.scene.lights);
        let to_camera = |camera: usize| distance(&cameras[camera].pose, &cameras[target.camera].pose);
        let to_light =
            |frame: usize| distance(&lights[self.scene.frames[frame].light].pose, &lights[target.light].pose);
        let (_, frames) = self.frames.iter().min_by(|a, b| to_camera(*a.0).total_cmp(&to_camera(*b.0)))?;
        frames.iter().copied().min_by(|&a, &b| to_light(a).total_cmp(&to_light(b)))
    }

    /// The image of [`Self::stand_in`].
    ///
    /// # Errors
    /// [`SceneError`] if it cannot be read.
    pub fn image(&self, frame: usize) -> Result<Option<Image>, SceneError> {
        self.stand_in(frame).map(|f| self.scene.read_frame(f)).transpose()
    }
}

/// Squared distance between positions, square metres.
fn distance(a: &Pose, b: &Pose) -> f64 {
    a.position().iter().zip(b.position()).map(|(x, y)| (x - y) * (x - y)).sum()
}
