//! What a camera has in view.

use crate::camera::Camera;
use crate::pose::Pose;
use crate::vector::{Vector, dot, unit};

/// Parts of an image, an axis, between which its directions are looked up: a lens may bend its edges, and what lies within.
const PLACES: u32 = 32;

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
        let along = |place: u32, pixels: u32| f64::from(place) / f64::from(PLACES) * f64::from(pixels) - 0.5;
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (column, row) in (0..=PLACES).flat_map(|column| (0..=PLACES).map(move |row| (column, row))) {
            let direction = lens.unproject(along(column, lens.width), along(row, lens.height));
            for axis in 0..2 {
                lo[axis] = lo[axis].min(direction[axis]);
                hi[axis] = hi[axis].max(direction[axis]);
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
