//! Images to pixels, view by view.

use std::iter::Peekable;
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::View;
use crate::error::{FaultKind, SceneError};
use crate::image_file::Image;
use crate::scene::Scene;

/// Images decoded at once, a thread: enough that threads seldom wait for each other at a batch's end.
const IMAGES_A_THREAD: usize = 8;
/// Bytes of the images decoded at once, unless they are fewer than one a thread.
const BYTES_AT_ONCE: usize = 1 << 28;
/// Pixels interleaved by one task.
const BLOCK: usize = 1 << 10;

/// One image's share of a part: some pixels of a view under one light.
struct Job<'a> {
    view: &'a View,
    pixels: Range<usize>,
    /// Where among the view's lights.
    slot: usize,
}

/// Decodes all views and hands their bytes, `[pixel][light][rgb]`, to `sink` in order, until it breaks off. A view of
/// more than `part` bytes is handed over in parts of its pixels, and its images are decoded once for each. Besides what
/// the sink keeps, memory holds one part and a few images a thread, however many lights a view has.
pub(super) fn decode(
    scene: &Scene,
    views: &[View],
    part: usize,
    progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    sink: &mut dyn FnMut(&[u8]) -> ControlFlow<()>,
) -> Result<(), SceneError> {
    let total = views.iter().map(|view| view.frames.len()).sum();
    let done = AtomicUsize::new(0);
    let mut jobs = views.iter().flat_map(|view| jobs(view, part)).peekable();
    let mut bytes = Vec::new();
    loop {
        let batch = batch(&mut jobs);
        if batch.is_empty() {
            return Ok(());
        }
        let decoded: Vec<(&Job, Image)> = batch
            .par_iter()
            .map(|job| {
                let image = read_training(scene, job.view.frames[job.slot])?;
                if job.pixels.end == job.view.pixels
                    && progress(done.fetch_add(1, Ordering::Relaxed) + 1, total).is_break()
                {
                    return Err(SceneError::Cancelled);
                }
                Ok((job, image))
            })
            .collect::<Result<_, SceneError>>()?;
        for band in decoded.chunk_by(|_, (next, _)| next.slot > 0) {
            let Job { view, pixels, slot } = band[0].0;
            let lights = view.lights.len();
            bytes.resize(3 * lights * pixels.len(), 0);
            interleave(band, lights, &mut bytes);
            if slot + band.len() == lights && sink(&bytes).is_break() {
                return Ok(());
            }
        }
    }
}

/// A view's jobs: part by part, light by light.
fn jobs(view: &View, part: usize) -> impl Iterator<Item = Job<'_>> {
    let step = (part / (3 * view.lights.len())).max(1);
    (0..view.pixels).step_by(step).flat_map(move |start| {
        let pixels = start..(start + step).min(view.pixels);
        (0..view.lights.len()).map(move |slot| Job { view, pixels: pixels.clone(), slot })
    })
}

/// The jobs to do next, together.
fn batch<'a>(jobs: &mut Peekable<impl Iterator<Item = Job<'a>>>) -> Vec<Job<'a>> {
    let threads = rayon::current_num_threads();
    let mut batch = Vec::new();
    let mut bytes = 0;
    while let Some(job) = jobs.next_if(|job| {
        bytes += 3 * job.view.pixels;
        batch.len() < threads || batch.len() < IMAGES_A_THREAD * threads && bytes <= BYTES_AT_ONCE
    }) {
        batch.push(job);
    }
    batch
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

/// Puts a band of lights, `[light][pixel][rgb]`, in its place in a part, `[pixel][light][rgb]`.
fn interleave(band: &[(&Job, Image)], lights: usize, part: &mut [u8]) {
    let stride = 3 * lights;
    part.par_chunks_mut(BLOCK * stride).enumerate().for_each(|(block, to)| {
        for (Job { pixels, slot, .. }, image) in band {
            let from = image.data[3 * (pixels.start + block * BLOCK)..].as_chunks::<3>().0;
            for (pixel, colour) in to.chunks_exact_mut(stride).zip(from) {
                pixel[3 * slot..3 * slot + 3].copy_from_slice(colour);
            }
        }
    });
}
