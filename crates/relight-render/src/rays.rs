//! The rays of a camera's pixels.

use rayon::prelude::*;
use relight_field::engine::Rays;
use relight_scene::{Intrinsics, Pose};

/// Rays through the centres of some pixels, which are counted row by row from the top left; world frame, unit
/// directions from the camera into the scene. Lens distortion is removed from the rays: the image is not resampled.
///
/// A pixel beyond the last row gets the ray that it would have if the image went on.
pub fn camera_rays(
    intrinsics: &Intrinsics,
    pose: &Pose,
    pixels: impl IntoParallelIterator<Iter: IndexedParallelIterator, Item = usize>,
) -> Rays {
    let width = intrinsics.width.max(1) as usize;
    let origin = pose.position().map(|c| c as f32);
    let directions: Vec<[f32; 3]> = pixels
        .into_par_iter()
        .with_min_len(1024)
        .map(|pixel| {
            let (u, v) = ((pixel % width) as f64, (pixel / width) as f64);
            let d = pose.rotate(intrinsics.unproject(u, v));
            let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
            d.map(|c| (c / length) as f32)
        })
        .collect();
    Rays { origins: rayon::iter::repeat_n(origin, directions.len()).collect(), directions }
}
