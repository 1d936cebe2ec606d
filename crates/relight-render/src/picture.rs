//! A whole picture, drawn some tiles at a time.

use std::ops::ControlFlow;

use rayon::prelude::*;
use relight_field::engine::{Engine, EngineError, LightPose, Outputs, RenderSettings, Samples};
use relight_scene::{Intrinsics, Pose};

use crate::error::RenderError;
use crate::pixel_order::in_tiles;
use crate::rays::camera_rays;

/// Rays handed to the engine at once: enough to keep all cores busy, few enough to bound memory and to report
/// progress often.
const BATCH: usize = 1 << 16;
/// Limits of a picture.
const LONGEST_SIDE: u32 = 1 << 14;
const MOST_PIXELS: usize = 1 << 26;

/// What a camera sees of a field under a light. All vectors are row-major with the origin at the top left, one entry a
/// pixel, or empty where the picture has no such map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour under the light, sRGB in 0..1.
    pub colour: Vec<[f32; 3]>,
    /// Visibility `o` in 0..1.
    pub visibility: Vec<f32>,
    /// Colour before visibility, `c`, sRGB in 0..1.
    pub reflectance: Vec<[f32; 3]>,
    /// Expected distance from the camera along the pixel's ray, metres.
    pub depth: Vec<f32>,
    /// Share of the ray's weight inside the field's box, 0..1.
    pub opacity: Vec<f32>,
}

/// Checks that a picture is neither empty nor enormous, before anything is drawn.
///
/// # Errors
/// [`RenderError::Size`] if it is.
pub fn check_size(width: u32, height: u32) -> Result<(), RenderError> {
    let pixels = width as usize * height as usize;
    if pixels == 0 || pixels > MOST_PIXELS || width.max(height) > LONGEST_SIDE {
        return Err(RenderError::Size { width, height });
    }
    Ok(())
}

/// Draws the field from the camera at `pose` under the light at `light` (light-to-world).
///
/// `progress` is told the pixels done and the pixels in all after each batch of them; if it answers
/// [`ControlFlow::Break`], drawing stops.
///
/// # Errors
/// [`RenderError::Size`] for an empty or enormous picture, [`RenderError::Cancelled`] if `progress` said so, and
/// whatever the engine reports.
pub fn render(
    engine: &dyn Engine,
    intrinsics: &Intrinsics,
    pose: &Pose,
    light: &Pose,
    outputs: Outputs,
    settings: &RenderSettings,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Picture, RenderError> {
    let (width, height) = (intrinsics.width, intrinsics.height);
    check_size(width, height)?;
    let all = width as usize * height as usize;
    let light = LightPose(light.row_major_f32());
    let mut picture = Picture { width, height, ..Picture::default() };
    let mut order = in_tiles(width as usize, height as usize);
    for done in (0..all).step_by(BATCH) {
        let pixels: Vec<usize> = order.by_ref().take(BATCH).collect();
        let rays = camera_rays(intrinsics, pose, pixels.par_iter().copied());
        let samples = engine.render(&rays, &light, outputs, settings)?;
        picture.put(&pixels, &samples)?;
        if progress(done + pixels.len(), all).is_break() {
            return Err(RenderError::Cancelled);
        }
    }
    Ok(picture)
}

impl Picture {
    /// Puts samples in their pixels.
    fn put(&mut self, pixels: &[usize], samples: &Samples) -> Result<(), RenderError> {
        let always = [samples.colour.len(), samples.depth.len(), samples.opacity.len()];
        let sometimes = [samples.visibility.len(), samples.reflectance.len()];
        let n = pixels.len();
        if always.iter().any(|&m| m != n) || sometimes.iter().any(|&m| m != n && m != 0) {
            return Err(EngineError::Shape("the engine did not answer every ray once".to_owned()).into());
        }
        let all = self.width as usize * self.height as usize;
        let Self { colour, visibility, reflectance, depth, opacity, .. } = self;
        rayon::scope(|scope| {
            scope.spawn(|_| put_map(colour, all, pixels, &samples.colour));
            scope.spawn(|_| put_map(visibility, all, pixels, &samples.visibility));
            scope.spawn(|_| put_map(reflectance, all, pixels, &samples.reflectance));
            scope.spawn(|_| put_map(depth, all, pixels, &samples.depth));
            scope.spawn(|_| put_map(opacity, all, pixels, &samples.opacity));
        });
        Ok(())
    }
}

/// Puts values in their pixels of a map of `all` pixels, if there are values.
fn put_map<T: Copy + Default>(map: &mut Vec<T>, all: usize, pixels: &[usize], values: &[T]) {
    if map.is_empty() && !values.is_empty() {
        // Zeros come from the system, which is faster than writing them.
        *map = vec![T::default(); all];
    }
    for (&pixel, &value) in pixels.iter().zip(values) {
        map[pixel] = value;
    }
}
