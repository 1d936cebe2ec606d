//! What a camera has in view.

use crate::camera::Camera;
use crate::pose::Pose;
use crate::vector::{Vector, dot, unit};

/// Places along each edge of an image at which its directions are looked up: a lens may bend the edge.
const PLACES: u32 = 64;

/// A pyramid of view: all that lies ahead of a camera, between four planes through it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    camera: Pose,
    /// Unit normals of its planes, in the camera's frame, to the inside.
    inward: [Vector; 4],
}

impl Frustum {
    /// The smallest around all that a camera's image shows.
    pub fn of(camera: &Camera) -> Self {
        let lens = &camera.intrinsics;
        let (right, bottom) = (f64::from(lens.width) - 0.5, f64::from(lens.height) - 0.5);
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in 0..=PLACES {
            let along = |end: f64| f64::from(place) / f64::from(PLACES) * (end + 0.5) - 0.5;
            let (u, v) = (along(right), along(bottom));
            for (u, v) in [(u, -0.5), (u, bottom), (-0.5, v), (right, v)] {
                let direction = lens.unproject(u, v);
                for axis in 0..2 {
                    lo[axis] = lo[axis].min(direction[axis]);
                    hi[axis] = hi[axis].max(direction[axis]);
                }
            }
        }
        let normals = [[1.0, 0.0, -lo[0]], [-1.0, 0.0, hi[0]], [0.0, 1.0, -lo[1]], [0.0, -1.0, hi[1]]];
        Self { camera: camera.pose, inward: normals.map(|normal| unit(normal).unwrap_or(normal)) }
    }

    /// How far inside a world point is, metres: the distance to the nearest of the planes. Negative outside, which is then at
    /// least so far away.
    pub fn depth_of(&self, point: [f64; 3]) -> f64 {
        let point = self.camera.inverse_transform(point);
        self.inward.iter().map(|&normal| dot(normal, point)).fold(f64::INFINITY, f64::min)
    }
}
