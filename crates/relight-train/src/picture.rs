//! Pictures as training and scoring need them: whole, under one light, 8 bits a channel.

use std::ops::ControlFlow;

use relight_field::engine::{Engine, Outputs, RenderSettings};
use relight_render::{Map, RenderError, render};
use relight_scene::{Image, Intrinsics, Pose};

/// What the camera at `pose` sees under the light at `light`.
pub(crate) fn draw(
    (engine, settings): (&dyn Engine, &RenderSettings),
    camera: &Intrinsics,
    pose: &Pose,
    light: &Pose,
) -> Result<Image, RenderError> {
    let progress = &mut |_: usize, _: usize| ControlFlow::Continue(());
    render(engine, camera, pose, light, Outputs::default(), settings, progress)?.image(Map::Final, None)
}
