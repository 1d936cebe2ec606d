//! A whole picture, drawn strip by strip.

use std::ops::ControlFlow;

use relight_field::engine::{Engine, EngineError, LightPose, Outputs, RenderSettings, Samples};
use relight_scene::{Intrinsics, Pose};

use crate::error::RenderError;
use crate::rays::camera_rays;

/// Rays handed to the engine at once: enough to keep all cores busy, few enough to bound memory and to report
/// progress often.
const STRIP: usize = 1 << 14;
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
/// `progress` is told the pixels done and the pixels in all after each strip of the picture; if it answers
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
    let pixels = width as usize * height as usize;
    let light = LightPose(light.row_major_f32());
    let mut picture = Picture { width, height, ..Picture::default() };
    for start in (0..pixels).step_by(STRIP) {
        let end = pixels.min(start + STRIP);
        let rays = camera_rays(intrinsics, pose, start..end);
        let samples = engine.render(&rays, &light, outputs, settings)?;
        picture.append(samples, end)?;
        if progress(end, pixels).is_break() {
            return Err(RenderError::Cancelled);
        }
    }
    Ok(picture)
}

impl Picture {
    /// Appends the samples of a strip, after which `pixels` pixels are done.
    fn append(&mut self, samples: Samples, pixels: usize) -> Result<(), RenderError> {
        self.colour.extend(samples.colour);
        self.visibility.extend(samples.visibility);
        self.reflectance.extend(samples.reflectance);
        self.depth.extend(samples.depth);
        self.opacity.extend(samples.opacity);
        let always = [self.colour.len(), self.depth.len(), self.opacity.len()];
        let sometimes = [self.visibility.len(), self.reflectance.len()];
        if always.iter().any(|&n| n != pixels) || sometimes.iter().any(|&n| n != pixels && n != 0) {
            return Err(EngineError::Shape("the engine did not answer every ray once".to_owned()).into());
        }
        Ok(())
    }
}
