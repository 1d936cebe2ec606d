//! What can be had without learning anything: scores that a trained field must beat.

use std::collections::BTreeMap;

use rayon::prelude::*;
use relight_scene::{Image, PixelStore, Pose, Scene, SceneError};

/// The mean of all training images, rounded; `None` where they differ in size or there are none.
pub fn mean_image(scene: &Scene, store: &PixelStore) -> Option<Image> {
    let size = |v: usize| {
        let camera = &scene.cameras[store.camera(v)].intrinsics;
        (camera.width, camera.height)
    };
    let (width, height) = (store.views() > 0).then(|| size(0))?;
    if (1..store.views()).any(|v| size(v) != (width, height)) {
        return None;
    }
    let images: u64 = (0..store.views()).map(|v| store.lights(v).len() as u64).sum();
    let pixels = width as usize * height as usize;
    let mut sums = vec![[0u64; 3]; pixels];
    for v in 0..store.views() {
        sums.par_iter_mut().enumerate().with_min_len(1024).for_each(|(pixel, sum)| {
            for colour in store.pixel(v, pixel) {
                for (s, &c) in sum.iter_mut().zip(colour) {
                    *s += u64::from(c);
                }
            }
        });
    }
    let data = sums.iter().flatten().map(|&sum| mean_of(sum, images)).collect();
    Some(Image { width, height, data })
}

/// As [`mean_image`], of the frames numbered `frames`: each is read and forgotten, so that nothing but the sum is held.
///
/// # Errors
/// [`SceneError`] if one cannot be read.
pub fn mean_frame(scene: &Scene, frames: &[usize]) -> Result<Option<Image>, SceneError> {
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
    let sums = frames
        .par_iter()
        .try_fold(nothing, |mut sums, &frame| {
            let image = scene.read_frame(frame)?;
            sums.iter_mut().zip(&image.data).for_each(|(sum, &byte)| *sum += u64::from(byte));
            Ok::<_, SceneError>(sums)
        })
        .try_reduce(nothing, |mut sums, others| {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += other);
            Ok(sums)
        })?;
    let data = sums.into_iter().map(|sum| mean_of(sum, frames.len() as u64)).collect();
    Ok(Some(Image { width, height, data }))
}

/// A mean, halves rounded up.
fn mean_of(sum: u64, count: u64) -> u8 {
    ((sum + count / 2) / count.max(1)) as u8
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
