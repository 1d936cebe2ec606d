//! The cell of the tests: the paper's two arms on either side of an object.

// Each test file uses a part of it, outside of test functions.
#![allow(dead_code, clippy::unwrap_used)]

use relight_capture::kinematics::{Arm, Cell, EC66, Joints, Tool, UR5E};
use relight_capture::trajectory::ObjectBox;
use relight_scene::Pose;

pub const CLEARANCE: f64 = 0.01;
pub const OBJECT: ObjectBox = ObjectBox { lo: [-0.08, -0.08, 0.0], hi: [0.08, 0.08, 0.15] };
/// Where both arms stand upright.
pub const UPRIGHT: [Joints; 2] = [EC66.upright, UR5E.upright];

fn standing_at(x: f64) -> Pose {
    Pose([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
}

pub fn camera_arm() -> Arm {
    Arm { name: "camera arm".to_owned(), model: EC66.clone(), base: standing_at(1.0), tool: Tool::camera() }
}

pub fn light_arm() -> Arm {
    Arm { name: "light arm".to_owned(), model: UR5E.clone(), base: standing_at(-0.45), tool: Tool::light() }
}

pub fn cell() -> Cell<2> {
    Cell::new([camera_arm(), light_arm()], Some(0.0), Some(OBJECT), CLEARANCE).unwrap()
}

/// A tool at a distance from the object, looking at it.
pub fn looking(radius: f64, elevation_degrees: f64, azimuth_degrees: f64) -> Pose {
    let (elevation, azimuth) = (elevation_degrees.to_radians(), azimuth_degrees.to_radians());
    let across = radius * elevation.cos();
    let position = [across * azimuth.cos(), across * azimuth.sin(), radius * elevation.sin()];
    Pose::look_at(position, [0.0, 0.0, 0.1])
}

/// The configuration at a fraction of a motion.
pub fn between(from: &[Joints; 2], to: &[Joints; 2], fraction: f64) -> [Joints; 2] {
    std::array::from_fn(|i| std::array::from_fn(|j| from[i][j] + fraction * (to[i][j] - from[i][j])))
}
