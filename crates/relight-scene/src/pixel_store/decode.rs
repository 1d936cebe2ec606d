//! Images to pixels, view by view.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::View;
use crate::error::{FaultKind, SceneError};
use crate::image_file::Image;
use crate::scene::Scene;

/// Images decoded at once, a thread: enough that threads seldom wait for each other at a group's end.
const IMAGES_A_THREAD: usize = 4;
/// Pixels interleaved by one task.
const BLOCK: usize = 1 << 10;

/// Decodes all views and hands each view's bytes, `[pixel][light][rgb]`, to `sink` in order, until it breaks off. Besides
/// what the sink keeps, memory holds the images of a few views at a time: as many as keep all threads busy.
pub(super) fn decode(
    scene: &Scene,
    views: &[View],
    progress: &(dyn Fn(usize, usize) + Sync),
    sink: &mut dyn FnMut(&[u8]) -> ControlFlow<()>,
) -> Result<(), SceneError> {
    let total = views.iter().map(|view| view.frames.len()).sum();
    let done = AtomicUsize::new(0);
    let at_once = IMAGES_A_THREAD * rayon::current_num_threads();
    let mut rest = views;
    let mut pixels = Vec::new();
    while !rest.is_empty() {
        let mut images = 0;
        let full = rest.iter().position(|view| {
            images += view.frames.len();
            images >= at_once
        });
        let (group, later) = rest.split_at(full.map_or(rest.len(), |last| last + 1));
        rest = later;
        let frames: Vec<usize> = group.iter().flat_map(|view| view.frames.iter().copied()).collect();
        let decoded: Vec<Image> = frames
            .into_par_iter()
            .map(|frame| {
                let image = read_training(scene, frame)?;
                progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
                Ok(image)
            })
            .collect::<Result<_, SceneError>>()?;
        let mut decoded = decoded.as_slice();
        for view in group {
            let (images, others) = decoded.split_at(view.frames.len());
            decoded = others;
            pixels.resize(view.bytes.len(), 0);
            interleave(images, &mut pixels);
            if sink(&pixels).is_break() {
                return Ok(());
            }
        }
    }
    Ok(())
}

fn read_training(scene: &Scene, frame: usize) -> Result<Image, SceneError> {
    let image = scene.read_frame(frame)?;
    if image.is_black() {
        let problem = "the image is all black, but it is to be trained on";
        let mend = "The official release blacks out its test images, and no others; if this is one of them, the splits \
                    are not the published ones: leave its camera or light out of training.";
        return Err(SceneError::fault(FaultKind::Black, &scene.frames[frame].path, problem, mend));
    }
    Ok(image)
}

/// `[light][pixel][rgb]` to `[pixel][light][rgb]`.
fn interleave(images: &[Image], to: &mut [u8]) {
    let stride = 3 * images.len();
    to.par_chunks_mut(BLOCK * stride).enumerate().for_each(|(block, to)| {
        for (light, image) in images.iter().enumerate() {
            let from = image.data[3 * block * BLOCK..].as_chunks::<3>().0;
            for (pixel, colour) in to.chunks_exact_mut(stride).zip(from) {
                pixel[3 * light..3 * light + 3].copy_from_slice(colour);
            }
        }
    });
}
