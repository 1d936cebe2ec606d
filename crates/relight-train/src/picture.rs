//! Pictures as training and scoring need them: whole, under one light, 8 bits a channel.

use std::ops::ControlFlow;

use relight_field::engine::{Engine, Outputs, RenderSettings};
use relight_render::{Map, RenderError, render};
use relight_scene::{Image, Intrinsics, Pose};

/// What the camera at `pose` sees under the light at `light`, with the engine's own number of samples.
pub(crate) fn draw(
    engine: &dyn Engine,
    camera: &Intrinsics,
    pose: &Pose,
    light: &Pose,
) -> Result<Image, RenderError> {
    let settings = RenderSettings::default();
    let progress = &mut |_: usize, _: usize| ControlFlow::Continue(());
    render(engine, camera, pose, light, Outputs::default(), &settings, progress)?.image(Map::Final, None)
}
