//! Where to photograph a board from to determine a lens.

use std::f64::consts::{FRAC_PI_2, TAU};

use relight_scene::Pose;

/// By how much the board is tilted against the camera, degrees, in turn.
const TILTS: [f64; 2] = [30.0, 45.0];
/// How far beside the board's middle the camera looks, metres, and by how much the direction turns each time, radians: the
/// golden angle, so that in time the board's corners have been everywhere in the picture.
const ASIDE: f64 = 0.05;
const GOLDEN_ANGLE: f64 = 2.4;

/// Cameras around a board that lies in the middle of the world, `distance` metres from it, that together determine the lens:
/// tilted in all directions and rolled by quarter turns, looking beside the board's middle. A camera that is always upright
/// and always tilted alike cannot tell the principal point and the focal length from its own pitch. On a real rig a wrist that
/// turns and a board that is propped up this way and that amount to the same.
pub fn lens_viewpoints(count: usize, distance: f64) -> Vec<Pose> {
    let viewpoint = |i: usize| {
        let azimuth = TAU * i as f64 / count as f64;
        let (sine, cosine) = TILTS[i % TILTS.len()].to_radians().sin_cos();
        let position = [sine * azimuth.cos(), sine * azimuth.sin(), cosine].map(|v| v * distance);
        let towards = GOLDEN_ANGLE * i as f64;
        let upright = Pose::look_at(position, [ASIDE * towards.cos(), ASIDE * towards.sin(), 0.0]);
        let (sine, cosine) = (FRAC_PI_2 * (i % 4) as f64).sin_cos();
        Pose(upright.0.map(|[x, y, z, t]| [cosine * x + sine * y, cosine * y - sine * x, z, t]))
    };
    (0..count).map(viewpoint).collect()
}
