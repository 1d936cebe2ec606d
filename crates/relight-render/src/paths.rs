//! Camera and light paths: one [`Shot`] a frame.

use std::path::Path;

use glam::{DQuat, DVec3};
use relight_scene::{Camera, Intrinsics, Light, Pose};

use crate::dome::Dome;
use crate::error::RenderError;
use crate::interpolation::{interpolate, pose, rotation};
use crate::path_file;

/// Frames of the longest path.
pub const MOST_FRAMES: usize = 100_000;
/// Turns of the light about the object while it climbs the dome and comes down again.
const LIGHT_TURNS: f64 = 2.0;

/// One frame of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Camera-to-world.
    pub camera: Pose,
    /// Light-to-world.
    pub light: Pose,
}

/// The camera on the cameras' mean distance and elevation about the focus, all the way round if they stand all round,
/// and otherwise to and fro within their azimuths; the light stays. `lens` is the one to draw with: it sees the focus
/// at the middle of its image. The last frame leads back to the first.
///
/// # Errors
/// [`RenderError::Placement`] without cameras, or for no frames or more than 100000.
pub fn orbit(
    cameras: &[Camera],
    lens: &Intrinsics,
    focus: [f64; 3],
    light: &Pose,
    frames: usize,
) -> Result<Vec<Shot>, RenderError> {
    let dome = Dome::of(cameras.iter().map(|camera| &camera.pose), focus).ok_or_else(|| none("cameras"))?;
    shots(frames, |phase| {
        let position = dome.point(dome.azimuth(phase), dome.elevation);
        Shot { camera: aimed(lens, position, focus), light: *light }
    })
}

/// The light on the lights' mean distance about the focus, winding up their dome and down again; the camera stays. The
/// last frame leads back to the first.
///
/// # Errors
/// [`RenderError::Placement`] without lights, or for no frames or more than 100000.
pub fn lights(
    lights: &[Light],
    focus: [f64; 3],
    camera: &Pose,
    frames: usize,
) -> Result<Vec<Shot>, RenderError> {
    let dome = Dome::of(lights.iter().map(|light| &light.pose), focus).ok_or_else(|| none("lights"))?;
    let [low, high] = dome.elevations;
    shots(frames, |phase| {
        let height = 0.5 - 0.5 * (std::f64::consts::TAU * phase).cos();
        let position = dome.point(dome.azimuth(LIGHT_TURNS * phase), low + (high - low) * height);
        Shot { camera: *camera, light: Pose::look_at(position, focus) }
    })
}

/// The path of a file, smoothly through its keyframes from the first to the last: rotations by slerp, positions by a
/// centripetal Catmull-Rom spline, equal time between keyframes.
///
/// The file is JSON: `{"format": "relight-path", "version": 1, "keyframes": [...]}`, a keyframe `{"camera": [16 numbers],
/// "light": [16 numbers or x, y, z]}`; matrices row-major, to-world, metres. A light given by its position looks at the focus.
///
/// # Errors
/// [`RenderError::Scene`] or [`RenderError::File`] if the file is no such path, [`RenderError::Placement`] for no frames or
/// more than 100000.
pub fn from_file(path: &Path, focus: [f64; 3], frames: usize) -> Result<Vec<Shot>, RenderError> {
    let keyframes = path_file::read(path, focus)?;
    let cameras: Vec<Pose> = keyframes.iter().map(|shot| shot.camera).collect();
    let lights: Vec<Pose> = keyframes.iter().map(|shot| shot.light).collect();
    checked(frames)?;
    let span = (keyframes.len() - 1) as f64 / frames.saturating_sub(1).max(1) as f64;
    (0..frames)
        .map(|frame| {
            let at = |poses: &[Pose]| {
                interpolate(poses, span * frame as f64).ok_or_else(|| RenderError::file(path, "no keyframes"))
            };
            Ok(Shot { camera: at(&cameras)?, light: at(&lights)? })
        })
        .collect()
}

/// A closed path: one shot for each of `frames` phases in 0..1.
fn shots(frames: usize, shot: impl Fn(f64) -> Shot) -> Result<Vec<Shot>, RenderError> {
    checked(frames)?;
    Ok((0..frames).map(|frame| shot(frame as f64 / frames as f64)).collect())
}

fn checked(frames: usize) -> Result<(), RenderError> {
    if (1..=MOST_FRAMES).contains(&frames) {
        return Ok(());
    }
    Err(RenderError::Placement(format!("a path of {frames} frames cannot be: choose 1 to {MOST_FRAMES}")))
}

fn none(what: &str) -> RenderError {
    RenderError::Placement(format!("there are no {what} to lead a path along"))
}

/// A camera at `position` that sees `target` at the middle of its image, which need not be its principal point.
fn aimed(lens: &Intrinsics, position: [f64; 3], target: [f64; 3]) -> Pose {
    let (u, v) = (0.5 * (f64::from(lens.width) - 1.0), 0.5 * (f64::from(lens.height) - 1.0));
    let middle = DVec3::from_array(lens.unproject(u, v)).normalize_or(DVec3::Z);
    let upright = Pose::look_at(position, target);
    pose(rotation(&upright) * DQuat::from_rotation_arc(middle, DVec3::Z), DVec3::from_array(position))
}
