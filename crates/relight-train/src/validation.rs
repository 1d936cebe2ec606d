//! Scores on the validation split while a field is trained.
//!
//! Large splits are compared at every k-th pixel of both axes: the same pixels each time, so scores of one run can
//! be compared with each other. They are not the scores that `evaluation` reports.

use relight_field::engine::{Engine, RenderSettings};
use relight_metrics::{MetricError, psnr, ssim};
use relight_scene::{Image, Intrinsics, Scene};

use crate::TrainError;
use crate::evaluation::read_truth;
use crate::picture::draw;

/// The images to compare with.
pub struct Validation<'a> {
    scene: &'a Scene,
    /// Frame, decimated intrinsics of its camera and decimated ground truth.
    images: Vec<(usize, Intrinsics, Image)>,
}

/// The outcome of a validation.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Mean over the images, dB.
    pub psnr: f64,
    /// Mean over the images; `None` where they are too small for its window.
    pub ssim: Option<f64>,
    /// Ground truth and rendering of the first image, side by side.
    pub preview: Image,
}

impl<'a> Validation<'a> {
    /// Reads the images numbered `frames`, at every k-th pixel where that takes to stay within `pixels` in all.
    ///
    /// # Errors
    /// [`TrainError::Scene`] if an image cannot be read; [`TrainError::BlackGroundTruth`] if one is all black.
    pub fn load(scene: &'a Scene, frames: &[usize], pixels: usize) -> Result<Self, TrainError> {
        let camera = |frame: usize| &scene.cameras[scene.frames[frame].camera].intrinsics;
        let all: usize = frames.iter().map(|&f| camera(f).width as usize * camera(f).height as usize).sum();
        let stride = (1..=64).find(|k| all.div_ceil(k * k) <= pixels).unwrap_or(64);
        let truth = read_truth(scene, frames, |image| decimated(&image, stride))?;
        let images = frames.iter().zip(truth);
        let images = images.map(|(&frame, image)| (frame, decimated_camera(camera(frame), stride), image));
        Ok(Self { scene, images: images.collect() })
    }

    /// Whether there is nothing to compare with.
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }

    /// Draws the images and scores them; `None` if the split is empty.
    ///
    /// # Errors
    /// [`TrainError::Render`] if a picture cannot be drawn.
    pub fn score(&self, engine: &dyn Engine) -> Result<Option<Score>, TrainError> {
        let mut total = (0.0, Some(0.0));
        let mut preview = None;
        for (frame, intrinsics, truth) in &self.images {
            let frame = &self.scene.frames[*frame];
            let pose = &self.scene.cameras[frame.camera].pose;
            let light = &self.scene.lights[frame.light].pose;
            let drawn = draw((engine, &RenderSettings::default()), intrinsics, pose, light)?;
            let failed = TrainError::metric(&frame.path);
            total.0 += psnr(&drawn.data, &truth.data).map_err(&failed)?;
            let similarity = match ssim(&drawn.data, &truth.data, truth.width, truth.height) {
                Ok(value) => Some(value),
                Err(MetricError::TooSmall { .. }) => None,
                Err(e) => return Err(failed(e)),
            };
            total.1 = total.1.zip(similarity).map(|(a, b)| a + b);
            preview.get_or_insert_with(|| side_by_side(truth, &drawn));
        }
        let n = self.images.len() as f64;
        Ok(preview.map(|preview| Score { psnr: total.0 / n, ssim: total.1.map(|s| s / n), preview }))
    }
}

/// The camera whose pixels are every `stride`-th of `camera`'s.
fn decimated_camera(camera: &Intrinsics, stride: usize) -> Intrinsics {
    let k = stride as f64;
    Intrinsics {
        width: camera.width.div_ceil(stride as u32),
        height: camera.height.div_ceil(stride as u32),
        fx: camera.fx / k,
        fy: camera.fy / k,
        cx: camera.cx / k,
        cy: camera.cy / k,
        distortion: camera.distortion.clone(),
    }
}

/// Every `stride`-th pixel of both axes.
fn decimated(image: &Image, stride: usize) -> Image {
    let (width, height) = (image.width as usize, image.height as usize);
    let mut data = Vec::with_capacity(3 * width.div_ceil(stride) * height.div_ceil(stride));
    for v in (0..height).step_by(stride) {
        for u in (0..width).step_by(stride) {
            let at = 3 * (v * width + u);
            data.extend_from_slice(&image.data[at..at + 3]);
        }
    }
    Image { width: width.div_ceil(stride) as u32, height: height.div_ceil(stride) as u32, data }
}

/// Two pictures of one size, left and right.
fn side_by_side(left: &Image, right: &Image) -> Image {
    let row = 3 * left.width as usize;
    let rows = left.data.chunks(row).zip(right.data.chunks(row));
    let data = rows.flat_map(|(l, r)| l.iter().chain(r).copied()).collect();
    Image { width: 2 * left.width, height: left.height, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimated_cameras_see_the_pixels_that_are_kept() {
        let camera = Intrinsics {
            width: 10,
            height: 7,
            fx: 12.0,
            fy: 11.0,
            cx: 4.0,
            cy: 3.5,
            distortion: vec![0.05, -0.01, 0.001, 0.002, 0.0],
        };
        let small = decimated_camera(&camera, 3);
        assert_eq!((small.width, small.height), (4, 3));
        for (a, b) in small.unproject(2.0, 1.0).iter().zip(camera.unproject(6.0, 3.0)) {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn decimation_and_pairing_keep_rows_apart() {
        let image = Image { width: 3, height: 2, data: (0..18).collect() };
        let small = decimated(&image, 2);
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.data, [0, 1, 2, 6, 7, 8]);
        let pair = side_by_side(&image, &image);
        assert_eq!((pair.width, pair.height), (6, 2));
        assert_eq!(pair.data[..18], [0, 1, 2, 3, 4, 5, 6, 7, 8, 0, 1, 2, 3, 4, 5, 6, 7, 8]);
    }
}
